"""Fewer triangles with the same shape: to a number of them, or as far as the surface may move."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.mesh import compact
from stereo_gpu.meshing.collapse import collapse
from stereo_gpu.meshing.compare_surfaces import compare
from stereo_gpu.meshing.height_map import height_and_owner
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.types import Doubles, Ints, Surface

# Shares of the triangles that are tried for an error; places that move too far are then fixed and the rest is tried
# again, so often.
_SHARES = (1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32)
_ROUNDS = 5
_FIXED_PX = 7  # side of the square around such a place in which triangles are fixed


def decimate(surface: Surface, target_faces: int, frame: ViewFrame, *, error: float | None = None) -> Surface:
    """Collapse edges until about `target_faces` are left, or as long as the surface moves by no more than `error`.

    Quadrics (M. Garland and P. S. Heckbert, "Surface Simplification Using Quadric Error Metrics", SIGGRAPH 1997) are
    taken in columns, rows and disparities of the view, where planes are planes and noise is the same everywhere. In
    millimetres the noise of depth, tens of times that across, would be taken for shape: on Middlebury's Motorcycle 40
    times as many triangles turned their backs to the camera.

    Borders are kept by walls: each border edge gets a triangle down to a point far behind the mesh, whose plane
    counts among the quadrics as the surface's planes do. The walls are taken away afterwards. Then edges are turned
    for rounder triangles, and the few triangles that still lie on others or upside down are dropped.

    With `error` the number of triangles is searched. Afterwards no point that the view sees on either surface, one a
    pixel, is farther than that from the other surface; triangles stay as they are where it would be.

    Args:
        surface: the mesh, every vertex before the camera.
        target_faces: how many triangles to keep at most, where each part of the mesh can do with few; a mesh with no
            more than that is returned as it is. Not used with `error`.
        frame: of the view that sees the surface.
        error: how far the surface may move, in its unit.

    Raises:
        InputError: `target_faces` is under 1, or `error` is not above 0.
        StageError: a vertex lies behind the camera, or no triangle is left.
    """
    if target_faces < 1 and error is None:
        raise InputError(f"target_faces is {target_faces}: pass 1 or more")
    if error is not None and not error > 0:
        raise InputError(f"error is {error}: pass a length above 0, in the unit of the surface")
    if not len(surface.faces) or (error is None and len(surface.faces) <= target_faces):
        return surface
    corners = frame.see(surface.vertices)
    if error is None:
        kept, faces = collapse(corners, surface.faces, target_faces, frame)
        if not len(faces):
            raise StageError(f"nothing is left of {len(surface.faces)} triangles at {target_faces}; ask for more")
        return compact(frame.place(kept), faces)
    kept, faces = _search(corners, surface.faces, error, frame)
    return compact(frame.place(kept), faces) if len(faces) < len(surface.faces) else surface


def _search(corners: Doubles, faces: Ints, error: float, frame: ViewFrame) -> tuple[Doubles, Ints]:
    """Few triangles that stay within `error`: ever fewer where that moves nothing too far, the others fixed."""
    given = best = corners, faces
    fixed = np.zeros(len(faces), bool)
    for share in _SHARES:
        for _ in range(_ROUNDS):
            loose = len(faces) - int(fixed.sum())
            tried = collapse(*given, max(round(loose * share), 1), frame, fixed=fixed)
            too_far = compare(given, tried, frame, enough=error)[1]
            if not len(too_far):
                break
            fixed |= _around(too_far, *given)
        if len(too_far) or len(tried[1]) >= len(best[1]):
            break
        best = tried
    return best


def _around(places: Doubles, corners: Doubles, faces: Ints) -> NDArray[np.bool_]:
    """(M,): faces that show in the squares around places (P, 2), px, or have a corner there."""
    low = np.append(np.floor(np.minimum(corners[:, :2].min(axis=0), places.min(axis=0))), 0.0)
    width, height = (np.maximum(corners[:, :2].max(axis=0), places.max(axis=0)) - low[:2]).astype(int) + 2
    there = np.zeros((height, width), np.uint8)
    x, y = np.rint(places - low[:2]).astype(int).T
    there[y, x] = 1
    there = cv2.dilate(there, np.ones((_FIXED_PX, _FIXED_PX), np.uint8))
    x, y = np.rint(corners - low).astype(int)[:, :2].T
    found = (there[y, x] != 0)[faces].any(axis=1)
    owner = height_and_owner(corners - low, faces, (width, height))[1]
    found[owner[(there != 0) & (owner >= 0)]] = True
    return np.asarray(found)
