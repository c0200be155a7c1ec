"""Jobs that do nothing, by which `ray_nodes.py` times the engines; worker processes import them by name."""

from __future__ import annotations

from collections.abc import Callable

STAGES = 14


def nothing(number: int) -> int:
    """Answer at once."""
    return number


def tell_stages(number: int, *, tell: Callable[[str], None]) -> int:
    """Tell as many stages as a reconstruction has, and answer."""
    for stage in range(STAGES):
        tell(f"stage {stage}")
    return number
