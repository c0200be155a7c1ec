"""Fewer triangles with the same shape: quadric edge collapse, measured as the cameras measured."""

from __future__ import annotations

import threading

import numpy as np

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.mesh import compact
from stereo_gpu.types import Doubles, Ints, Surface

# fast_simplification keeps its mesh in global variables: one call at a time in a process.
_ONE_AT_A_TIME = threading.Lock()
# How soon the threshold on the error grows. At its default of 7 collapses are less well ordered, and twice as
# many triangles flip over.
_AGGRESSION = 5.0


def decimate(
    surface: Surface,
    target_faces: int,
    *,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    relief: float = 0.1,
) -> Surface:
    """Collapse edges until about `target_faces` triangles are left (Garland and Heckbert, 1997).

    The error of a collapse is not measured in millimetres but in (X / Z, Y / Z, relief * median Z / Z), where
    planes are planes still and the noise of a disparity is the same in all directions and at all depths. In
    millimetres the noise of depth, tens of times that across, would be taken for shape: on Middlebury's
    Motorcycle 40 times as many triangles by area turned their backs to the camera and 46 edges got a third
    triangle; here none did. Of those that do turn or shrink to nothing, each is dropped.

    Args:
        surface: the mesh, every vertex before the camera.
        target_faces: how many triangles to keep; a mesh with no more than that is returned as it is.
        centre: where the reference view's camera stands: (baseline, 0, 0) for the right view.
        relief: weight of depth against the directions across; baseline over distance makes a pixel of
            disparity count like a pixel across, and 0.05 to 0.3 give much the same mesh.

    Raises:
        InputError: `target_faces` is under 1, or `relief` is not above 0.
        StageError: a vertex lies behind the camera, or no triangle is left.
    """
    if target_faces < 1:
        raise InputError(f"target_faces is {target_faces}: pass 1 or more")
    if not relief > 0:
        raise InputError(f"relief is {relief}: pass a number above 0, about baseline over distance")
    if len(surface.faces) <= target_faces:
        return surface
    eye = np.asarray(centre, np.float64)
    seen = surface.vertices.astype(np.float64) - eye
    if not (np.isfinite(seen).all() and (seen[:, 2] > 0).all()):
        raise StageError("cannot decimate: a vertex is not finite or not before the camera; build the mesh again")
    median = float(np.median(seen[:, 2]))
    measured = _project(seen, relief * median)
    low, high = measured.min(axis=0), measured.max(axis=0)
    # The thresholds of the collapse are absolute numbers, made for a mesh about as large as 1.
    size = float((high - low).max())
    kept, faces = _collapse((measured - low) / size, surface.faces, target_faces)
    # A corner may be put where its planes meet, which for nearly parallel ones can be anywhere.
    kept = np.clip(kept * size + low, low, high)
    faces = faces[_turned_to_camera(kept, faces)]
    if not len(faces):
        raise StageError(f"nothing is left of {len(surface.faces)} triangles at {target_faces}; ask for more")
    depth = relief * median / kept[:, 2:]
    return compact(np.concatenate([kept[:, :2] * depth, depth], axis=1) + eye, faces)


def _project(vertices: Doubles, weight: float) -> Doubles:
    depth = vertices[:, 2:]
    return np.concatenate([vertices[:, :2] / depth, weight / depth], axis=1)


def _collapse(vertices: Doubles, faces: Ints, target_faces: int) -> tuple[Doubles, Ints]:
    import fast_simplification

    with _ONE_AT_A_TIME:
        kept, left = fast_simplification.simplify(vertices, faces, target_count=target_faces, agg=_AGGRESSION)
    return np.asarray(kept, np.float64), np.asarray(left, np.int32)


def _turned_to_camera(projected: Doubles, faces: Ints) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """(M,): faces that are still counter-clockwise on the picture and cover some of it."""
    a, b, c = (projected[faces[:, i], :2] for i in range(3))
    p, q = b - a, c - a
    area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    # With y down, counter-clockwise is negative. What is a millionth of the usual triangle is a line.
    return np.asarray(area < -1e-6 * np.median(np.abs(area)) if len(area) else np.zeros(0, bool))
