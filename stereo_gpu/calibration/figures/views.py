"""Every view with its reprojection arrows in both pictures, and the error of each as bars."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import cv2
import numpy as np

from stereo_gpu.calibration.figures.residuals import (
    Residuals,
    arrow_factor,
    arrow_words,
    pooled_residuals,
    scale_bar,
    view_residuals,
)
from stereo_gpu.calibration.figures.svg import Frame, dots, needles, path, thinned, words
from stereo_gpu.calibration.outcome import Calibration, CalibrationView
from stereo_gpu.types import Doubles

MOST_VIEWS = 60  # drawn; the rest are in the table of errors
MOST_CORNERS = 240  # drawn in a picture
PICTURE = 280.0  # units across
TYPICAL = 0.045  # of a picture's width: how long an arrow of the rms error comes
LONGEST = 0.15  # of a picture's width: from where on a view's arrows get a scale of their own
SIDES = ("left", "right")


def draw_bars(calibration: Calibration) -> str:
    """A table of all views: names, a bar for each camera's error and the epipolar one, or why it was left out."""
    errors = [_errors(calibration, number) for number in range(len(calibration.views))]
    longest = max((value for view in errors if view is not None for value in view), default=0.0) or 1.0
    rows, drawn = [], set(_chosen(calibration))
    for number, (view, found) in enumerate(zip(calibration.views, errors, strict=True), 1):
        names = f"{escape(view.left)} · {escape(view.right)}"
        link = f'<a href="#view-{number}">{number}</a>' if number - 1 in drawn else str(number)
        if found is None or not view.used:
            rows.append(
                f'<tr class="out"><th scope="row">{link}</th><td class="names">{names}</td>'
                f'<td colspan="2">left out: {escape(view.reason or "no error is known")}</td></tr>'
            )
            continue
        bars = "".join(
            f'<span class="bar {kind}" style="width:{100 * value / longest:.1f}%"></span>'
            for kind, value in zip((*SIDES, "epipolar"), found, strict=True)
        )
        told = " ".join(f"<span>{value:.3f}</span>" for value in found)
        rows.append(
            f'<tr><th scope="row">{link}</th><td class="names">{names}</td><td class="bars">{bars}</td>'
            f'<td class="number">{told}</td></tr>'
        )
    head = (
        '<tr><th scope="col">#</th><th scope="col">Pictures</th><th scope="col"><span class="key left">left</span>'
        ' <span class="key right">right</span> <span class="key epipolar">epipolar</span></th>'
        '<th scope="col" class="number">rms, px</th></tr>'
    )
    return (
        f'<div class="scroll"><table class="errors"><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table></div>'
    )


def draw_views(calibration: Calibration) -> tuple[str, str]:
    """A card for each view, or for those that matter most where there are many; returns cards and an introduction."""
    shown = _chosen(calibration)
    wide = min(camera.size[0] for camera in (calibration.rig.left, calibration.rig.right))
    typical = max(pooled_residuals(calibration, side).rms for side in (0, 1))
    factor = arrow_factor(typical, TYPICAL * wide)
    told = (
        "Arrows lead from where the model puts a corner to where it was seen,"
        f" {arrow_words(factor)} unless a view says otherwise."
    )
    if len(shown) < len(calibration.views):
        told += (
            f" Drawn are {len(shown)} of {len(calibration.views)} views: those left out first, then the worst ones;"
            " the table of errors has all."
        )
    return "".join(_card(calibration, number, factor) for number in shown), told


def _errors(calibration: Calibration, number: int) -> tuple[float, ...] | None:
    """Left, right and epipolar rms of one view, px."""
    if number >= len(calibration.rig.views):
        return None
    view = calibration.rig.views[number]
    found = tuple(value for value in (view.left_px, view.right_px, view.epipolar_px) if value is not None)
    return found if len(found) == 3 and np.isfinite(found).all() else None


def _chosen(calibration: Calibration) -> Sequence[int]:
    """Which views are drawn, in the order given."""
    views = calibration.views
    if len(views) <= MOST_VIEWS:
        return range(len(views))
    badness = [max(_errors(calibration, number) or (0.0,)) for number in range(len(views))]
    order = sorted(range(len(views)), key=lambda number: (views[number].used, -badness[number]))
    # Views left out may be many; half of the cards stay for those that count.
    out = [number for number in order if not views[number].used][: MOST_VIEWS // 2]
    used = [number for number in order if views[number].used][: MOST_VIEWS - len(out)]
    return sorted(out + used)


def _card(calibration: Calibration, number: int, factor: float) -> str:
    view = calibration.views[number]
    found = [view_residuals(view, side) for side in (0, 1)]
    cameras = (calibration.rig.left, calibration.rig.right)
    worst = max((one.rms / camera.size[0] for one, camera in zip(found, cameras, strict=True) if one), default=0.0)
    own = factor
    if worst * factor > LONGEST:
        own = arrow_factor(worst, LONGEST)
    pictures = "".join(
        _picture(view, side, camera.size, residuals, own)
        for side, (camera, residuals) in enumerate(zip(cameras, found, strict=True))
    )
    told = ", ".join(f"{side} {one.rms:.3f} px" for side, one in zip(SIDES, found, strict=True) if one is not None)
    details = [told] if told else []
    if own != factor:
        details.append(f"arrows {arrow_words(own)}")
    details += _pose(calibration, view)
    most = max((len(seen) for seen in view.seen if seen is not None), default=0)
    if most > MOST_CORNERS:
        details.append(f"{MOST_CORNERS} of {most:,} corners drawn")
    reason = "" if view.used else f'<p class="reason">Left out: {escape(view.reason or "no reason given")}</p>'
    name = f"{number + 1}. {escape(view.left)} · {escape(view.right)}"
    return (
        f'<figure id="view-{number + 1}" class="view{"" if view.used else " out"}"><div class="two">{pictures}</div>'
        f"<figcaption><b>{name}</b>{reason}<span>{escape('; '.join(details))}</span></figcaption></figure>"
    )


def _picture(
    view: CalibrationView, side: int, size: tuple[int, int], residuals: Residuals | None, factor: float
) -> str:
    frame, seen = Frame(size, PICTURE), view.seen[side]
    css = SIDES[side] if view.used else "gone"
    label = f"{SIDES[side]} picture of the view: "
    if seen is None:
        middle = words(frame.width / 2, frame.height / 2, "no board found", "tick", anchor="middle")
        return frame.drawing([middle], label=label + "no board found")
    parts = [_outline(frame, np.asarray(seen, np.float64).reshape(-1, 2))]
    if residuals is None:
        corners = np.asarray(seen, np.float64).reshape(-1, 2)[thinned(len(seen), MOST_CORNERS)]
        parts.append(dots(frame.place(corners), f"root {css}"))
        return frame.drawing(parts, label=label + "corners as they were seen")
    kept = thinned(len(residuals.model), MOST_CORNERS)
    model, off = residuals.model[kept], residuals.off[kept]
    starts = frame.place(model)
    parts += [
        dots(starts, f"root {css}"),
        needles(starts, frame.place(model + factor * off), f"needle {css}"),
        *scale_bar(frame, factor, css),
    ]
    return frame.drawing(parts, label=f"{label}{residuals.rms:.3f} px rms")


def _outline(frame: Frame, corners: Doubles) -> str:
    """The area that the corners fill."""
    hull = cv2.convexHull(corners.astype(np.float32)).reshape(-1, 2)
    return path(frame.place(hull), "board", close=True)


def _pose(calibration: Calibration, view: CalibrationView) -> list[str]:
    """How far away the board was and how much it was turned out of the picture's plane."""
    if view.rotation is None or view.translation is None:
        return []
    middle = np.asarray(calibration.board.points, np.float64).mean(axis=0)
    place = view.rotation @ middle + np.asarray(view.translation).reshape(3)
    tilt = np.degrees(np.arccos(np.clip(abs(view.rotation[2, 2]), 0, 1)))
    if not (np.isfinite(place).all() and np.isfinite(tilt)):
        return []
    return [f"{np.linalg.norm(place):,.4g} {calibration.rig.unit} away, tilted by {tilt:.0f}°"]
