"""Sixteen numbers side by side, for the forms of kernels that are made for CPUs.

Warp's compiler for CPUs does not turn loops over single numbers into vector instructions, but makes one instruction,
or a few, of an operation on a wp.types.vector. An address is one in bytes; places count in numbers of four bytes.

What runs through a loop, such as a maximum, stays a vector only in memory, and a vector whose lanes are taken apart
is taken apart wherever else it is used: load it anew. There is no comparison of lanes: a negative whole number
shifted down by 31 is a lane of ones, anything else one of zeros.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = wp.constant(16)
REPEAT = wp.constant(0)
ZERO = wp.constant(1)
NOTHING = wp.constant(2)
Floats = wp.types.vector(16, float)
Ints = wp.types.vector(16, int)
Bytes = wp.types.vector(16, wp.uint8)


@wp.func
def place(address: wp.uint64, k: int) -> wp.uint64:
    """The address k numbers further on."""
    return address + wp.uint64(4) * wp.uint64(k)


@wp.func
def floats(address: wp.uint64, k: int) -> Floats:
    """Load the numbers k to k + 15 at an address."""
    held = wp.array(ptr=place(address, k), shape=(1,), dtype=Floats)
    return held[0]


@wp.func
def ints(address: wp.uint64, k: int) -> Ints:
    """Load the whole numbers k to k + 15 at an address."""
    held = wp.array(ptr=place(address, k), shape=(1,), dtype=Ints)
    return held[0]


@wp.func
def put(address: wp.uint64, k: int, value: Any):
    """Store Floats or Ints as the numbers k to k + 15 at an address."""
    held = wp.array(ptr=place(address, k), shape=(1,), dtype=type(value))
    held[0] = value


@wp.func
def put_some(array: wp.array(dtype=float), k: int, end: int, held: wp.uint64):
    """Store the numbers at an address, or as many of them as come before `end`, as numbers k to k + 15 of an array."""
    if k + LANES <= end:
        put(array.ptr, k, floats(held, 0))
    else:
        lanes = wp.array(ptr=held, shape=(16,), dtype=float)
        for lane in range(end - k):
            array[k + lane] = lanes[lane]


@wp.func
def ones_if_nan(bits: Ints) -> Ints:
    """Lanes of ones where the bits of a float say that it is no number."""
    return (Ints(0x7F800000) - (bits & Ints(0x7FFFFFFF))) >> Ints(31)


@wp.func
def chosen(ones: Ints, yes: Ints, no: Ints) -> Ints:
    """The lanes of one vector where the mask has ones, those of the other where it has zeros."""
    return (yes & ones) | (no & (ones ^ Ints(-1)))


@wp.func
def largest(v: Ints) -> int:
    """The largest lane."""
    best = v[0]
    for lane in range(1, LANES):
        best = wp.max(best, v[lane])
    return best


@wp.func
def load_row(
    row: wp.array(dtype=float), start: int, p: int, length: int, width: int, direction: int, beyond: int, to: wp.uint64
):
    """Copy walking positions p to p + length - 1 of the row that starts at `start`, rounded up to whole vectors.

    direction 1 walks from the left edge, -1 from the right one. Beyond the ends stand: REPEAT the row's edge, ZERO
    0 or NOTHING NaN.
    """
    held = wp.array(ptr=to, shape=(length + LANES,), dtype=float)
    for k in range(0, length, LANES):
        if direction > 0 and p + k >= 0 and p + k + LANES <= width:
            put(to, k, floats(row.ptr, start + p + k))
        else:
            for lane in range(k, k + LANES):
                at = wp.clamp(p + lane, 0, width - 1)
                value = row[start + wp.where(direction > 0, at, width - 1 - at)]
                if at != p + lane and beyond != REPEAT:
                    value = wp.where(beyond == ZERO, 0.0, wp.nan)
                held[lane] = value


@wp.func
def aligned(address: wp.uint64) -> wp.uint64:
    """The next address that begins a line of the cache; 16 numbers of slack are enough."""
    return (address + wp.uint64(63)) / wp.uint64(64) * wp.uint64(64)
