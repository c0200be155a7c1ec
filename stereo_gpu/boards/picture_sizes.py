"""Which pictures of a camera are of another size than the rest, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

MOST_NAMES = 3  # that a message lists


def tell_sizes(side: str, sizes: Iterable[tuple[str, tuple[int, int]]]) -> str:
    """Name the pictures that are not of the commonest size, and the way out.

    Args:
        side: "left" or "right".
        sizes: name and (width, height) in px of every picture of the camera.
    """
    named = list(sizes)
    [(common, often), *_] = Counter(size for _, size in named).most_common()
    others = [f"{name} is {size[0]} x {size[1]}" for name, size in named if size != common]
    more = f" and {len(others) - MOST_NAMES} more differ" if len(others) > MOST_NAMES else ""
    return (
        f"the {side} pictures differ in size: {often} of {len(named)} are {common[0]} x {common[1]} px, but"
        f" {', '.join(others[:MOST_NAMES])}{more}: leave these out, or take all pictures of a camera in one size"
    )
