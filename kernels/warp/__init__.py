"""Warp: CUDA, and the CPU. Import a kernel's module to get the kernel of the same name."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).parent


def program(kernel: str, form: str = "gpu") -> Any:
    """A kernel by name; the form "cpu" is that of NAME_cpu.py where there is such a file."""
    file = f"{kernel}_cpu" if form == "cpu" and (_FOLDER / f"{kernel}_cpu.py").exists() else kernel
    return getattr(importlib.import_module(f"stereo_gpu.kernels.warp.{file}"), kernel)
