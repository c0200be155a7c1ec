"""What the first pictures show in case it is not the board that was named, and what to do then."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Hint:
    """What one picture shows instead of the board.

    Args:
        about: what it is; pictures of the same thing say the same.
        text: the thing and the way out.
        weight: how much of it the picture shows; the text of the one that shows most is told.
    """

    about: str
    text: str
    weight: int = 0


def common_hint(hints: Sequence[Hint | None], share: float = 0.5) -> str:
    """The text on which at least such a share of the pictures agree; "" without such agreement.

    A chance find in a few pictures is no reason to doubt what was said of the board.

    Args:
        hints: one a picture; None where it seems to show the board, or none.
        share: of all pictures.
    """
    [(about, often)] = Counter(hint.about for hint in hints if hint is not None).most_common(1) or [("", 0)]
    if not often or often < share * len(hints):
        return ""
    return max((hint for hint in hints if hint is not None and hint.about == about), key=lambda hint: hint.weight).text
