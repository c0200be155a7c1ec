"""Pictures of meshes and point clouds, drawn in software: for the report, where no OpenGL can be assumed.

The camera orbits the middle of the model; without yaw and pitch it stands where the rectified cameras do.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.orbit import orbit, spread
from stereo_gpu.raster import Fragments, rasterise
from stereo_gpu.types import Bytes, Doubles, Floats, Ints, Mesh, Surface

Colour = tuple[int, int, int]
BACKGROUND: Colour = (233, 236, 240)

_CLAY = np.array([196.0, 192.0, 184.0])
_INK = np.array([34.0, 58.0, 94.0])
_LIGHT = np.array([-0.35, -0.45, -0.82])  # towards the light: a lamp above the camera's left shoulder


class Shading(StrEnum):
    """How a surface is painted."""

    TEXTURE = "texture"
    PLAIN = "plain"
    WIRE = "wire"  # plain, with the edges of the triangles


def render(
    model: Mesh | Surface,
    *,
    size: tuple[int, int] = (640, 480),
    yaw: float = 0.0,
    pitch: float = 0.0,
    shading: Shading | str | None = None,
    background: Colour = BACKGROUND,
    supersample: int = 2,
) -> Bytes:
    """Draw a mesh, (height, width, 3) uint8 RGB.

    Args:
        model: a textured mesh, or a bare surface; a face with a vertex that is not finite or not in front of
            the rectified cameras is left out.
        size: (width, height) in px.
        yaw: degrees that the camera walks to its right around the model.
        pitch: degrees that it rises above the model.
        shading: texture, plain or wire; None is texture for a Mesh and plain for a Surface.
        background: colour where there is no model.
        supersample: samples a pixel in either direction, against jagged edges.

    Raises:
        StageError: the model has no face to draw.
        InputError: a size below 1, an unknown shading, or texture asked of a Surface.
    """
    shading = _shading(model, shading)
    _check(size, supersample)
    vertices = model.vertices.astype(np.float64)
    drawable = np.isfinite(vertices).all(axis=1) & (vertices[:, 2] > 0)
    faces = model.faces[np.all(drawable[model.faces], axis=1)]
    if not len(faces):
        raise StageError(f"none of {len(model.faces)} faces can be drawn: mesh a larger part of the disparity")
    inner = (size[0] * supersample, size[1] * supersample)
    camera = orbit(spread(vertices, faces), inner, yaw=yaw, pitch=pitch)
    screen, depth = camera.see(np.where(drawable[:, None], vertices, 0.0))
    faces = faces[(depth[faces] > 0).all(axis=1)]
    fragments = rasterise(screen, depth, faces, inner)
    if isinstance(model, Mesh) and shading is Shading.TEXTURE:
        colours = _textured(model, faces, fragments)
    else:
        colours = _lit(camera.turn(vertices), faces, fragments)
        if shading is Shading.WIRE:
            colours = _wired(colours, fragments, float(supersample))
    return _paint(inner, fragments.pixels, colours, background, size)


def render_points(
    points: Floats,
    colours: Bytes,
    *,
    size: tuple[int, int] = (640, 480),
    yaw: float = 0.0,
    pitch: float = 0.0,
    background: Colour = BACKGROUND,
    supersample: int = 2,
) -> Bytes:
    """Draw a point cloud, (height, width, 3) uint8 RGB.

    Args:
        points: (N, 3) or (H, W, 3); points that are not finite are left out.
        colours: uint8 RGB of the same shape.
        size: (width, height) in px.
        yaw: degrees that the camera walks to its right around the points.
        pitch: degrees that it rises above them.
        background: colour where there is no point.
        supersample: samples a pixel in either direction.

    Raises:
        StageError: no point is finite and in front of the camera.
        InputError: a size below 1, or points and colours of unequal shape.
    """
    _check(size, supersample)
    if points.shape != colours.shape:
        raise InputError(f"points {points.shape} and colours {colours.shape} differ: give one colour a point")
    places, paints = points.reshape(-1, 3).astype(np.float64), colours.reshape(-1, 3)
    good = np.isfinite(places).all(axis=1) & (places[:, 2] > 0)
    places, paints = places[good], paints[good]
    if not len(places):
        raise StageError(f"none of {len(good)} points is finite and in front of the camera")
    inner = (size[0] * supersample, size[1] * supersample)
    camera = orbit(places[:: max(1, len(places) // 20_000)], inner, yaw=yaw, pitch=pitch)
    screen, depth = camera.see(places)
    # Dots as large as the points lie apart, so that the cloud is dense but still seen to be points.
    apart = (0.8 * inner[0] * inner[1] / len(places)) ** 0.5
    dot = int(np.clip(np.ceil(apart), supersample, 4 * supersample))
    nothing = np.uint64(0xFFFF_FFFF_FFFF_FFFF)
    nearest = np.full(inner[0] * inner[1], nothing, np.uint64)
    ranks = (depth.astype(np.float32).view(np.uint32)).astype(np.uint64) << np.uint64(32)
    keys = ranks | np.arange(len(places), dtype=np.uint64)
    corner = np.round(screen - (dot - 1) / 2).clip(-dot, max(inner)).astype(np.int64)
    for step in range(dot * dot):
        x, y = corner[:, 0] + step % dot, corner[:, 1] + step // dot
        on = (depth > 0) & (x >= 0) & (y >= 0) & (x < inner[0]) & (y < inner[1])
        np.minimum.at(nearest, y[on] * inner[0] + x[on], keys[on])
    pixels = np.flatnonzero(nearest != nothing)
    shown = paints[(nearest[pixels] & np.uint64(0xFFFF_FFFF)).astype(np.int64)]
    return _paint(inner, pixels, shown, background, size)


def _shading(model: Mesh | Surface, shading: Shading | str | None) -> Shading:
    if shading is None:
        return Shading.TEXTURE if isinstance(model, Mesh) else Shading.PLAIN
    if shading not in list(Shading):
        raise InputError(f"shading '{shading}' is unknown: choose {', '.join(Shading)}")
    if shading == Shading.TEXTURE and not isinstance(model, Mesh):
        raise InputError("shading 'texture' needs a Mesh, a Surface has none: choose plain or wire")
    return Shading(shading)


def _check(size: tuple[int, int], supersample: int) -> None:
    if min(size) < 1 or supersample < 1:
        raise InputError(f"size {size} with {supersample} samples a pixel: each must be at least 1")


def _textured(mesh: Mesh, faces: Ints, fragments: Fragments) -> NDArray[Any]:
    """Texture colours of the fragments, (P, 3), bilinear."""
    corners = faces[fragments.triangles]
    uv = np.einsum("pi,pik->pk", fragments.weights, mesh.uv[corners].astype(np.float64))
    height, width = mesh.texture.shape[:2]
    where = (uv * (width, height) - 0.5).astype(np.float32)
    # remap takes at most 32,767 rows, so the fragments go through it as a table of 1,024 columns.
    rows = max(1, -(-len(where) // 1024))
    table = np.zeros((rows * 1024, 2), np.float32)
    table[: len(where)] = where
    x, y = table[:, 0].reshape(rows, 1024), table[:, 1].reshape(rows, 1024)
    picked = cv2.remap(mesh.texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(picked).reshape(-1, 3)[: len(where)]


def _lit(vertices: Doubles, faces: Ints, fragments: Fragments) -> NDArray[Any]:
    """Clay under a lamp, (P, 3): vertex normals weighted by area, a face seen from behind is darker."""
    corner = vertices[faces[:, 0]]
    across = np.cross(vertices[faces[:, 1]] - corner, vertices[faces[:, 2]] - corner)
    normals = np.zeros_like(vertices)
    for axis in range(3):
        for column in faces.T:
            normals[:, axis] += np.bincount(column, across[:, axis], len(vertices))
    smooth = np.einsum("pi,pik->pk", fragments.weights, normals[faces[fragments.triangles]])
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-12)
    towards = smooth @ (_LIGHT / np.linalg.norm(_LIGHT))
    behind = (np.einsum("mk,mk->m", across, corner) > 0)[fragments.triangles]
    light = np.where(behind, 0.25 + 0.25 * np.abs(towards), 0.3 + 0.75 * np.maximum(towards, 0.0))
    lit: NDArray[Any] = np.clip(_CLAY * light[:, None] * 1.15, 0, 255)
    return lit


def _wired(colours: NDArray[Any], fragments: Fragments, width_px: float) -> NDArray[Any]:
    """Ink the edges; thinly where the triangles are small, or they would vanish under their own edges."""
    ink = np.clip(width_px * 0.4 + 0.5 - fragments.edge_px, 0, 1)
    ink = (ink * np.clip(fragments.height_px / (10 * width_px), 0.12, 0.8))[:, None]
    wired: NDArray[Any] = colours * (1 - ink) + _INK * ink
    return wired


def _paint(
    inner: tuple[int, int],
    pixels: NDArray[np.int64],
    colours: NDArray[Any],
    background: Colour,
    size: tuple[int, int],
) -> Bytes:
    """Put coloured samples on the background and average them down to the picture's size."""
    canvas = np.empty((inner[1] * inner[0], 3), np.uint8)
    canvas[:] = background
    canvas[pixels] = np.round(colours).astype(np.uint8)
    sampled = canvas.reshape(inner[1], inner[0], 3)
    if inner == size:
        return sampled
    return np.asarray(cv2.resize(sampled, size, interpolation=cv2.INTER_AREA), np.uint8)
