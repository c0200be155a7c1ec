"""JSON as a tree of text, as OpenCV writes it too."""

from __future__ import annotations

import json
from typing import Any

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.tree import DEEPEST, Tree, insert


def parse_json(data: bytes) -> Tree:
    """The content of a JSON file, its numbers as they are written.

    Raises:
        InputError: this is no JSON, is cut off, is too deep, or has a name twice.
    """
    try:
        found: Tree = json.loads(data, parse_int=str, parse_float=str, parse_constant=str, object_pairs_hook=_named)
    except json.JSONDecodeError as error:
        raise InputError(f"not JSON, or cut off: {error.msg} at line {error.lineno}; copy it again") from None
    except (UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"not JSON ({type(error).__name__}): is this a calibration file?") from None
    return _plain(found, 0)


def _named(pairs: list[tuple[str, Any]]) -> dict[str, Tree]:
    parts: dict[str, Tree] = {}
    for name, value in pairs:
        insert(parts, name, value)
    return parts


def _plain(value: Any, depth: int) -> Tree:
    """The same with true, false and null as text too."""
    if depth > DEEPEST:
        raise InputError(f"it is nested more than {DEEPEST} deep: is this a calibration file?")
    if isinstance(value, dict):
        return {name: _plain(part, depth + 1) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part, depth + 1) for part in value]
    return value if isinstance(value, str) else json.dumps(value)
