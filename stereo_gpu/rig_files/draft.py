"""What the readers of other programs' files hand on, before it is judged and becomes a rig."""

from __future__ import annotations

from dataclasses import dataclass

from stereo_gpu.deviations import Deviations
from stereo_gpu.types import Doubles

Size = tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class DraftCamera:
    """One camera as a file tells it.

    Args:
        matrix: (3, 3), px.
        distortion: (n,) in OpenCV's order, any length that OpenCV knows.
        size: width and height, px; None where the file does not say.
        rms_px: its reprojection error; 0 where the file does not say.
    """

    matrix: Doubles
    distortion: Doubles
    size: Size | None
    rms_px: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Draft:
    """A rig as a file tells it: X_right = R X_left + T.

    Args:
        left, right: the cameras.
        R, T: (3, 3) and (3,).
        unit: of T; None where the file does not say.
        rms_px, epipolar_rms_px: errors of the calibration; 0 where the file does not say.
        deviations: of its parameters; None where the file does not say.
    """

    left: DraftCamera
    right: DraftCamera
    R: Doubles
    T: Doubles
    unit: str | None
    rms_px: float = 0.0
    epipolar_rms_px: float = 0.0
    deviations: Deviations | None = None
