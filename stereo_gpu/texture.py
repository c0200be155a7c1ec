"""Bake a picture into the texture atlas of an unwrapped mesh."""

from __future__ import annotations

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.light import decode_light, encode_light, fill_gaps, halve_light
from stereo_gpu.types import Bytes, Doubles, Floats, RectifiedPair, View
from stereo_gpu.unwrap import Unwrapped

# How far beside a chart the picture goes on, texels, and a little more against rounding; where two charts are nearer,
# each has its half. Samples on a border take in a texel more, in the first level of a mip map two, and so on.
_REACH = 4.25
# By how much of what the model lacks of the picture its texture is corrected, in turn. Samples between texels are
# blurred, at the worst to nothing: a correction by more than all of it gains on those that are not blurred so much.
_CORRECTIONS = (1.5, 1.5)
# How far texels may be off the pixels' centres, px, for which nothing needs to be corrected.
_ON_PIXELS = 0.05


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

    The picture is sampled by a cubic, which copies a pixel where a texel meets its centre. Where texels lie between
    pixels, drawing the model samples a second time, and blurs: then what it lacks of the picture, as its camera sees
    it, is sampled likewise and added (back-projection: Irani and Peleg, "Improving Resolution by Image Registration",
    1991, section 3). Texels beside a chart get what the picture shows there. All others get colours of charts nearby,
    so that no level of a mip map mixes the atlas' background in.

    Args:
        backend: the device that holds the picture.
        picture: the rectified picture of `view`, (H, W) or (H, W, 3).
        scale: factor that takes its values to 0..255.
        unwrapped: the mesh with its texture coordinates.
        pair: for its geometry, and where the picture is valid.
        view: which of the two pictures it is.

    Returns:
        (S, T, 3) uint8 RGB, row 0 at the top.
    """
    size = width, height = unwrapped.size
    seen = project(unwrapped.vertices, pair, view)
    texels = unwrapped.uv * np.array(size)
    corners = np.column_stack([texels, seen]).astype(np.float32)[unwrapped.faces]
    valid = pair.valid_right if view is View.RIGHT else pair.valid_left
    light, cell = decode_light(backend, picture, valid, scale), 1.0
    pixels = _pixels_per_texel(corners)
    while pixels > 1.5 * cell and max(light.shape[:2]) > 1:
        light, cell = halve_light(backend, light), 2 * cell
    texture = backend.zeros((height, width, 4), np.uint16)
    places = _find_places(backend, corners, _REACH, 1.5 * _REACH * pixels, size)

    def add(source: DeviceArray, bias: float, gain: float) -> None:
        backend.launch(
            "bake",
            light=source,
            places=places,
            width=source.shape[1],
            height=source.shape[0],
            cell=cell,
            bias=bias,
            gain=gain,
            texture_width=width,
            texture_height=height,
            texture_out=texture,
        )

    add(light, 0.0, 1.0)
    if cell == 1 and not _meets_pixels(texels, seen):
        back = np.column_stack([seen[:, :2] + 0.5, texels - 0.5, 1 / seen[:, 2]]).astype(np.float32)
        shown = _find_places(backend, back[unwrapped.faces], 0.0, 2.0, (light.shape[1], light.shape[0]))
        for share in _CORRECTIONS:
            # The residual's zero, and the half that it holds.
            add(_find_residual(backend, light, texture, shown), 32768.0, 2 * share)
    fill_gaps(backend, texture)
    return encode_light(backend, texture)


def _find_places(backend: Backend, corners: Floats, reach: float, margin: float, size: tuple[int, int]) -> DeviceArray:
    """(2, H, W) float32: where in the other picture texels lie, those up to `reach` beside the mesh too; else NaN.

    Args:
        backend: the device.
        corners: (F, 3, 5) float32, see kernel place.
        reach: texels.
        margin: how far such a texel may lie beyond its triangle's corners in the other picture.
        size: (width, height) in texels.
    """
    width, height = size
    shape = {"texture_width": width, "texture_height": height}
    held, owner = backend.upload(corners), backend.zeros((height, width), np.int32)
    places = backend.empty((2, height, width), np.float32)
    backend.launch("cover", corners=held, triangles=len(corners), reach=reach, **shape, owner_out=owner)
    backend.launch("place", corners=held, owner=owner, margin=margin, **shape, place_out=places)
    return places


def _find_residual(backend: Backend, light: DeviceArray, texture: DeviceArray, places: DeviceArray) -> DeviceArray:
    """(H, W, 4) uint16: what the textured model lacks of the picture, halved, around 32768."""
    missing = backend.empty(light.shape, np.uint16)
    backend.launch(
        "residual",
        light=light,
        texture=texture,
        places=places,
        texture_width=texture.shape[1],
        texture_height=texture.shape[0],
        width=light.shape[1],
        height=light.shape[0],
        residual_out=missing,
    )
    return missing


def _meets_pixels(texels: Doubles | Floats, seen: Doubles) -> bool:
    """Whether all charts are pieces of the picture, shifted by whole texels."""
    shift = texels - 0.5 - seen[:, :2]
    return bool(np.abs(shift - np.round(shift)).max() <= _ON_PIXELS)


def _pixels_per_texel(corners: Floats) -> float:
    """How many pixels of the picture a texel is wide, on average."""

    def area(place: Floats) -> float:
        first, second = (place[:, k] - place[:, 0] for k in (1, 2))
        return float(np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum(dtype=np.float64))

    texels = area(corners[..., :2])
    return float(np.sqrt(area(corners[..., 2:4]) / texels)) if texels else 1.0
