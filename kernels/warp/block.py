"""What the threads of a block share, where Warp's tiles would put a barrier after every word: memory and barriers.

A launch with a block size runs so on CUDA, and on the CPU where `wp.config.enable_cpu_blocks` is set.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def memory(words: int) -> str:
    """Body of a native function word(k, value, write) -> int: write or read word k of the block's shared memory."""
    return f"""
#if defined(__CUDA_ARCH__)
    __shared__ int words[{words}];
#else
    static int words[{words}];  // the threads of a block take turns on one core
#endif
    if (write)
        words[k] = value;
    return words[k];
"""


@wp.func_native("WP_TILE_SYNC();")
def barrier():
    """Wait until all threads of the block are here, and see what they wrote."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __dp2a_lo(ours, theirs, total);
#else
    return total + (short)ours * (signed char)theirs + (ours >> 16) * (signed char)(theirs >> 8);
#endif
""")
def add_pair_product(total: int, ours: int, theirs: int) -> int:
    """Total + first x first + second x second of two whole numbers of 16 bits and two of 8 bits: one instruction."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (int step = 16; step > 0; step /= 2)
        value = min(value, __shfl_xor_sync(0xffffffff, value, step));
#endif
    return value;
""")
def lowest_of_warp(value: int) -> int:
    """The lowest value of the `warp_size` threads beside this one; all threads of the block take part."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return 32;
#else
    return 1;
#endif
""")
def warp_size() -> int:
    """How many threads run side by side."""
    ...


@wp.func_native("return array.data[i];")
def load(array: wp.array(dtype=float), i: int) -> float:
    """Element i of an array whose elements lie side by side: Warp's own [] multiplies by a stride of 64 bits."""
    ...


@wp.func_native("array.data[i] = value;")
def store(array: wp.array(dtype=float), i: int, value: float):
    """Write element i of an array whose elements lie side by side."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    atomicMax(array.data + i, value);
#else
    if (value > array.data[i])
        array.data[i] = value;
#endif
""")
def raise_to(array: wp.array(dtype=int), i: int, value: int):
    """Write a value to element i where it is larger, whatever other blocks do there meanwhile."""
    ...
