"""Cost of every pixel at every disparity: the form for CPUs.

A work-item takes a row. Of the other row it keeps a piece in the order in which disparities grow, so that a vector
holds a pixel's costs at neighbouring disparities.
"""

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Bytes, Ints, aligned, ints, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(16)
NO_MATCH = wp.constant(255)
UNSEEN = wp.constant(96)
COLUMNS = wp.constant(256)
RANGE = wp.constant(256)
PIECE = wp.constant(528)  # columns, disparities and a vector
MEMORY = wp.constant(3456)  # six pieces, the costs of a range, and two vectors


@wp.func
def compare(piece: wp.uint64, k: int, bits: int, first: int, second: int, third: int) -> Ints:
    """Costs of the pixels at places k to k + 15 of the piece against ours, whose bits and colours are given."""
    ones = ints(piece, k) ^ Ints(bits)
    ones = ones - ((ones >> Ints(1)) & Ints(0x555555))
    ones = (ones & Ints(0x333333)) + ((ones >> Ints(2)) & Ints(0x333333))
    ones = (ones + (ones >> Ints(4))) & Ints(0x0F0F0F)
    ones = (ones + (ones >> Ints(8)) + (ones >> Ints(16))) & Ints(31)
    apart = wp.abs(ints(piece, PIECE + k) - Ints(first))
    apart += wp.abs(ints(piece, 2 * PIECE + k) - Ints(second))
    apart = wp.min(apart + wp.abs(ints(piece, 3 * PIECE + k) - Ints(third)), Ints(48))
    cost = (wp.cw_mul(ones, Ints(48) - ones) * 45) >> Ints(8)
    cost += (wp.cw_mul(apart, Ints(96) - apart) * 5) >> Ints(8)
    return (cost & ints(piece, 4 * PIECE + k)) | ints(piece, 5 * PIECE + k)


@wp.kernel
def match_cost(
    # In:
    reference_bits: wp.array(dtype=int),
    other_bits: wp.array(dtype=int),
    reference_guide: wp.array(dtype=wp.uint8),
    other_guide: wp.array(dtype=wp.uint8),
    reference_validity: wp.array(dtype=wp.uint8),
    other_validity: wp.array(dtype=wp.uint8),
    width: int,
    height: int,
    smallest: int,
    disparities: int,
    direction: int,
    # Out:
    cost_out: wp.array(dtype=wp.uint8),
):
    """Cost of matching reference(x, y) with other(x + direction d, y), 0..146, (H, W, D) with d fastest.

    The number of bits and the sum of colours that differ, both along a parabola that saturates (after AD-Census, Mei
    et al., 2011). UNSEEN where the other pixel is outside of the picture, NO_MATCH where either one is masked.
    """
    y = wp.tid()
    row = y * width
    plane = width * height
    memory = wp.zeros(shape=(MEMORY,), dtype=int)
    piece = aligned(memory.ptr)
    held = wp.array(ptr=piece, shape=(6 * PIECE,), dtype=int)
    costs = place(piece, 6 * PIECE)
    each = wp.array(ptr=costs, shape=(RANGE,), dtype=int)
    for start in range(0, width, COLUMNS):
        columns = wp.min(COLUMNS, width - start)
        for low in range(0, disparities, RANGE):
            searched = wp.min(RANGE, disparities - low)
            # Where the first disparity of the first pixel that is walked by lies.
            zero = wp.where(direction > 0, start, start + columns - 1) + direction * (smallest + low)
            for k in range(columns + searched):
                u = zero + direction * k
                at = row + wp.clamp(u, 0, width - 1)
                held[k] = other_bits[at]
                held[PIECE + k] = int(other_guide[at])
                held[2 * PIECE + k] = int(other_guide[plane + at])
                held[3 * PIECE + k] = int(other_guide[2 * plane + at])
                # A mask of what counts of the cost, and what stands where nothing does.
                counts = int(0)
                instead = int(UNSEEN)
                if u >= 0 and u < width:
                    instead = wp.where(other_validity[at] == wp.uint8(MASKED), NO_MATCH, 0)
                    counts = wp.where(instead == 0, -1, 0)
                held[4 * PIECE + k] = counts
                held[5 * PIECE + k] = instead
            for x in range(columns):
                pixel = row + start + x
                first = wp.where(direction > 0, x, columns - 1 - x)
                to = pixel * disparities + low
                if reference_validity[pixel] == wp.uint8(MASKED):
                    for i in range(searched):
                        cost_out[to + i] = wp.uint8(NO_MATCH)
                else:
                    bits = reference_bits[pixel]
                    red = int(reference_guide[pixel])
                    green = int(reference_guide[plane + pixel])
                    blue = int(reference_guide[2 * plane + pixel])
                    for i in range(0, searched, LANES):
                        put(costs, i, compare(piece, first + i, bits, red, green, blue))
                    whole = searched // LANES * LANES
                    # Bytes are made in a loop of their own, or the compiler takes the vectors of both apart.
                    for i in range(0, whole, LANES):
                        bytes_at = wp.array(ptr=cost_out.ptr + wp.uint64(to + i), shape=(1,), dtype=Bytes)
                        bytes_at[0] = Bytes(ints(costs, i))
                    for i in range(whole, searched):
                        cost_out[to + i] = wp.uint8(each[i])
