"""Disparities to points in space."""

from __future__ import annotations

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray, open_backend
from stereo_gpu.errors import InputError
from stereo_gpu.types import Disparity, Floats, RectifiedPair, View


def triangulate(disparity: Disparity, pair: RectifiedPair, *, backend: str | None = None) -> Floats:
    """Turn a disparity map into points.

    Args:
        disparity: the map, on either view.
        pair: the pair that it was matched on, for its geometry.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.

    Returns:
        (H, W, 3) float32 in the pair's unit, frame of the rectified left camera: z = focal_px baseline /
        (d - (cx_left - cx_right)). NaN where there is no disparity, or none that lies in front of the cameras.

    Raises:
        InputError: the map and the pair differ in size.
    """
    if disparity.values.shape != pair.left.shape[:2]:
        (high, wide), (tall, broad) = disparity.values.shape, pair.left.shape[:2]
        raise InputError(
            f"the disparity map is {wide} x {high}, the pair {broad} x {tall}: use the pair that was matched"
        )
    device = open_backend(backend)
    points = triangulate_on(device, device.upload(disparity.values), disparity.reference, pair)
    return device.download(points)


def triangulate_on(backend: Backend, values: DeviceArray, reference: View, pair: RectifiedPair) -> DeviceArray:
    """Triangulate a map that is on the device; the points stay there."""
    height, width = values.shape
    points = backend.empty((height, width, 3), np.float32)
    backend.launch(
        "triangulate",
        disparity=values,
        width=width,
        height=height,
        direction=1 if reference is View.RIGHT else -1,
        focal_px=pair.focal_px,
        baseline=pair.baseline,
        cx_left=pair.cx_left,
        cx_right=pair.cx_right,
        cy=pair.cy,
        points_out=points,
    )
    return points
