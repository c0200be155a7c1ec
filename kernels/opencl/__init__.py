"""OpenCL C 1.2: any GPU, and PoCL or another CPU driver. The .cl files are the package's data."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).parent
# Kernels that are wanted together, and have no PIXEL: PoCL takes 20 ms for a program, even if it has built it before,
# whatever is in it.
_TOGETHER = (
    (
        "window_norms",
        "ncc_wta",
        "consistency",
        "median",
        "support",
        "fill",
        "confidence",
        "triangulate",
        "split_triangles",
    ),
    ("cover", "place", "bake", "residual", "pull", "push", "encode"),
    ("rasterise", "shade"),
)


@dataclass(frozen=True)
class Parameter:
    """A parameter of a kernel: its name, element type as written, and whether it is an array."""

    name: str
    type: str
    array: bool


def together(kernel: str) -> tuple[str, ...]:
    """The kernels of the program that a kernel is best built in, itself among them."""
    return next((names for names in _TOGETHER if kernel in names), (kernel,))


@cache
def source(kernel: str, form: str = "gpu") -> str:
    """Whole program text of a kernel alone, see `program_source`."""
    return program_source((kernel,), form)


@cache
def program_source(kernels: tuple[str, ...], form: str = "gpu") -> str:
    """Text of a program: the common header, the kernels' files, and the headers that they include, each once.

    The form "cpu" is NAME_cpu.cl where there is such a file; every other kernel has one form for all devices.
    """
    text = (_FOLDER / "common.h").read_text("utf-8")
    included = set()

    def include(match: re.Match[str]) -> str:
        if match[1] in included:
            return ""
        included.add(match[1])
        return (_FOLDER / match[1]).read_text("utf-8")

    for kernel in kernels:
        file = _FOLDER / f"{kernel}_cpu.cl"
        file = file if form == "cpu" and file.exists() else _FOLDER / f"{kernel}.cl"
        # Includes are spliced in here, since not every compiler takes a folder with a space in its name.
        text += re.sub(r'#include "(\w+\.h)"', include, file.read_text("utf-8"))
    return text


@cache
def parameters(kernel: str, form: str = "gpu") -> tuple[Parameter, ...]:
    """Parameters of a kernel in order, read from its signature; the same in every form."""
    text = re.sub(r"//[^\n]*", "", source(kernel, form))
    signature = re.search(rf"__kernel\b[^;{{}}]*?\bvoid\s+{kernel}\s*\((.*?)\)", text, re.DOTALL)
    if signature is None:
        raise ValueError(f"{kernel}.cl holds no kernel named {kernel}")
    found = []
    for declaration in signature[1].split(","):
        words = declaration.replace("*", " * ").split()
        element = next(word for word in words if word not in ("__global", "const"))
        found.append(Parameter(words[-1], element, "*" in words))
    return tuple(found)
