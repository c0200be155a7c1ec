"""A drawing as a file of its own, with the look that it has on a page."""

from __future__ import annotations

from functools import cache
from pathlib import Path


def stand_alone(drawing: str) -> str:
    """An SVG file of a drawing of this package: it names its language, and brings its style sheet along."""
    opening, rest = drawing.split(">", 1)
    return f'{opening} xmlns="http://www.w3.org/2000/svg"><style>{style_sheet()}</style>{rest}\n'


@cache
def style_sheet() -> str:
    """The look of our pages, and of the drawings on them."""
    here = Path(__file__).parent
    return "".join(path.read_text("utf-8") for path in (here.parents[1] / "report.css", here / "svg.css"))
