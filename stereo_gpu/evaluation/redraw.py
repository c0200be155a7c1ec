"""Draw a textured mesh as the camera of its picture sees it, and tell how near it comes to that picture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.backends import Backend
from stereo_gpu.drawing.raster import place_on_screen, rasterise
from stereo_gpu.texture import project
from stereo_gpu.types import Bytes, Doubles, Mesh, Picture, RectifiedPair, View

_Mask = NDArray[np.bool_]


def redraw(device: Backend, mesh: Mesh, pair: RectifiedPair, view: View) -> tuple[Bytes, _Mask]:
    """Draw a mesh from a rectified camera, one sample at each pixel's centre.

    The texture is sampled as viewers sample one in sRGB: bilinearly, in linear light.

    Args:
        device: where triangles are found.
        mesh: with its texture.
        pair: for its geometry and its pictures' size.
        view: which camera.

    Returns:
        (H, W, 3) uint8 RGB, black where no triangle is seen, and (H, W) whether one is.
    """
    height, width = pair.right.shape[:2]
    seen = project(mesh.vertices, pair, view)
    screen = device.upload(place_on_screen(seen[:, :2], seen[:, 2]))
    owner = device.download(rasterise(device, screen, device.upload(mesh.faces), (width, height)))
    y, x = np.nonzero(owner)
    corners = mesh.faces[owner[y, x] - 1]
    shares = _shares(seen[corners, :2], np.stack([x, y], axis=1)) / seen[corners, 2]
    uv = np.einsum("pi,pik->pk", shares / shares.sum(axis=1, keepdims=True), mesh.uv[corners].astype(np.float64))
    picture = np.zeros((height, width, 3), np.uint8)
    size = np.array(mesh.texture.shape[1::-1])
    picture[y, x] = _levels(_bilinear(_light(mesh.texture), uv * size - 0.5))
    return picture, owner > 0


def psnr(drawn: Bytes, picture: Picture, where: _Mask, scale: float = 1.0) -> float:
    """Peak signal-to-noise ratio in dB, of levels 0..255, over the pixels of a mask; infinite where all are equal.

    Args:
        drawn: (H, W, 3).
        picture: (H, W) or (H, W, 3).
        where: (H, W).
        scale: factor that takes the picture's values to 0..255.
    """
    wanted = picture.astype(np.float64) * scale
    wanted = wanted[..., None] if wanted.ndim == 2 else wanted
    error = float(((drawn.astype(np.float64) - wanted)[where] ** 2).mean())
    return 10 * math.log10(255**2 / error) if error else math.inf


def _shares(corners: Doubles, at: NDArray[np.integer]) -> Doubles:
    """(P, 3) barycentric shares of places in triangles (P, 3, 2)."""
    a, b, c = (corners[:, k] - at for k in range(3))
    parts = [p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b))]
    shares: Doubles = np.stack(parts, axis=1)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def _bilinear(values: Doubles, at: Doubles) -> Doubles:
    height, width = values.shape[:2]
    low = np.floor(at).astype(np.int64)
    across, down = (at - low).T[:, :, None]
    left, right = (np.clip(low[:, 0] + k, 0, width - 1) for k in (0, 1))
    top, bottom = (np.clip(low[:, 1] + k, 0, height - 1) for k in (0, 1))
    upper = values[top, left] * (1 - across) + values[top, right] * across
    lower = values[bottom, left] * (1 - across) + values[bottom, right] * across
    return np.asarray(upper * (1 - down) + lower * down)


def _light(levels: Bytes) -> Doubles:
    """Linear light 0..1 of sRGB's levels (IEC 61966-2-1)."""
    level = np.arange(256) / 255
    table = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return np.asarray(table[levels])


def _levels(light: Doubles) -> Bytes:
    level = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(np.floor(255 * level + 0.5), np.uint8)
