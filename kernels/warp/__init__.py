"""Warp: CUDA, and the CPU. Import a kernel's module to get the kernel of the same name."""
