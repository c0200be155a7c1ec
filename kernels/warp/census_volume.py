"""Cost of every pixel at every disparity: how many census bits differ."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MASKED = wp.constant(16)
NO_MATCH = wp.constant(255)
UNSEEN = wp.constant(254)


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
def census_volume(
    # In:
    reference_bits: wp.array(dtype=int),
    other_bits: wp.array(dtype=int),
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
    """Hamming distance, 0..62, of reference(x, y) and other(x + direction d, y), (H, W, D) with d fastest.

    UNSEEN where the other pixel is outside of the picture, NO_MATCH where either one is masked.
    """
    y, x, i = wp.tid()
    pixel = y * width + x
    u = x + direction * (smallest + i)
    cost = int(NO_MATCH)
    if reference_validity[pixel] != wp.uint8(MASKED):
        at = y * width + wp.clamp(u, 0, width - 1)
        if u < 0 or u >= width:
            cost = int(UNSEEN)
        elif other_validity[at] != wp.uint8(MASKED):
            cost = count_bits(reference_bits[pixel * 2] ^ other_bits[at * 2])
            cost += count_bits(reference_bits[pixel * 2 + 1] ^ other_bits[at * 2 + 1])
    cost_out[pixel * disparities + i] = wp.uint8(cost)
