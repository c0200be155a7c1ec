"""Pictures of meshes, drawn by kernels where no OpenGL can be assumed.

The camera orbits the middle of the model; without yaw and pitch it stands where the rectified cameras do.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from stereo_gpu.backends import Backend, open_backend
from stereo_gpu.drawing.orbit import Orbit, frame, spread
from stereo_gpu.drawing.raster import Paint, place_on_screen, rasterise, shade, shrink_by_halves
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.types import Bytes, Doubles, Floats, Ints, Mesh, Surface

Colour = tuple[int, int, int]
BACKGROUND: Colour = (233, 236, 240)
LARGEST_SIDE = 16_384  # samples: the kernels count them in 32 bits

_CLAY = np.array([196.0, 192.0, 184.0])
_INK: Colour = (34, 58, 94)
_LIGHT = np.array([-0.35, -0.45, -0.82])  # towards the light: a lamp above the camera's left shoulder
_STEPS = 256  # of light
_AWAY = 1.5  # sizes of a model that a camera is put from its middle


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
    device: Backend | None = None,
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
        device: where to draw; None takes the best one.

    Raises:
        StageError: the model has no face to draw.
        InputError: a size below 1 or too large, an unknown shading, or texture asked of a Surface.
        BackendError: the device is missing, too small or fails.
    """
    renderer = Renderer(
        model, size=size, shading=shading, background=background, supersample=supersample, device=device
    )
    return renderer.draw(renderer.cameras([(yaw, pitch)])[0])


class Renderer:
    """Draws one model from many sides; what stays the same stays on the device. Arguments are those of `render`."""

    def __init__(
        self,
        model: Mesh | Surface,
        *,
        size: tuple[int, int] = (640, 480),
        shading: Shading | str | None = None,
        background: Colour = BACKGROUND,
        supersample: int = 2,
        device: Backend | None = None,
    ) -> None:
        self._shading = _shading(model, shading)
        check_size(size, supersample)
        vertices = model.vertices.astype(np.float64)
        self._drawable = np.isfinite(vertices).all(axis=1) & (vertices[:, 2] > 0)
        faces = model.faces
        if not self._drawable.all():
            faces = faces[np.all(self._drawable[faces], axis=1)]
            vertices = np.where(self._drawable[:, None], vertices, 0.0)
        if not len(faces):
            raise StageError(f"none of {len(model.faces)} faces can be drawn: mesh a larger part of the disparity")
        self._inner = (size[0] * supersample, size[1] * supersample)
        self._samples = supersample
        self._vertices, self._spread = vertices, spread(vertices, faces)
        self._device = open_backend() if device is None else device
        samples = self._inner[0] * self._inner[1]
        # Depths and triangles of the samples, the picture, and as much again as the model.
        needed = 8 * samples + 3 * size[0] * size[1] + 24 * len(faces) + 40 * len(vertices)
        self._device.check_memory(needed, 4 * samples, "draw a smaller picture")
        self._faces = self._device.upload(np.ascontiguousarray(faces, np.int32))
        textured = isinstance(model, Mesh) and self._shading is Shading.TEXTURE
        self._normals = None if textured else _normals(vertices, faces)
        self._uv = self._device.upload(model.uv.astype(np.float32)) if isinstance(model, Mesh) and textured else None
        texture = model.texture if isinstance(model, Mesh) and textured else _light_and_shadow()
        texels, levels = shrink_by_halves(texture)
        self._paint = Paint(
            texture=self._device.upload(texels),
            size=(texture.shape[1], texture.shape[0]),
            levels=levels if textured else 1,
            behind=0.0 if textured else 0.5,
            wire=float(supersample) if self._shading is Shading.WIRE else 0.0,
            colours=self._device.upload(np.array([background, _INK], np.uint8)),
        )

    def cameras(self, views: Sequence[tuple[float, float]]) -> list[Orbit]:
        """Cameras at (yaw, pitch), degrees, framed alike so that the model keeps its size from one to the next."""
        return frame(self._spread, self._inner, views)

    def draw(self, camera: Orbit) -> Bytes:
        """What a camera sees, (height, width, 3) uint8 RGB."""
        device = self._device
        screen, depth = camera.see(self._vertices)
        held = device.upload(place_on_screen(screen, np.where(self._drawable, depth, 0.0)))
        uv = self._uv
        if self._normals is not None:
            uv = device.upload(_lit(self._normals @ camera.rotation.T))
        assert uv is not None
        owner = rasterise(device, held, self._faces, self._inner)
        picture = shade(device, owner, held, self._faces, uv, self._paint, self._samples)
        return np.asarray(device.download(picture), np.uint8)


def bring_in_front(mesh: Mesh) -> Mesh:
    """A model of another program, which may stand anywhere, where a camera sees all of it; ours stay where they are."""
    finite = np.isfinite(mesh.vertices).all(axis=1)
    places = mesh.vertices[finite]
    if not len(places) or places[:, 2].min() > 0:
        return mesh
    low, high = places.min(axis=0).astype(np.float64), places.max(axis=0).astype(np.float64)
    distance = _AWAY * max(float(np.linalg.norm(high - low)), 1e-9)
    moved = mesh.vertices - (low + high) / 2 + np.array([0.0, 0.0, distance])
    return dataclasses.replace(mesh, vertices=moved.astype(np.float32))


def _shading(model: Mesh | Surface, shading: Shading | str | None) -> Shading:
    if shading is None:
        return Shading.TEXTURE if isinstance(model, Mesh) else Shading.PLAIN
    if shading not in list(Shading):
        raise InputError(f"shading '{shading}' is unknown: choose {', '.join(Shading)}")
    if shading == Shading.TEXTURE and not isinstance(model, Mesh):
        raise InputError("shading 'texture' needs a Mesh, a Surface has none: choose plain or wire")
    return Shading(shading)


def check_size(size: tuple[int, int], supersample: int) -> None:
    """Refuse a picture that cannot be drawn.

    Raises:
        InputError: a side is below 1 or too large.
    """
    if min(size) < 1 or supersample < 1:
        raise InputError(f"size {size} with {supersample} samples a pixel: each must be at least 1")
    if max(size) * supersample > LARGEST_SIDE:
        most = LARGEST_SIDE // supersample
        raise InputError(f"size {size} with {supersample} samples a pixel: draw no side of more than {most} px")


def _normals(vertices: Doubles, faces: Ints) -> Floats:
    """(N, 3) unit normals of the vertices, towards the front, weighted by the area of the faces."""
    # In the order of the columns, since a (M, 3) cross product in numpy costs four times as much.
    columns = np.ascontiguousarray(vertices.T)
    corners = np.ascontiguousarray(faces.T)
    a, b, c = (columns[:, corner] for corner in corners)
    px, py, pz = b - a
    qx, qy, qz = c - a
    across = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    count = len(vertices)
    summed = np.stack([sum(np.bincount(corner, part, count) for corner in corners) for part in across], axis=1)
    length = np.sqrt(np.einsum("nk,nk->n", summed, summed))
    return np.asarray(summed / np.maximum(length, 1e-30)[:, None], np.float32)


def _lit(normals: Doubles | Floats) -> Floats:
    """Where in `_light_and_shadow` vertices with these normals, in the camera's frame, lie, (N, 2)."""
    towards = np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), -1, 1)
    along = ((towards + 1) / 2 * (_STEPS - 1) + 0.5) / _STEPS
    return np.asarray(np.column_stack([along, np.full(len(along), 0.25)]), np.float32)


def _light_and_shadow() -> Bytes:
    """Clay under a lamp, (4, STEPS, 3), from light that comes from behind to light that falls on it.

    The upper half is a surface's front, the lower half its back, which is darker.
    """
    towards = np.linspace(-1, 1, _STEPS)
    front = 0.3 + 0.75 * np.maximum(towards, 0.0)
    back = 0.25 + 0.25 * np.abs(towards)
    light = np.stack([front, front, back, back])
    return np.round(np.clip(_CLAY * light[..., None] * 1.15, 0, 255)).astype(np.uint8)
