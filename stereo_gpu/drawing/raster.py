"""Draw triangles on a device: which one each sample of a picture shows, and its colour there."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.types import Bytes, Doubles, Floats

# Corners are drawn at whole parts of a sample's side: products of the sides of small triangles are exact then.
_PARTS = 256


@dataclass(frozen=True, kw_only=True)
class Paint:
    """What triangles are painted with, on a device.

    Args:
        texture: the texture and smaller copies of it, one after the other.
        size: (width, height) of the texture.
        levels: how many pictures these are.
        behind: added to v where a triangle is seen from behind.
        wire: width of the ink along the edges in samples; 0 for none.
        colours: background and ink, (2, 3) RGB.
    """

    texture: DeviceArray
    size: tuple[int, int]
    levels: int
    behind: float
    wire: float
    colours: DeviceArray


def place_on_screen(screen: Doubles, depth: Doubles) -> Floats:
    """Corners as the kernels take them, (N, 3): column, row, 1 / depth; 0 where they are not to be drawn.

    Args:
        screen: (N, 2) where each vertex falls in the picture, in samples whose centres lie at whole numbers.
        depth: (N,) distance along the optical axis; 0 where a vertex, and its triangles, are not to be drawn.
    """
    drawn = depth > 0
    inverse = np.where(drawn, 1.0 / np.where(drawn, depth, 1.0), 0.0)
    return np.column_stack([np.round(screen * _PARTS) / _PARTS, inverse]).astype(np.float32)


def rasterise(device: Backend, screen: DeviceArray, faces: DeviceArray, size: tuple[int, int]) -> DeviceArray:
    """Find the nearest triangle of every sample.

    Args:
        device: holds the arrays.
        screen: (N, 3) float32, as `place_on_screen` makes it.
        faces: (M, 3) int32 vertex indices.
        size: (width, height) in samples.

    Returns:
        (height, width) int32: number of the triangle, counted from 1; 0 where there is none.
    """
    width, height = size
    depth, owner = (device.zeros((height, width), np.int32) for _ in range(2))
    device.launch(
        "rasterise",
        screen=screen,
        faces=faces,
        triangles=faces.shape[0],
        width=width,
        height=height,
        depth_out=depth,
        owner_out=owner,
    )
    return owner


def shade(
    device: Backend,
    owner: DeviceArray,
    screen: DeviceArray,
    faces: DeviceArray,
    uv: DeviceArray,
    paint: Paint,
    samples: int,
) -> DeviceArray:
    """Paint what `rasterise` found, and average the samples of each pixel.

    Args:
        device: holds the arrays.
        owner: what `rasterise` found.
        screen, faces: what it was given.
        uv: (N, 2) float32, where each vertex lies in the texture, 0..1, origin at its top left corner.
        paint: the texture, and what else there is.
        samples: samples of a pixel in either direction.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    height, width = (side // samples for side in owner.shape)
    picture = device.empty((height, width, 3), np.uint8)
    device.launch(
        "shade",
        owner=owner,
        screen=screen,
        faces=faces,
        uv=uv,
        texture=paint.texture,
        colours=paint.colours,
        texture_width=paint.size[0],
        texture_height=paint.size[1],
        texture_levels=paint.levels,
        behind=paint.behind,
        wire=paint.wire,
        samples=samples,
        width=width,
        height=height,
        picture_out=picture,
    )
    return picture


def shrink_by_halves(texture: Bytes) -> tuple[Bytes, int]:
    """A texture (S, T, 3) with its smaller copies, each of half the side, rounded up, down to one texel.

    Source: L. Williams, "Pyramidal Parametrics", SIGGRAPH 1983.

    Returns:
        All texels and a black one behind the last, which kernels may read and pass over, (K, 3); and how many pictures
        they are.
    """
    levels = [np.ascontiguousarray(texture)]
    while levels[-1].shape[:2] != (1, 1):
        height, width = levels[-1].shape[:2]
        half = ((width + 1) // 2, (height + 1) // 2)
        levels.append(np.asarray(cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA), np.uint8))
    behind = np.zeros((1, 3), np.uint8)
    return np.concatenate([*(level.reshape(-1, 3) for level in levels), behind]), len(levels)
