"""Whether there is a CUDA driver: asked before Warp, which takes a sixth of a second to import."""

from __future__ import annotations

import ctypes


def has_cuda_driver() -> bool:
    """Whether a CUDA driver can be loaded; asked before Warp, which complains on standard error if not."""
    for library in ("libcuda.so.1", "nvcuda.dll"):
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        return True
    return False
