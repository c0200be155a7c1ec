"""How much two pixels look alike: weights of neighbours that probably belong to the same surface."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(16)
UNLIKE = wp.constant(
    240
)  # difference of the guide, summed over its three planes, from which on neighbours do not count


@wp.func
def likeness(alike: int) -> float:
    """(1 - difference / UNLIKE)^8, close to exp(-difference / 30), given UNLIKE - difference."""
    t = float(alike) * (1.0 / 240.0)
    t2 = t * t
    t4 = t2 * t2
    return t4 * t4


@wp.func
def neighbour_weight(
    guide: wp.array(dtype=wp.uint8), validity: wp.array(dtype=wp.uint8), pixels: int, here: int, there: int
) -> float:
    """Weight of the neighbour `there` of the pixel `here`, by the guide's planes of `pixels` bytes; 0 where masked."""
    difference = wp.abs(int(guide[here]) - int(guide[there]))
    difference += wp.abs(int(guide[here + pixels]) - int(guide[there + pixels]))
    difference += wp.abs(int(guide[here + 2 * pixels]) - int(guide[there + 2 * pixels]))
    if difference >= UNLIKE or (int(validity[there]) & MASKED) != 0:
        return 0.0
    return likeness(UNLIKE - difference)


@wp.func
def furthest(dx: int, dy: int) -> int:
    """Rows or columns that a neighbour is away, whichever is more."""
    return wp.max(wp.abs(dx), wp.abs(dy))
