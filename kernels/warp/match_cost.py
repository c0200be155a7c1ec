"""Cost of every pixel at every disparity: how many census bits differ, and how much the colours do."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(16)
NO_MATCH = wp.constant(255)
UNSEEN = wp.constant(96)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(bits);
#else
    return __builtin_popcount(bits);
#endif
""")
def count_bits(bits: int) -> int:
    """Number of ones in a number."""
    ...


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
    y, x, i = wp.tid()
    row = y * width
    pixel = row + x
    u = x + direction * (smallest + i)
    cost = int(NO_MATCH)
    if reference_validity[pixel] != wp.uint8(MASKED):
        at = row + wp.clamp(u, 0, width - 1)
        if u < 0 or u >= width:
            cost = int(UNSEEN)
        elif other_validity[at] != wp.uint8(MASKED):
            bits = count_bits(reference_bits[pixel] ^ other_bits[at])
            apart = int(0)
            for c in range(3):
                plane = c * width * height
                apart += wp.abs(int(reference_guide[plane + pixel]) - int(other_guide[plane + at]))
            apart = wp.min(apart, 48)
            cost = (bits * (48 - bits) * 45 >> 8) + (apart * (96 - apart) * 5 >> 8)
    cost_out[pixel * disparities + i] = wp.uint8(cost)
