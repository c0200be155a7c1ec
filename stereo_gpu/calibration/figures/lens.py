"""What the lens models do: how far a lens moves each part of the picture, and along the radius."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from stereo_gpu.calibration.figures.residuals import Residuals, arrow_factor, arrow_words
from stereo_gpu.calibration.figures.svg import WIDTH, Frame, Plot, dots, needles, path, round_number, segments, words
from stereo_gpu.rig import Camera
from stereo_gpu.types import Doubles

ARROWS = (13, 10)  # columns and rows
GRID = (81, 61)  # points at which contours are measured
LEVELS = 7  # contours, about
CLEAR = 22.0  # units between the numbers of two contours
SAMPLES = 120  # of the radial curve


def draw_distortion(camera: Camera, side: str) -> tuple[str, str]:
    """Displacement by the lens over the frame: contours in px, and arrows from the ideal to the real place."""
    frame = Frame(camera.size)
    grid = _grid(camera, *GRID)
    moved = np.linalg.norm(_displacement(camera, grid.reshape(-1, 2)), axis=1).reshape(grid.shape[:2])
    arrows = _grid(camera, ARROWS[0] + 2, ARROWS[1] + 2)[1:-1, 1:-1].reshape(-1, 2)
    off = _displacement(camera, arrows)
    largest = float(np.linalg.norm(off, axis=1).max())
    factor = arrow_factor(largest, 1.2 * camera.size[0] / ARROWS[0])
    starts = frame.place(arrows)
    centre = frame.place(camera.matrix[:2, 2])
    cross = np.array([[-7.0, 0], [0, -7]])
    drawing = frame.drawing(
        [
            _heat(frame, moved),
            *_contours(frame, grid, moved),
            dots(starts, f"root {side}"),
            needles(starts, frame.place(arrows + factor * off), f"needle {side}", thick=3.0),
            segments(centre + cross, centre - cross, "centre"),
        ],
        label=f"Distortion of the {side} lens",
    )
    return drawing, (
        f"Moved by up to {round(float(moved.max()), 3):.3g} px. Arrows are {arrow_words(factor)}; lines join places"
        " that are moved equally far, in px; the cross is the principal point."
    )


def draw_radial(cameras: tuple[Camera, Camera], residuals: tuple[Residuals, Residuals]) -> tuple[str, str]:
    """Displacement along the radius of both lenses; dashed beyond the outermost corner that was seen."""
    curves, told = [], []
    for camera, seen in zip(cameras, residuals, strict=True):
        radius, off = radial_displacement(camera)
        centre = camera.matrix[:2, 2]
        outermost = float(np.linalg.norm(seen.model - centre, axis=1).max()) if len(seen.model) else 0.0
        curves.append((radius, off, outermost))
    reach = max(float(radius[-1]) for radius, _, _ in curves)
    low = min(0.0, *(float(off.min()) for _, off, _ in curves))
    high = max(0.0, *(float(off.max()) for _, off, _ in curves))
    high = max(high, low + 0.1)
    step = round_number((high - low) / 5)
    plot = Plot(x=(0, reach), y=(step * np.floor(low / step), step * np.ceil(high / step)), size=(WIDTH, 0.75 * WIDTH))
    parts = plot.axes("distance from the principal point without a lens, px", "moved outwards, px")
    for number, side in enumerate(("left", "right")):
        camera, (radius, off, outermost) = cameras[number], curves[number]
        parts.append(words(WIDTH - 16, 26 + 15 * number, side, f"key-word {side}", anchor="end"))
        held = radius <= outermost
        both = np.column_stack([radius, off])
        parts.append(path(plot.place(both[held]), f"curve {side}"))
        beyond = both[max(0, int(held.sum()) - 1) :]
        parts.append(path(plot.place(beyond), f"curve beyond {side}"))
        turn = turning_radius(camera)
        if turn is not None:
            told.append(
                f"The {side} model folds back {turn:.0f} px from its principal point, within the picture:"
                " do not trust it there; use fewer coefficients or cover the corners."
            )
    seen_to = " and ".join(
        f"{outermost:.0f} px ({side})" for side, (_, _, outermost) in zip(("left", "right"), curves, strict=True)
    )
    words_told = f"Dashed beyond the outermost corners, {seen_to}, where nothing holds the curve."
    return plot.drawing(parts, label="Radial distortion of both lenses"), " ".join([words_told, *told])


def radial_displacement(camera: Camera) -> tuple[Doubles, Doubles]:
    """Radii without a lens, (N,) px, out to the farthest corner of the picture, and how far the lens moves each."""
    width, height = camera.size
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]])
    farthest = float(np.linalg.norm(corners - camera.matrix[:2, 2], axis=1).max())
    radius = np.linspace(0, farthest, SAMPLES)
    focal = float(np.sqrt(camera.matrix[0, 0] * camera.matrix[1, 1]))
    coefficients = np.zeros(12)
    coefficients[: len(camera.distortion)] = camera.distortion
    k1, k2, _, _, k3, k4, k5, k6 = coefficients[:8]
    square = (radius / focal) ** 2
    # The radial part of OpenCV's model alone.
    ratio = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
    off = radius * (ratio - 1)
    fine = np.isfinite(off)
    return np.asarray(radius[fine]), np.asarray(off[fine])


def turning_radius(camera: Camera) -> float | None:
    """Where, in px, a larger angle no longer lies further out, if that is within the picture; None if nowhere."""
    radius, off = radial_displacement(camera)
    back = np.flatnonzero(np.diff(radius + off) <= 0)
    return float(radius[back[0]]) if len(back) else None


def _grid(camera: Camera, columns: int, rows: int) -> Doubles:
    """Points (rows, columns, 2) px that span the picture from edge to edge."""
    width, height = camera.size
    across, down = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    return np.stack(np.meshgrid(across, down), axis=-1)


def _displacement(camera: Camera, pixels: Doubles) -> Doubles:
    """How far, (N, 2) px, the lens moves what a camera without one would show at these pixels.

    Forwards through the model, which has a value everywhere; its inverse has none beyond a fold.
    """
    matrix = camera.matrix
    rays = (pixels - matrix[:2, 2]) / (matrix[0, 0], matrix[1, 1])
    points = np.column_stack([rays, np.ones(len(rays))])
    real, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, camera.distortion)
    off = real.reshape(-1, 2) - pixels
    longest = float(np.hypot(*camera.size))
    return np.asarray(np.clip(np.nan_to_num(off, nan=0, posinf=longest, neginf=-longest), -longest, longest))


def _heat(frame: Frame, moved: Doubles) -> str:
    """The displacement as a veil of one colour, a small picture that the browser smooths."""
    share = moved / max(float(moved.max()), 1e-9)
    veil = np.zeros((*moved.shape, 4), np.uint8)
    veil[..., :3] = (60, 110, 225)  # blue, green, red
    veil[..., 3] = np.rint(110 * share)
    _, data = cv2.imencode(".png", veil)
    return (
        f'<image width="{frame.width:g}" height="{frame.height:.1f}" preserveAspectRatio="none"'
        f' href="data:image/png;base64,{base64.b64encode(data.tobytes()).decode()}"/>'
    )


def _contours(frame: Frame, grid: Doubles, moved: Doubles) -> list[str]:
    """Lines of equal displacement, each with its value."""
    largest = float(moved.max())
    if largest < 1e-3:
        return []
    step = round_number(largest / LEVELS)
    parts: list[str] = []
    written: list[tuple[float, float]] = []
    for number in range(1, int(largest / step) + 1):
        starts, ends = _level(grid, moved, number * step)
        if not len(starts):
            continue
        parts.append(segments(frame.place(starts), frame.place(ends), "contour"))
        # Nearest to the way from the middle to the lower right corner, which crosses most lines.
        middle, last = grid[len(grid) // 2, grid.shape[1] // 2], grid[-1, -1]
        along, away = (last - middle) / np.linalg.norm(last - middle), starts - middle
        aside = np.abs(away[:, 0] * along[1] - away[:, 1] * along[0]) - np.minimum(0, away @ along)
        [(x, y)] = frame.place(starts[np.argmin(aside)])
        x, y = min(max(x, 14), frame.width - 14), min(max(y, 12), frame.height - 5)
        if all(np.hypot(x - u, y - v) > CLEAR for u, v in written):
            written.append((x, y))
            parts.append(words(x, y + 3.5, f"{number * step:g}", "level", anchor="middle"))
    return parts


def _level(grid: Doubles, values: Doubles, level: float) -> tuple[Doubles, Doubles]:
    """Where `values` (H, W) on `grid` (H, W, 2) crosses a level: straight pieces, their starts and ends (N, 2).

    Every cell is cut into two triangles, in each of which a level is one straight line.
    """
    corners = [(slice(None, -1), slice(None, -1)), (slice(None, -1), slice(1, None)),
               (slice(1, None), slice(1, None)), (slice(1, None), slice(None, -1))]  # fmt: skip
    starts: list[Doubles] = []
    ends: list[Doubles] = []
    for triangle in ((0, 1, 2), (0, 2, 3)):
        places = np.stack([grid[corners[corner]].reshape(-1, 2) for corner in triangle], axis=1)
        heights = np.stack([values[corners[corner]].reshape(-1) for corner in triangle], axis=1)
        above = heights > level
        cut = above.any(axis=1) & ~above.all(axis=1)
        places, heights, above = places[cut], heights[cut], above[cut]
        # One corner lies on one side alone: the line runs between the two edges that leave it.
        alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
        row = np.arange(len(places))
        for turn, found in ((1, starts), (2, ends)):
            other = (alone + turn) % 3
            share = (level - heights[row, alone]) / (heights[row, other] - heights[row, alone])
            found.append(places[row, alone] + share[:, None] * (places[row, other] - places[row, alone]))
    return np.concatenate(starts), np.concatenate(ends)
