"""Vectors of how much neighbours look alike, for the forms of kernels that are made for CPUs."""

import warp as wp

from stereo_gpu.kernels.warp.lanes import (
    LANES,
    NOTHING,
    Bytes,
    Floats,
    Ints,
    chosen,
    ints,
    load_row,
    ones_if_nan,
    place,
    put,
)
from stereo_gpu.kernels.warp.likeness import MASKED, UNLIKE

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = wp.constant(256)  # columns that are taken at a time
LINE = wp.constant(272)  # a block and a vector


@wp.func
def load_bytes(
    array: wp.array(dtype=wp.uint8), start: int, p: int, columns: int, width: int, beyond: int, to: wp.uint64
):
    """Copy columns p to p + columns - 1 of the row that starts at `start`, as whole numbers; outside `beyond`."""
    held = wp.array(ptr=to, shape=(LINE,), dtype=int)
    for k in range(0, columns, LANES):
        if p + k >= 0 and p + k + LANES <= width:
            put(to, k, Ints(wp.array(ptr=array.ptr + wp.uint64(start + p + k), shape=(1,), dtype=Bytes)[0]))
        else:
            for lane in range(k, k + LANES):
                at = wp.clamp(p + lane, 0, width - 1)
                held[lane] = wp.where(at == p + lane, int(array[start + at]), beyond)


@wp.func
def load_values(disparity: wp.array(dtype=float), row: int, p: int, columns: int, width: int, far: int, to: wp.uint64):
    """Copy columns of a row; what has no value becomes the float whose bits are `far`."""
    load_row(disparity, row, p, columns, width, 1, NOTHING, to)
    for k in range(0, columns, LANES):
        bits = ints(to, k)
        put(to, k, chosen(ones_if_nan(bits), Ints(far), bits))


@wp.func
def load_guide(guide: wp.array(dtype=wp.uint8), pixels: int, row: int, p: int, columns: int, width: int, to: wp.uint64):
    """Copy columns of a row of the guide, a line for each of its planes."""
    for i in range(3):
        load_bytes(guide, i * pixels + row, p, columns, width, 0, place(to, i * LINE))


@wp.func
def weigh(
    guide: wp.array(dtype=wp.uint8),
    validity: wp.array(dtype=wp.uint8),
    pixels: int,
    row: int,
    p: int,
    columns: int,
    width: int,
    ours: wp.uint64,
    theirs: wp.uint64,
    to: wp.uint64,
):
    """Weights of the neighbours from column p on of a row for pixels whose guide is given.

    The same as neighbour_weight in likeness.py; 0 outside of the picture. `theirs` is room for three lines.
    """
    load_guide(guide, pixels, row, p, columns, width, theirs)
    load_bytes(validity, row, p, columns, width, MASKED, to)
    for k in range(0, columns, LANES):
        apart = wp.abs(ints(theirs, k) - ints(ours, k))
        apart += wp.abs(ints(theirs, LINE + k) - ints(ours, LINE + k))
        apart += wp.abs(ints(theirs, 2 * LINE + k) - ints(ours, 2 * LINE + k))
        # Ones where the bit of a mask is not set.
        counts = ((ints(to, k) & Ints(MASKED)) >> Ints(4)) - Ints(1)
        put(to, k, wp.max(Ints(UNLIKE) - apart, Ints(0)) & counts)
    for k in range(0, columns, LANES):
        t = Floats(ints(to, k)) * (1.0 / 240.0)
        t = wp.cw_mul(t, t)
        t = wp.cw_mul(t, t)
        put(to, k, wp.cw_mul(t, t))
