"""How many places of square windows a flag is set at, for the forms of kernels that are made for CPUs.

Counts of a row's columns, over the rows of its windows, are added up along the row: differences of such sums are
those of windows.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Bytes, Ints, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SPAN = wp.constant(1040)  # a block with the columns around it, and a vector
BLOCK = wp.constant(1024)  # radii are under half of it


@wp.func
def clear_counts(counts: wp.uint64, places: int):
    """Begin to count."""
    for k in range(0, places, LANES):
        put(counts, k, Ints(0))


@wp.func
def load_flags(array: wp.array(dtype=wp.uint8), p: int, places: int, to: wp.uint64):
    """Copy bytes as whole numbers, as many as whole vectors hold."""
    # A loop of its own, or the compiler takes the vectors of others apart.
    for k in range(0, places - LANES + 1, LANES):
        put(to, k, Ints(wp.array(ptr=array.ptr + wp.uint64(p + k), shape=(1,), dtype=Bytes)[0]))


@wp.func
def sum_counts(counts: wp.uint64, before: wp.uint64, places: int):
    """Add up the counts before each of so many places."""
    counted = wp.array(ptr=counts, shape=(SPAN,), dtype=int)
    sums = wp.array(ptr=before, shape=(SPAN,), dtype=int)
    total = int(0)
    for k in range(places):
        sums[k] = total
        total += counted[k]
    sums[places] = total


@wp.func
def window_pixels(x: int, radius: int, width: int, rows: int) -> int:
    """Pixels of a window of so many rows around column x that lie in the picture."""
    return (wp.min(x + radius + 1, width) - wp.max(x - radius, 0)) * rows
