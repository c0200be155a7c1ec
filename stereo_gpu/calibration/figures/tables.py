"""The parameters of a rig with their deviations, and the figures that sum a calibration up."""

from __future__ import annotations

import math
from html import escape

import cv2
import numpy as np

from stereo_gpu.calibration.lens_models import LensModels
from stereo_gpu.calibration.outcome import Calibration
from stereo_gpu.deviations import COEFFICIENT_NAMES, CameraDeviations
from stereo_gpu.rig import Camera

CERTAIN = 2.0  # deviations from zero, from which a coefficient of the lens is told from none


def with_deviation(value: float, deviation: float) -> str:
    """A value with as many digits as its deviation allows, such as "657.40 ± 0.35"; the latter has two."""
    if not (math.isfinite(value) and math.isfinite(deviation)):
        return "unknown"
    if deviation <= 0:
        return f"{value:.6g}"
    exponent = int(f"{deviation:.1e}".partition("e")[2])  # of the rounded deviation: 0.0999 has two digits as 0.10
    digits = min(12, max(0, 1 - exponent))
    return f"{value:.{digits}f} ± {deviation:.{digits}f}"


def parameter_tables(calibration: Calibration) -> str:
    """Three cards: each camera's parameters, and how the cameras stand to each other; ± is one standard deviation."""
    rig, deviations = calibration.rig, calibration.deviations
    om = cv2.Rodrigues(rig.R)[0].reshape(3)
    degrees = [
        (f"R {axis}, °", math.degrees(value), math.degrees(deviation))
        for axis, value, deviation in zip("xyz", om, deviations.om, strict=True)
    ]
    shifts = [
        (f"T {axis}, {rig.unit}", float(value), float(deviation))
        for axis, value, deviation in zip("xyz", rig.T, deviations.T, strict=True)
    ]
    cards = [
        _card("Left camera", _camera_rows(rig.left, deviations.left), _lens_names(rig.left)),
        _card("Right camera", _camera_rows(rig.right, deviations.right), _lens_names(rig.right)),
        _card("Left to right", degrees + shifts, frozenset()),
    ]
    return f'<div class="parameters">{"".join(cards)}</div>'


def lens_models_card(models: LensModels | None) -> str:
    """How well each number of lens coefficients foretells views left out; nothing where the number was given."""
    if models is None:
        return ""
    longest = max(models.errors_px.values()) or 1.0
    rows = []
    for count, error in models.errors_px.items():
        note = "taken" if count == models.chosen else models.refused.get(count, "")
        rows.append(
            f'<tr class="{"taken" if count == models.chosen else ""}"><th scope="row">{count}</th>'
            f'<td><span class="bar" style="width:{100 * error / longest:.1f}%"></span></td>'
            f'<td class="number">{error:.4f} px</td><td class="names">{escape(note)}</td></tr>'
        )
    return (
        '<section class="card"><h3>Lens models compared</h3><table class="models"><thead><tr>'
        '<th scope="col">coefficients</th><th scope="col" colspan="3">error of views left out</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
        '<p class="note">Each model was fitted to four fifths of the views and judged by the rest, in turn. The fewest'
        " coefficients that do as well as any are taken.</p></section>"
    )


def summary_tiles(calibration: Calibration, shares: tuple[float, float]) -> str:
    """The figures that are looked at first.

    Args:
        calibration: what to sum up.
        shares: of the left and the right picture that corners cover.
    """
    rig = calibration.rig
    used = sum(view.used for view in calibration.views)
    # The length of T changes by T's own direction times its change; the parts' correlation is not known here.
    deviation = float(np.linalg.norm(rig.T / rig.baseline * calibration.deviations.T))
    tiles = [
        ("Reprojection error", f"{rig.rms_px:.3f} px", f"left {rig.left.rms_px:.3f}, right {rig.right.rms_px:.3f}"),
        ("Epipolar error", f"{rig.epipolar_rms_px:.3f} px", "corners from their partners' lines"),
        ("Baseline", f"{with_deviation(rig.baseline, deviation)} {rig.unit}", "distance between the cameras"),
        ("Pairs", f"{used} of {len(calibration.views)}", "count in the calibration"),
        ("Covered", f"{100 * shares[0]:.0f} · {100 * shares[1]:.0f} %", "of the left and the right picture"),
    ]
    if calibration.depth is not None:
        depth, spread = calibration.depth
        tiles.append(("Depth", f"± {spread:.2g} {rig.unit}", f"at {depth:.3g} {rig.unit}, from the calibration alone"))
    return '<div class="tiles">' + "".join(
        f'<div class="tile"><span>{escape(name)}</span><b>{escape(value)}</b><small>{escape(more)}</small></div>'
        for name, value, more in tiles
    ) + "</div>"  # fmt: skip


def _camera_rows(camera: Camera, deviations: CameraDeviations) -> list[tuple[str, float, float]]:
    matrix = camera.matrix
    plain = [
        ("fx, px", matrix[0, 0], deviations.fx),
        ("fy, px", matrix[1, 1], deviations.fy),
        ("cx, px", matrix[0, 2], deviations.cx),
        ("cy, px", matrix[1, 2], deviations.cy),
    ]
    lens = zip(COEFFICIENT_NAMES, camera.distortion, deviations.distortion, strict=False)
    return [(name, float(value), float(deviation)) for name, value, deviation in [*plain, *lens]]


def _percent(share: float) -> str:
    """With two digits; what is not known to within itself needs no figure."""
    if not share < 1:
        return "> 100 %"
    return f"{100 * share:.0f} %" if share >= 0.0995 else f"{100 * share:.2g} %"


def _lens_names(camera: Camera) -> frozenset[str]:
    return frozenset(COEFFICIENT_NAMES[: len(camera.distortion)])


def _card(heading: str, rows: list[tuple[str, float, float]], lens: frozenset[str]) -> str:
    body, vague = [], False
    for name, value, deviation in rows:
        relative = _percent(deviation / abs(value)) if value else "-"
        doubtful = name in lens and abs(value) < CERTAIN * deviation
        vague |= doubtful
        mark = ' class="vague"' if doubtful else ""
        shown, _, spread = with_deviation(value, deviation).partition(" ± ")
        body.append(
            f'<tr{mark}><th scope="row">{escape(name)}</th><td class="number">{shown}</td>'
            f'<td class="number">{f"± {spread}" if spread else ""}</td><td class="number">{relative}</td></tr>'
        )
    head = '<tr><th scope="col"></th><th scope="col">value</th><th scope="col">1 σ</th><th scope="col">of it</th></tr>'
    note = (
        f'<p class="note">Grey: within {CERTAIN:g} deviations of zero, so the boards do not show that the lens needs'
        " it.</p>"
        if vague
        else ""
    )
    return (
        f'<section class="card"><h3>{escape(heading)}</h3><table class="values"><thead>{head}</thead>'
        f"<tbody>{''.join(body)}</tbody></table>{note}</section>"
    )
