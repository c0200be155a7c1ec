"""Bake a picture into the texture atlas of an unwrapped mesh."""

from __future__ import annotations

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.types import Bytes, Doubles, Floats, RectifiedPair, View
from stereo_gpu.unwrap import Unwrapped

SEAM_TEXELS = 4  # how far charts are grown: bilinear filtering and two mip levels reach this far


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
    """Resample a rectified picture into the atlas.

    Args:
        backend: the device that holds the picture.
        picture: the rectified picture of `view`, (H, W) or (H, W, 3).
        scale: factor that takes its values to 0..255.
        unwrapped: the mesh with its texture coordinates.
        pair: for its geometry.
        view: which of the two pictures it is.

    Returns:
        (S, T, 3) uint8 RGB, row 0 at the top; charts grown by SEAM_TEXELS so that no seam shows.
    """
    width, height = unwrapped.size
    seen = project(unwrapped.vertices, pair, view)
    weighted = np.column_stack([seen[:, :2] * seen[:, 2:], seen[:, 2]])
    texels = unwrapped.uv * np.array([width, height])
    corners = np.concatenate([texels, weighted], axis=1)[unwrapped.faces].astype(np.float32)
    held = backend.upload(corners)
    atlas = {"texture_width": width, "texture_height": height}
    owner = backend.zeros((height, width), np.int32)
    backend.launch("cover", corners=held, triangles=len(corners), **atlas, owner_out=owner)
    texture, covered = backend.empty((height, width, 3), np.uint8), backend.empty((height, width), np.uint8)
    backend.launch(
        "bake",
        picture=picture,
        corners=held,
        owner=owner,
        width=picture.shape[1],
        height=picture.shape[0],
        channels=1 if len(picture.shape) == 2 else 3,
        scale=scale,
        **atlas,
        texture_out=texture,
        covered_out=covered,
    )
    for _ in range(SEAM_TEXELS):
        grown, reached = backend.empty((height, width, 3), np.uint8), backend.empty((height, width), np.uint8)
        backend.launch(
            "dilate",
            texture=texture,
            covered=covered,
            width=width,
            height=height,
            texture_out=grown,
            covered_out=reached,
        )
        texture, covered = grown, reached
    return backend.download(texture)
