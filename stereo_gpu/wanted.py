"""Which parts of the reference view are wanted: before the match by masks, after it by depth."""

from __future__ import annotations

import dataclasses

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.job import Job
from stereo_gpu.mask import mask_from_depth, mask_from_rectangle
from stereo_gpu.types import Bytes, Disparity, Floats, Picture, Validity


def find_wanted(picture: Picture, valid: Bytes, job: Job) -> Bytes:
    """Where the reference view has content and somebody wants it: (H, W) uint8, 1 there.

    Args:
        picture: the rectified reference view.
        valid: (H, W) uint8, 1 where it has content.
        job: for its mask and rectangle.

    Raises:
        InputError: nowhere, or GrabCut finds no object in the rectangle.
    """
    wanted = valid
    if job.mask is not None:
        wanted = np.asarray(wanted & (job.mask != 0), np.uint8)
    if job.rectangle is not None:
        wanted = np.asarray(wanted & (mask_from_rectangle(picture, job.rectangle) != 0), np.uint8)
    if not wanted.any():
        raise InputError("the mask leaves no pixel of the reference view: widen it")
    return wanted


def cut_depth(disparity: Disparity, points: Floats, depth: tuple[float, float]) -> tuple[Disparity, Floats]:
    """Take away what lies outside of the wanted depths, nearest and farthest, in the unit of the points.

    Raises:
        InputError: nothing is left.
    """
    found = np.isfinite(disparity.values)
    outside = (mask_from_depth(points, *depth) == 0) & found
    if (outside == found).all():
        depths = points[..., 2][np.isfinite(points[..., 2])]
        there = f"from {depths.min():.4g} to {depths.max():.4g}" if len(depths) else "nowhere"
        raise InputError(f"depth = {depth[0]:g},{depth[1]:g}: nothing lies there, points were found {there}; widen it")
    cut = dataclasses.replace(
        disparity,
        values=np.where(outside, np.float32(np.nan), disparity.values),
        validity=np.where(outside, np.uint8(Validity.MASKED), disparity.validity),
        confidence=np.where(outside, np.float32(0), disparity.confidence),
    )
    return cut, np.where(outside[..., None], np.float32(np.nan), points)
