"""One moment as both cameras saw it."""

from __future__ import annotations

from dataclasses import dataclass

from stereo_gpu.types import Picture


@dataclass(frozen=True, kw_only=True)
class StereoFrame:
    """Two pictures that belong together.

    Args:
        number: counts the moments of this recording from 1, those that nobody takes as well.
        left, right: pictures of one size, uint8, (H, W, 3) RGB or (H, W).
        left_s, right_s: when each was grabbed, seconds on one clock that never runs backwards: the computer's for
            cameras and streams, that of the film for video files and folders.
    """

    number: int
    left: Picture
    right: Picture
    left_s: float
    right_s: float

    @property
    def skew_ms(self) -> float:
        """Time between the two grabs, milliseconds, never negative."""
        return abs(self.right_s - self.left_s) * 1000

    @property
    def time_s(self) -> float:
        """When both were there, seconds on the same clock."""
        return max(self.left_s, self.right_s)
