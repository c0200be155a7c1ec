"""How far meshes are from the truth, step by step: dense, bounded, smoothed, decimated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend
from stereo_gpu.decimate import decimate
from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.pairs import TruePair
from stereo_gpu.fairing import fair
from stereo_gpu.mesh import build_mesh
from stereo_gpu.meshing.height_map import height_map
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.result import Reconstruction
from stereo_gpu.scene import Scene
from stereo_gpu.scene_truth import surface_distance, truth
from stereo_gpu.types import Doubles, RectifiedPair, Surface, View

FEW = 20_000  # triangles
DENSE, BOUNDED, SMOOTHED, DECIMATED = "dense", "bounded", "smoothed", f"decimated to {FEW:,}"
UNSMOOTHED = "decimated without smoothing"


@dataclass(frozen=True, kw_only=True)
class MeshErrors:
    """A mesh against the truth, over the pixels that all the meshes cover.

    Args:
        faces: triangles.
        coverage: share of the pixels with truth that this mesh covers.
        mean, median, p95: of the errors of depth there, mm.
        inliers: mean over the pixels at which the dense mesh is right to a pixel, mm.
        nearest: mean distance to the nearest true surface, mm; None where only a map of it is known.
    """

    faces: int
    coverage: float
    mean: float
    median: float
    p95: float
    inliers: float
    nearest: float | None = None


def mesh_steps(device: Backend, result: Reconstruction) -> dict[str, Surface]:
    """The meshes of a reconstruction's map by their names: each step does what the pipeline does by default."""
    frame, pair = frame_of(result.pair, result.disparity.reference), result.pair
    steps = {
        method: build_mesh(
            result.disparity.values,
            result.points,
            device=device,
            method=method,
            centre=frame.centre,
            infinity_px=pair.cx_left - pair.cx_right,
        )
        for method in (DENSE, BOUNDED)
    }
    steps[SMOOTHED] = fair(steps[BOUNDED], frame)
    steps[DECIMATED] = decimate(steps[SMOOTHED], FEW, frame)
    steps[UNSMOOTHED] = decimate(steps[BOUNDED], FEW, frame)
    return steps


def frame_of(pair: RectifiedPair, view: View) -> ViewFrame:
    """Of one of a pair's views."""
    return ViewFrame(pair.focal_px, pair.baseline, (pair.baseline if view is View.RIGHT else 0.0, 0.0, 0.0))


def depth_map(surface: Surface, pair: RectifiedPair, view: View) -> Doubles:
    """(H, W): depth of a mesh at each pixel of a view, in the pair's unit; NaN where it shows no triangle."""
    corners = frame_of(pair, view).see(surface.vertices)
    corners[:, :2] += (pair.cx_right if view is View.RIGHT else pair.cx_left, pair.cy)
    height, width = pair.left.shape[:2]
    return pair.focal_px * pair.baseline / height_map(corners, surface.faces, (width, height))


def measure_on_pair(steps: Mapping[str, Surface], pair: RectifiedPair, known: TruePair) -> dict[str, MeshErrors]:
    """Meshes of the left view against a benchmark's truth, whose camera is known."""
    if known.depth is None:
        raise InputError(f"pair {known.name!r} has no depth, since its camera is not known: take motorcycle")
    maps = {name: depth_map(surface, pair, View.LEFT) for name, surface in steps.items()}
    return _errors(steps, maps, known.depth(known.truth), pair)


def measure_on_scene(steps: Mapping[str, Surface], result: Reconstruction, scene: Scene) -> dict[str, MeshErrors]:
    """Meshes of the built-in scene, over what both cameras see of it."""
    pair, view = result.pair, result.disparity.reference
    there = truth(scene, pair, view)
    depth = np.where(there.shared & np.isfinite(there.depth), there.depth, np.nan)
    maps = {name: depth_map(surface, pair, view) for name, surface in steps.items()}
    return _errors(steps, maps, depth, pair, (scene, view))


def _errors(
    steps: Mapping[str, Surface],
    maps: Mapping[str, Doubles],
    true: Doubles,
    pair: RectifiedPair,
    scene: tuple[Scene, View] | None = None,
) -> dict[str, MeshErrors]:
    known = np.isfinite(true)
    everywhere = known & np.all([np.isfinite(found) for found in maps.values()], axis=0)
    in_px = pair.focal_px * pair.baseline * np.abs(1 / maps[DENSE][everywhere] - 1 / true[everywhere])
    errors = {}
    for name, found in maps.items():
        off = np.abs(found - true)[everywhere]
        errors[name] = MeshErrors(
            faces=len(steps[name].faces),
            coverage=float(np.isfinite(found)[known].mean()),
            mean=float(off.mean()),
            median=float(np.median(off)),
            p95=float(np.percentile(off, 95)),
            inliers=float(off[in_px < 1].mean()),
            nearest=_nearest(found, everywhere, pair, *scene) if scene else None,
        )
    return errors


def _nearest(depth: Doubles, where: NDArray[np.bool_], pair: RectifiedPair, scene: Scene, view: View) -> float:
    """Mean distance of a map's points to the scene's surface, mm."""
    y, x = np.nonzero(where)
    z = depth[where]
    cx = pair.cx_right if view is View.RIGHT else pair.cx_left
    away = pair.focal_px * pair.baseline / z
    points = frame_of(pair, view).place(np.column_stack([x - cx, y - pair.cy, away]))
    # rows times a rotation turn by its inverse: rectified frame to raw left camera
    return float(surface_distance(scene, points.astype(np.float64) @ pair.rotation_left)[0].mean())
