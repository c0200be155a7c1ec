"""Sixteen numbers side by side, for the forms of kernels that are made for CPUs.

Warp's compiler for CPUs does not turn loops over single numbers into vector instructions, but makes one instruction,
or a few, of an operation on a wp.types.vector. An address is one in bytes; places count in numbers of four bytes.
A maximum that runs through a loop stays a vector only in memory.
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = wp.constant(16)
Floats = wp.types.vector(16, float)
Ints = wp.types.vector(16, int)


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
def aligned(address: wp.uint64) -> wp.uint64:
    """The next address that begins a line of the cache; 16 numbers of slack are enough."""
    return (address + wp.uint64(63)) / wp.uint64(64) * wp.uint64(64)
