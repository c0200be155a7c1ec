"""A calibration as lines of text: errors, every parameter with its deviation, the lens models, what was left out."""

from __future__ import annotations

import cv2
import numpy as np

from stereo_gpu.calibration.figures.tables import with_deviation
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.deviations import COEFFICIENT_NAMES

COLUMN = 24  # characters


def calibration_table(calibration: Calibration) -> list[str]:
    """Lines for a terminal; a deviation is one standard deviation."""
    rig, found = calibration.rig, calibration.deviations
    cameras = (rig.left, rig.right)
    lines = [
        _row("", "left", "right"),
        _row("error, px", *(f"{camera.rms_px:.3f}" for camera in cameras)),
    ]
    deviations = (found.left, found.right)
    for name, row, column in (("fx", 0, 0), ("fy", 1, 1), ("cx", 0, 2), ("cy", 1, 2)):
        cells = (
            _told(camera.matrix[row, column], getattr(deviation, name))
            for camera, deviation in zip(cameras, deviations, strict=True)
        )
        lines.append(_row(f"{name}, px", *cells))
    for number in range(len(rig.left.distortion)):
        cells = (
            _told(camera.distortion[number], deviation.distortion[number])
            for camera, deviation in zip(cameras, deviations, strict=True)
        )
        lines.append(_row(COEFFICIENT_NAMES[number], *cells))
    degrees = np.rad2deg(cv2.Rodrigues(rig.R)[0].reshape(3)), np.rad2deg(found.om)
    lines += [
        _row("", "x", "y", "z"),
        _row("R, degrees", *map(_told, *degrees)),
        _row(f"T, {rig.unit}", *map(_told, rig.T, found.T)),
    ]
    if calibration.depth is not None:
        distance, deviation = calibration.depth
        lines.append(
            f"depth: at {distance:.3g} {rig.unit} certain to {deviation:.2g} {rig.unit}, as far as the calibration goes"
        )
    if calibration.models is not None:
        models = calibration.models
        errors = ", ".join(f"{error:.3f} px with {count}" for count, error in models.errors_px.items())
        lines.append(f"lens: {models.chosen} coefficients; error on views left out: {errors}")
        lines += [f"lens: {count} coefficients not taken: {why}" for count, why in models.refused.items()]
    return lines


def _row(name: str, *cells: str) -> str:
    return f"  {name:<12}{''.join(f'{cell:>{COLUMN}}' for cell in cells)}"


def _told(value: float, deviation: float) -> str:
    # Terminals that know no ± are still about.
    return with_deviation(float(value), float(deviation)).replace("±", "+-")
