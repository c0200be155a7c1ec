"""What a calibration and a surface of the built-in scene should be, and how far measured ones are from it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError
from stereo_gpu.rig import Rig
from stereo_gpu.scene import Scene, project, trace, undistort
from stereo_gpu.scene_objects import Thing
from stereo_gpu.types import Bytes, Doubles, RectifiedPair, View

SEEN_TOLERANCE = 1e-4  # of the way to a point: a hit nearer than that hides it
NEAREST, FARTHEST = 400.0, 1000.0  # mm: the working volume, where board and objects stand
GRID = (33, 25, 7)  # columns, rows, distances of points over the working volume
CLOSE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
OBJECTS = (Thing.CUBE, Thing.BEAR)

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What each pixel of a rectified view shows.

    Args:
        depth: (H, W) float64, mm along z of the rectified cameras; inf where there is nothing.
        things: (H, W) uint8, of `Thing`.
        shared: (H, W) bool, whether both cameras have the point in their picture with nothing before it.
    """

    depth: Doubles
    things: Bytes
    shared: Mask

    @property
    def objects(self) -> Mask:
        """(H, W) bool: the cube and the bear, where both cameras see them."""
        return np.isin(self.things, OBJECTS) & self.shared


def visible_from(scene: Scene, points: Doubles, centre: Doubles) -> Mask:
    """Whether nothing stands between surface points (N, 3) and a camera's centre (3,); left camera frame, mm."""
    steps, _ = trace(scene, centre, points - centre)
    return np.asarray(steps > 1 - SEEN_TOLERANCE)


def truth(scene: Scene, pair: RectifiedPair, reference: str = "right") -> Truth:
    """What every pixel of a view of a rectified pair shows.

    Rays are cast from the true centres through the pair's own pixels, so that what is wrong with the pair's
    calibration shows as an error of the surface.

    Raises:
        InputError: the pair is not in millimetres, or there is no such view.
    """
    view = _view(reference)
    if pair.unit != "mm":
        raise InputError(f"unit is {pair.unit!r}: the built-in scene is measured in mm")
    rig = scene.rig
    centres = {View.LEFT: np.zeros(3), View.RIGHT: -rig.R.T @ rig.T}
    other = View.LEFT if view is View.RIGHT else View.RIGHT
    cx = {View.LEFT: pair.cx_left, View.RIGHT: pair.cx_right}
    height, width = pair.left.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = np.stack([(x - cx[view]) / pair.focal_px, (y - pair.cy) / pair.focal_px, np.ones_like(x)], axis=-1)
    directions = rays.reshape(-1, 3) @ pair.rotation_left
    depth, things = trace(scene, centres[view], directions)
    shared = np.zeros(height * width, bool)
    hit = np.flatnonzero(np.isfinite(depth))
    points = centres[view] + depth[hit, None] * directions[hit]
    in_other = (points - centres[other]) @ pair.rotation_left.T
    columns = np.rint(in_other[:, 0] / in_other[:, 2] * pair.focal_px + cx[other]).astype(int)
    rows = np.rint(in_other[:, 1] / in_other[:, 2] * pair.focal_px + pair.cy).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height) & (in_other[:, 2] > 0)
    valid_other = pair.valid_right if other is View.RIGHT else pair.valid_left
    inside[inside] = valid_other[rows[inside], columns[inside]] != 0
    shared[hit[inside]] = visible_from(scene, points[inside], centres[other])
    valid = pair.valid_left if view is View.LEFT else pair.valid_right
    shape = (height, width)
    return Truth(depth=depth.reshape(shape), things=things.reshape(shape), shared=shared.reshape(shape) & (valid != 0))


def surface_distance(scene: Scene, points: Doubles) -> tuple[Doubles, Bytes]:
    """How far points (N, 3), left camera frame, are from the nearest true surface.

    Returns:
        (N,) mm, of first order, so exact near the surface; (N,) uint8, the `Thing` that is nearest.
    """
    world = (np.asarray(points, np.float64) - scene.translation) @ scene.rotation
    nearest = np.full(len(world), np.inf)
    things = np.zeros(len(world), np.uint8)
    for shape in scene.shapes:
        distance = np.abs(shape.distance(world))
        closer = distance < nearest
        nearest[closer], things[closer] = distance[closer], shape.thing
    return nearest, things


def measure_calibration(scene: Scene, rig: Rig) -> dict[str, float]:
    """How far a calibrated rig is from the true one.

    Returns:
        baseline_percent, rotation_degrees: errors of the pose between the cameras.
        rms_px, largest_px: how far points of the working volume, on a grid over what both cameras see from 400 to
            1000 mm, are projected from where they truly appear, over both pictures. The rig may move rigidly
            before that, both cameras together: boards held freely do not fix its frame, and no model changes by it.
        vertical_px: how far apart in y such points lie in pictures that are rectified with the calibrated rig,
            rms over the grid.
        depth_percent: error of their depth when triangulated with the calibrated rig from where they truly
            appear, median over the grid.

    Raises:
        InputError: the rig is not in millimetres or is for pictures of another size.
    """
    true = scene.rig
    if rig.unit != "mm" or rig.left.size != true.left.size:
        raise InputError(
            f"the rig is for {rig.left.size[0]}x{rig.left.size[1]} px in {rig.unit!r}: the scene needs"
            f" {true.left.size[0]}x{true.left.size[1]} px in 'mm'"
        )
    points = _working_volume(true)
    there = _appear(true, points)
    off = np.linalg.norm(_best_frame(rig, points, there), axis=1)
    turned = cv2.Rodrigues(rig.R @ true.R.T)[0]
    rotations, matrices = _rectification(rig)
    levelled = [
        # tighter than OpenCV's five steps, which leave 0.001 px
        cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, R=turn, P=matrix, criteria=CLOSE)[:, 0]
        for pixels, camera, turn, matrix in zip(there, (rig.left, rig.right), rotations, matrices, strict=True)
    ]
    measured = -matrices[1][0, 3] / (levelled[0][:, 0] - levelled[1][:, 0])
    depth = (points @ rotations[0].T)[:, 2]
    return {
        "baseline_percent": 100 * abs(rig.baseline / true.baseline - 1),
        "rotation_degrees": float(np.rad2deg(np.linalg.norm(turned))),
        "rms_px": float(np.sqrt(np.mean(off**2))),
        "largest_px": float(off.max()),
        "vertical_px": float(np.sqrt(np.mean((levelled[0][:, 1] - levelled[1][:, 1]) ** 2))),
        "depth_percent": float(100 * np.median(np.abs(measured / depth - 1))),
    }


def measure_surface(
    scene: Scene,
    pair: RectifiedPair,
    points: NDArray[np.floating],
    *,
    reference: str = "right",
    vertices: NDArray[np.floating] | None = None,
) -> dict[str, float]:
    """How far a reconstruction is from the true surface, over the cube and the bear where both cameras see them.

    Args:
        scene: the scene.
        pair: the rectified pair that was matched.
        points: (H, W, 3) mm, frame of the rectified left camera, NaN where there is none.
        reference: the view that they are laid out on.
        vertices: (N, 3) of a mesh, or points on it, same frame.

    Returns:
        coverage: share of those pixels that have a point.
        depth_median_percent, depth_p95_percent: error of their depth.
        surface_median_mm: distance to the nearest true surface.
        mesh_median_mm, mesh_p95_mm: the same for `vertices`, if given.

    Raises:
        InputError: points and pair differ in size, or the pair does not show the scene.
    """
    if points.shape != (*pair.left.shape[:2], 3):
        raise InputError(f"points have shape {points.shape}: they must be {(*pair.left.shape[:2], 3)}")
    known = truth(scene, pair, reference)
    objects = known.objects
    if not objects.any():
        raise InputError("the pair shows none of the scene's objects: rectify the pair of this scene")
    found = objects & np.isfinite(points).all(axis=-1)
    figures = {"coverage": float(found.sum() / objects.sum())}
    if found.any():
        off = 100 * np.abs(points[found][:, 2].astype(np.float64) / known.depth[found] - 1)
        # rows times a rotation turn by its inverse: rectified frame to raw left camera
        distance, _ = surface_distance(scene, points[found].astype(np.float64) @ pair.rotation_left)
        figures["depth_median_percent"] = float(np.median(off))
        figures["depth_p95_percent"] = float(np.percentile(off, 95))
        figures["surface_median_mm"] = float(np.median(distance))
    if vertices is not None and len(vertices):
        distance, _ = surface_distance(scene, np.asarray(vertices, np.float64) @ pair.rotation_left)
        figures["mesh_median_mm"] = float(np.median(distance))
        figures["mesh_p95_mm"] = float(np.percentile(distance, 95))
    return figures


def _view(reference: str) -> View:
    try:
        return View(reference)
    except ValueError:
        raise InputError(f"reference is {reference!r}: it must be 'left' or 'right'") from None


def _working_volume(rig: Rig) -> Doubles:
    """Points (N, 3) that both cameras see, on a grid over the left picture and the working distances."""
    width, height = rig.left.size
    columns, rows, distances = GRID
    x, y = np.meshgrid(np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows))
    rays = undistort(rig.left, np.stack([x.ravel(), y.ravel()], axis=1))
    rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    points = np.concatenate([rays * z for z in np.linspace(NEAREST, FARTHEST, distances)])
    seen = _appear(rig, points)[1]
    return points[((seen >= 0) & (seen <= np.array(rig.right.size) - 1)).all(axis=1)]


def _appear(rig: Rig, points: Doubles) -> tuple[Doubles, Doubles]:
    """Where points (N, 3) appear in the raw pictures, left and right (N, 2)."""
    return project(rig.left, points), project(rig.right, points @ rig.R.T + rig.T)


def _best_frame(rig: Rig, points: Doubles, pixels: tuple[Doubles, Doubles]) -> Doubles:
    """What is left (2 N, 2), px, between points as a rig projects them and as they appear, its frame free.

    Gauss and Newton on the six numbers of a rigid motion.
    """

    def residual(motion: Doubles) -> Doubles:
        turned = points @ np.asarray(cv2.Rodrigues(motion[:3])[0]).T + motion[3:]
        return np.concatenate(_appear(rig, turned)) - np.concatenate(pixels)

    motion = np.zeros(6)
    step = np.array([1e-6] * 3 + [1e-3] * 3)  # rad, mm
    for _ in range(4):
        now = residual(motion)
        slopes = [(residual(motion + step * unit) - now).ravel() / (step @ unit) for unit in np.eye(6)]
        motion = motion - np.linalg.lstsq(np.stack(slopes, axis=1), now.ravel(), rcond=None)[0]
    return residual(motion)


def _rectification(rig: Rig) -> tuple[tuple[Doubles, Doubles], tuple[Doubles, Doubles]]:
    """Rotations and projections of the rectified cameras, left and right."""
    left, right = rig.left, rig.right
    lenses = (left.matrix, left.distortion, right.matrix, right.distortion)
    # OpenCV 5 takes T as a column only
    plan = cv2.stereoRectify(*lenses, left.size, rig.R, rig.T[:, None], flags=cv2.CALIB_ZERO_DISPARITY, alpha=-1)
    return (plan[0], plan[1]), (plan[2], plan[3])
