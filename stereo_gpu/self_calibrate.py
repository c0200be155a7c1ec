"""A rig for a pair that has none, from the two pictures alone, with what the user knows of focal length and scale."""

from __future__ import annotations

import dataclasses
import math
import os
from dataclasses import dataclass
from typing import Any

from stereo_gpu.epipolar.uncalibrated import SelfCalibration, rig_from_pair
from stereo_gpu.errors import InputError
from stereo_gpu.focal_length import FocalLength, find_focal_length
from stereo_gpu.known_distance import KnownDistance
from stereo_gpu.rig import Rig
from stereo_gpu.types import Picture


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known of a pair without a rig; what is None is not.

    Args:
        focal_px: focal length of both cameras, px.
        baseline: distance between the cameras, mm.
        distance: between two places in the raw reference picture.

    Raises:
        InputError: the baseline is none, or it and the distance would both set the scale.
    """

    focal_px: float | None = None
    baseline: float | None = None
    distance: KnownDistance | None = None

    def __post_init__(self) -> None:
        if self.baseline is not None and not 0 < self.baseline < math.inf:
            raise InputError(f"baseline = {self.baseline:g} mm: give the distance between the cameras, above 0")
        if self.baseline is not None and self.distance is not None:
            raise InputError("both the baseline and a distance are given, and one sets the scale: leave out the other")

    def refuse_beside_rig(self) -> None:
        """Refuse anything that a rig says already.

        Raises:
            InputError: something is given.
        """
        for name, value in dataclasses.asdict(self).items():
            if value is not None:
                raise InputError(f"{name} is given beside a rig, which has its own: leave out one of the two")


@dataclass(frozen=True, kw_only=True)
class RigFound:
    """A rig that was made from one pair of pictures.

    Args:
        rig: of the raw pictures; in mm if the baseline was known, else in baselines.
        focal: its focal length, and how that was had.
        matched: the features that it was made from.
    """

    rig: Rig
    focal: FocalLength
    matched: SelfCalibration

    def record(self) -> dict[str, Any]:
        """What result.json holds of it."""
        return {
            "focal_px": self.focal.px,
            "focal_source": self.focal.source,
            "matches": self.matched.matches,
            "used": len(self.matched.points_left),
            "vertical_px": self.matched.vertical_px,
            "R": self.rig.R.tolist(),
            "T": self.rig.T.tolist(),
            "k1": float(self.rig.left.distortion[0]),
        }

    def warnings(self, unscaled: bool) -> list[str]:
        """What a person should know about a reconstruction with such a rig.

        Args:
            unscaled: whether neither the baseline nor a distance was known.
        """
        found = [f"The rig was made from {len(self.matched.points_left)} features of this pair: calibrate to measure."]
        if self.focal.guessed:
            found.append(
                f"The focal length, {self.focal.px:.0f} px, is guessed: depth is stretched by as much as it is wrong."
                " Give --focal."
            )
        if unscaled:
            found.append("The scale is unknown, lengths are in baselines: give --baseline or --distance.")
        return found


def self_calibrate(
    left: Picture, right: Picture, known: Known, sources: tuple[Picture | str | os.PathLike[str], ...] = ()
) -> RigFound:
    """Make a rig of two pictures, up to scale unless the baseline is known.

    Args:
        left, right: raw pictures of one size, by cameras of one kind that stand side by side.
        known: what is known of them.
        sources: their files, whose EXIF may tell the focal length.

    Raises:
        InputError: the pictures are swapped or differ in focal length, or what is known cannot be.
        StageError: they do not show enough in common, or were taken from one place.
    """
    focal = find_focal_length(sources, (left.shape[1], left.shape[0]), known.focal_px)
    matched = rig_from_pair(left, right, focal_px=focal.px)
    rig = matched.rig
    if known.baseline is not None:
        rig = dataclasses.replace(rig, T=rig.T * known.baseline, unit="mm")
    return RigFound(rig=rig, focal=focal, matched=matched)
