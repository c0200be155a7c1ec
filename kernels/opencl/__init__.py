"""OpenCL C 1.2: any GPU, and PoCL or another CPU driver. The .cl files are the package's data."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Parameter:
    """A parameter of a kernel: its name, element type as written, and whether it is an array."""

    name: str
    type: str
    array: bool


@cache
def source(kernel: str, form: str = "gpu") -> str:
    """Whole program text of a kernel: the common header, its file, and the headers that the file includes.

    The form "cpu" is NAME_cpu.cl where there is such a file; every other kernel has one form for all devices.
    """
    file = _FOLDER / f"{kernel}_cpu.cl"
    text = (file if form == "cpu" and file.exists() else _FOLDER / f"{kernel}.cl").read_text("utf-8")
    # Includes are spliced in here, since not every compiler takes a folder with a space in its name.
    text = re.sub(r'#include "(\w+\.h)"', lambda match: (_FOLDER / match[1]).read_text("utf-8"), text)
    return (_FOLDER / "common.h").read_text("utf-8") + text


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
