"""Trees of text, which YAML, XML and JSON come down to, and the numbers in them.

All values stay text until somebody asks for a number: then no reader takes 1e-05 for a word, as YAML 1.1 does, or
10:30 for a number.
"""

from __future__ import annotations

import math
import re

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.types import Doubles

DEEPEST = 32  # levels; the files of calibrations have three
LONGEST_NUMBER = 400  # characters; "1e-300" written out has 302
LARGEST_NUMBER = 1e30  # so that squares and products do not overflow
LARGEST_WHOLE = 2**31 - 1

Tree = str | list["Tree"] | dict[str, "Tree"]


def insert(parts: dict[str, Tree], name: str, value: Tree) -> None:
    """Put a value under a name that must be new.

    Raises:
        InputError: the name stands twice.
    """
    if name in parts:
        raise InputError(f"{name:.40} stands twice: delete one of them")
    parts[name] = value


def number(name: str, text: Tree) -> float:
    """The finite number that a text is, as Python, C or OpenCV (.Nan, .Inf) write it.

    Raises:
        InputError: it is none, or larger than anything in a calibration.
    """
    try:
        # float would take 1_000 and any script's digits.
        if not isinstance(text, str) or len(text) > LONGEST_NUMBER or "_" in text or not text.isascii():
            raise ValueError
        value = float(re.sub(r"\.(?=nan|inf)", "", text.lower()))
    except ValueError:
        raise InputError(f"{name} holds {shorten(text)}: it must be a number") from None
    if not math.isfinite(value):
        raise InputError(f"{name} holds {text:.40}: it must be finite")
    if abs(value) > LARGEST_NUMBER:
        raise InputError(f"{name} holds {text:.40}: no calibration has a number above {LARGEST_NUMBER:g}")
    return value


def whole(name: str, value: float) -> int:
    """`value` as a whole number.

    Raises:
        InputError: it is none.
    """
    if abs(value) > LARGEST_WHOLE or value != int(value):
        raise InputError(f"{name} is {value!r}: it must be a whole number of pixels")
    return int(value)


def matrix(name: str, tree: Tree, *shapes: tuple[int, ...]) -> Doubles:
    """The numbers under `name`, float64, in the first of `shapes` that their count fits.

    Taken are OpenCV's matrices (rows, cols and data, or sizes and data), lists, lists of rows, and text with blanks,
    commas or semicolons between the numbers. Rows and columns must be those of the shape, but a vector may lie or
    stand.

    Raises:
        InputError: a value is no finite number, or their count or layout fits no shape.
    """
    layout: list[int] = []
    content = tree
    if isinstance(tree, dict):
        if "data" not in tree:
            raise InputError(f"{name} has no data: is it a matrix?")
        content = tree["data"]
        keys = ("sizes",) if "sizes" in tree else ("rows", "cols")
        layout = [int(value) for key in keys if key in tree for value in _values(f"{name}.{key}", tree[key])]
    elif isinstance(tree, list) and tree and all(isinstance(row, list) and len(row) == len(tree[0]) for row in tree):
        layout = [len(tree), len(tree[0])]
    values = np.array(_values(name, content), np.float64)
    long = [side for side in layout if side != 1]
    for shape in shapes:
        if values.size == math.prod(shape) and (not layout or long == [side for side in shape if side != 1]):
            return values.reshape(shape)
    seen = f"{values.size} numbers"
    if layout:
        seen = f"{' x '.join(map(str, layout)):.40} rows and columns, {values.size} numbers"
    wanted = " or ".join(" x ".join(map(str, shape)) for shape in shapes)
    raise InputError(f"{name} has {seen}: it must have {wanted}")


def shorten(value: object) -> str:
    """A value for a message, one short piece of text."""
    if isinstance(value, dict):
        return f"{len(value)} named values"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    return f"{value!r:.40}"


def _values(name: str, tree: Tree) -> list[float]:
    """All numbers of a text, a list or a list of lists, in order."""
    if isinstance(tree, str):
        return [number(name, part) for part in re.split(r"[\s,;]+", tree.strip(" \t\r\n[],;")) if part]
    if isinstance(tree, dict):
        raise InputError(f"{name} holds {shorten(tree)}: it must hold numbers")
    return [
        value for part in tree for value in (_values(name, part) if isinstance(part, list) else [number(name, part)])
    ]
