"""The winners of both views among the keys of SPAN columns and a chunk of GROUP disparities, found by a block.

Word KEYS + s * PITCH + k of shared memory is the key of column s and of the other view's column u0 + k + s, so that
the disparities run with k or against it.
"""

import warp as wp

from stereo_gpu.kernels.warp.block import memory, raise_to
from stereo_gpu.kernels.warp.peaks import key_index

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GROUP = wp.constant(128)  # threads of a block; kernels/geometry.py has the same
SPAN = wp.constant(16)
CLASSES = wp.constant(8)  # threads that share the search for the winner of a column: GROUP / SPAN
PITCH = wp.constant(152)  # keys of a column and zeros beyond them; four columns lie in different banks
# Where in shared memory lie
KEYS = wp.constant(0)
HIGHEST = wp.constant(2432)  # of the keys that each thread saw,
SECONDS = wp.constant(2560)  # and the next one
WORDS = 3230  # of which ncc_wta needs those from 2688 on for itself


@wp.func_native(memory(WORDS))
def word(k: int, value: int, write: bool) -> int:
    """Write or read a word of the block's shared memory."""
    ...


@wp.func
def get(k: int) -> int:
    """A whole number in shared memory."""
    return word(k, 0, False)


@wp.func
def get_float(k: int) -> float:
    """A number in shared memory."""
    return wp.cast(word(k, 0, False), float)


@wp.func
def put(k: int, value: int):
    """Write a whole number to shared memory."""
    word(k, value, True)


@wp.func
def put_float(k: int, value: float):
    """Write a number to shared memory."""
    word(k, wp.cast(value, int), True)


@wp.func
def search_column(two: wp.vec2i, lane: int) -> wp.vec2i:
    """The two highest keys that a thread has seen so far, after every CLASSES-th one of a column.

    Neighbouring disparities are in different classes, so that of the winner and its neighbours none hides the
    runner-up.
    """
    high = two[0]
    second = two[1]
    column = KEYS + (lane >> 3) * PITCH + (lane & (CLASSES - 1))
    for k in range(SPAN):
        key = get(column + k * CLASSES)
        second = wp.max(second, wp.min(high, key))
        high = wp.max(high, key)
    return wp.vec2i(high, second)


@wp.func
def raise_winners(winners: wp.array(dtype=int), row: int, u0: int, lane: int, width: int):
    """Raise the other view's winners, from column u0 of the row on, to the highest of the keys."""
    # The keys of one u lie on a diagonal, and zeros beyond its ends.
    key = int(0)
    for s in range(SPAN):
        key = wp.max(key, get(KEYS + lane + s * (PITCH - 1)))
    if key > 0 and u0 + lane >= 0 and u0 + lane < width:
        raise_to(winners, row + u0 + lane, key)
    if lane < SPAN:
        far = int(0)
        for s in range(SPAN):
            far = wp.max(far, get(KEYS + GROUP + lane + s * (PITCH - 1)))
        if far > 0 and u0 + lane + GROUP >= 0 and u0 + lane + GROUP < width:
            raise_to(winners, row + u0 + lane + GROUP, far)


@wp.func
def highest_four(lane: int) -> wp.vec4i:
    """The four highest of the keys that the threads of column lane saw, two each."""
    four = wp.vec4i()
    for k in range(CLASSES):
        for rank in range(2):
            key = get(HIGHEST + rank * GROUP + lane * CLASSES + k)
            for place in range(3):
                lower = wp.min(four[place], key)
                four[place] = wp.max(four[place], key)
                key = lower
            four[3] = wp.max(four[3], key)
    return four


@wp.func
def runner_level(four: wp.vec4i, bits: int) -> int:
    """The level of the runner-up: of the three after the winner, two at most are its neighbours."""
    at = key_index(four[0], bits)
    runner = four[3]
    if wp.abs(key_index(four[2], bits) - at) > 1:
        runner = four[2]
    if wp.abs(key_index(four[1], bits) - at) > 1:
        runner = four[1]
    return runner >> bits
