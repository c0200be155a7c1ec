"""Bake a picture into the texture atlas of an unwrapped mesh."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.types import Bytes, Doubles, Floats, RectifiedPair, View
from stereo_gpu.unwrap import Unwrapped

Light = NDArray[np.uint16]

# By how much of what the model lacks of the picture the texture is corrected, in turn. Each sampling of a texture blurs
# what lies between its texels; two corrections of 1.5 gain more than three of 1, since it is never blurred by less.
_CORRECTIONS = (1.5, 1.5)
# Texels around a chart that are baked too: bilinear samples on its border take them in.
_REACH = 1.0
_NOTHING_MISSING = 32768.0  # residual's own zero


def project(vertices: Floats, pair: RectifiedPair, view: View) -> Doubles:
    """Where a rectified camera sees points of the rectified left frame.

    Args:
        vertices: (N, 3), in the pair's unit.
        pair: for its geometry.
        view: which camera.

    Returns:
        (N, 3) float64: column and row in px, and depth in the pair's unit.
    """
    x, y, z = vertices.astype(np.float64).T
    shift, cx = (pair.baseline, pair.cx_right) if view is View.RIGHT else (0.0, pair.cx_left)
    return np.column_stack([pair.focal_px * (x - shift) / z + cx, pair.focal_px * y / z + pair.cy, z])


def bake_texture(
    backend: Backend, picture: DeviceArray, scale: float, unwrapped: Unwrapped, pair: RectifiedPair, view: View
) -> Bytes:
    """Resample a rectified picture into the atlas, in linear light.

    The texture is what gives the picture back when the model is drawn from its camera: first the picture is sampled by a
    cubic, then what the model, sampled bilinearly as a viewer does, lacks of the picture is sampled likewise and added
    (back-projection: Irani and Peleg, "Improving Resolution by Image Registration", 1991, section 3). Texels beside the
    charts show what the picture shows there; all others take the colours of charts nearby, so that no level of a mip
    map has an edge of the atlas' background in it.

    Args:
        backend: the device that holds the picture.
        picture: the rectified picture of `view`, (H, W) or (H, W, 3).
        scale: factor that takes its values to 0..255.
        unwrapped: the mesh with its texture coordinates.
        pair: for its geometry.
        view: which of the two pictures it is.

    Returns:
        (S, T, 3) uint8 RGB, row 0 at the top.
    """
    size = width, height = unwrapped.size
    seen = project(unwrapped.vertices, pair, view)
    texels = unwrapped.uv * np.array(size)
    corners = np.concatenate([texels, seen], axis=1).astype(np.float32)[unwrapped.faces]
    light, cell = _shrunk(backend, _decoded(backend, picture, scale), _pixels_per_texel(corners))
    places = _places(backend, corners, _REACH, 2 * cell, size)
    texture = backend.zeros((height, width, 4), np.uint16)
    onto = {"places": places, "width": light.shape[1], "height": light.shape[0], "cell": cell}
    onto |= {"texture_width": width, "texture_height": height, "texture_out": texture}
    backend.launch("bake", light=light, bias=0.0, gain=1.0, **onto)
    if cell == 1:
        rows, columns = light.shape[:2]
        back = np.column_stack([seen[:, :2] + 0.5, texels - 0.5, 1 / seen[:, 2]]).astype(np.float32)[unwrapped.faces]
        shown = {"light": light, "texture": texture, "places": _places(backend, back, 0.0, 2.0, (columns, rows))}
        shown |= {"texture_width": width, "texture_height": height, "width": columns, "height": rows}
        missing = backend.empty(light.shape, np.uint16)
        for share in _CORRECTIONS:
            backend.launch("residual", **shown, residual_out=missing)
            # A residual counts twice, see its kernel.
            backend.launch("bake", light=missing, bias=_NOTHING_MISSING, gain=2 * share, **onto)
    _fill(backend, texture)
    return _encoded(backend, texture)


def _places(backend: Backend, corners: Floats, reach: float, margin: float, size: tuple[int, int]) -> DeviceArray:
    """(2, T, S) float32: where in the other picture the texels lie, those up to `reach` beside the mesh too."""
    atlas = {"texture_width": size[0], "texture_height": size[1]}
    held, owner = backend.upload(corners), backend.zeros((size[1], size[0]), np.int32)
    backend.launch("cover", corners=held, triangles=len(corners), reach=reach, **atlas, owner_out=owner)
    places = backend.empty((2, size[1], size[0]), np.float32)
    backend.launch("place", corners=held, owner=owner, margin=margin, **atlas, place_out=places)
    return places


def _decoded(backend: Backend, picture: DeviceArray, scale: float) -> DeviceArray:
    """(H, W, 4) uint16 linear light."""
    height, width = picture.shape[:2]
    light = backend.empty((height, width, 4), np.uint16)
    backend.launch(
        "decode",
        picture=picture,
        table=backend.upload(_light_of_levels(int(np.iinfo(picture.dtype).max), scale)),
        width=width,
        height=height,
        channels=1 if len(picture.shape) == 2 else picture.shape[2],
        light_out=light,
    )
    return light


def _encoded(backend: Backend, light: DeviceArray) -> Bytes:
    height, width = light.shape[:2]
    picture = backend.empty((height, width, 3), np.uint8)
    table = backend.upload(_levels_of_light())
    backend.launch("encode", light=light, table=table, width=width, height=height, picture_out=picture)
    return backend.download(picture)


@lru_cache(maxsize=4)
def _light_of_levels(largest: int, scale: float) -> Light:
    """Light, 0..65535, of the levels 0 to `largest` of a picture (IEC 61966-2-1, sRGB)."""
    level = np.minimum(np.arange(largest + 1) * (scale / 255), 1.0)
    light = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return np.floor(65535 * light + 0.5).astype(np.uint16)


@lru_cache(maxsize=1)
def _levels_of_light() -> Bytes:
    """Levels 0..255 of light 0..65535."""
    light = np.arange(65536) / 65535
    level = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.floor(255 * level + 0.5).astype(np.uint8)


def _pixels_per_texel(corners: Floats) -> float:
    """How many pixels of the picture a texel is wide, on average."""

    def area(place: Floats) -> float:
        first, second = (place[:, k] - place[:, 0] for k in (1, 2))
        return float(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum(dtype=np.float64))

    texels = area(corners[..., :2])
    return float(np.sqrt(area(corners[..., 2:4]) / texels)) if texels else 1.0


def _shrunk(backend: Backend, light: DeviceArray, pixels: float) -> tuple[DeviceArray, float]:
    """Light in cells of 1, 2, 4 ... pixels, about as wide as a texel, so that a coarse atlas averages; and their width."""
    cell = 1.0
    while pixels > 1.5 * cell and max(light.shape[:2]) > 1:
        light, cell = _pulled(backend, light), 2 * cell
    return light, cell


def _fill(backend: Backend, texture: DeviceArray) -> None:
    """Give every texel that has no colour that of the charts nearby, by the means of ever larger squares."""
    levels = [texture]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_pulled(backend, levels[-1]))
    for fine, coarse in zip(levels[-2::-1], levels[:0:-1], strict=True):
        backend.launch(
            "push",
            coarse=coarse,
            coarse_width=coarse.shape[1],
            width=fine.shape[1],
            height=fine.shape[0],
            fine_out=fine,
        )


def _pulled(backend: Backend, fine: DeviceArray) -> DeviceArray:
    height, width = -(-fine.shape[0] // 2), -(-fine.shape[1] // 2)
    coarse = backend.empty((height, width, 4), np.uint16)
    backend.launch(
        "pull",
        fine=fine,
        fine_width=fine.shape[1],
        fine_height=fine.shape[0],
        width=width,
        height=height,
        coarse_out=coarse,
    )
    return coarse
