"""What is wanted of a picture: a mask from a file, from a rectangle, or from a range of depth.

Each is laid out on the rectified reference view, (H, W) uint8, 1 where something is wanted.
"""

from __future__ import annotations

import math
import os

import cv2
import numpy as np

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.images import check_picture, grey, read_image
from stereo_gpu.types import Bytes, Floats, Picture

GRABCUT_SIDE = 640  # px: GrabCut works on a copy of at most this size; its time grows faster than the area
SURROUNDINGS = 0.3  # of the rectangle, on each side: what background is learnt from
LEAST_OBJECT = 0.02  # of the rectangle: a mask smaller than that found nothing
TEXTURE_SIGMA = 3.0  # px
SMALLEST_RECTANGLE = 3  # px a side
SEED = 5


def mask_from_file(path: str | os.PathLike[str], size: tuple[int, int]) -> Bytes:
    """Read a mask: wanted where the picture is brighter than half its own brightest value.

    Args:
        path: any picture, the size of the rectified reference view.
        size: that size, (width, height).

    Raises:
        PictureError: it cannot be read, has another size, or is black.
    """
    picture = read_image(path)
    height, width = picture.shape[:2]
    if (width, height) != tuple(size):
        raise PictureError(
            f"mask {path} is {width} x {height} px, the rectified picture is {size[0]} x {size[1]}:"
            " draw it on the rectified reference view"
        )
    flat = picture if picture.ndim == 2 else picture.max(axis=2)
    brightest = int(flat.max())
    if brightest == 0:
        raise PictureError(f"mask {path} is black, so that nothing is wanted: paint what you want white")
    return (flat > brightest / 2).astype(np.uint8)


def mask_from_rectangle(picture: Picture, rectangle: tuple[int, int, int, int], iterations: int = 5) -> Bytes:
    """Cut out the object that a rectangle surrounds (GrabCut: Rother, Kolmogorov and Blake 2004).

    Everything outside the rectangle counts as background; the same input always gives the same mask.

    Args:
        picture: the rectified reference view.
        rectangle: x, y of the top left corner, width and height, px; inside the picture, with room around it.
        iterations: of GrabCut.

    Raises:
        PictureError: `picture` is none.
        InputError: the rectangle or `iterations` are wrong, or no object was found.
    """
    check_picture("picture", picture)
    x, y, width, height = _rectangle(rectangle, picture.shape[1], picture.shape[0])
    if isinstance(iterations, bool) or not isinstance(iterations, int) or not 1 <= iterations <= 100:
        raise InputError(f"iterations is {iterations!r:.60}: give 1 to 100")
    # Only what lies around the rectangle says what the background looks like; the far end of the picture misleads.
    x0, y0 = max(0, x - round(SURROUNDINGS * width)), max(0, y - round(SURROUNDINGS * height))
    x1, y1 = x + width + round(SURROUNDINGS * width), y + height + round(SURROUNDINGS * height)
    crop = picture[y0:y1, x0:x1]
    labels = np.full(crop.shape[:2], cv2.GC_BGD, np.uint8)
    labels[y - y0 : y - y0 + height, x - x0 : x - x0 + width] = cv2.GC_PR_FGD
    scale = min(1.0, GRABCUT_SIDE / max(crop.shape[:2]))
    if scale < 1:
        crop = cv2.resize(crop, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        labels = cv2.resize(labels, crop.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    if not (labels == cv2.GC_BGD).any() or not (labels == cv2.GC_PR_FGD).any():
        raise InputError(f"rectangle {x},{y} {width} x {height} leaves no background around it: draw it closer")
    inside = _grabcut(_colours(crop), labels, iterations)
    if picture.ndim == 2 and inside.sum() < LEAST_OBJECT * (labels == cv2.GC_PR_FGD).sum():
        inside = _grabcut(_texture(crop), labels, iterations)
    if scale < 1:
        # Interpolated and cut at half, so that the outline has no stairs.
        full = picture[y0:y1, x0:x1].shape[1::-1]
        inside = (cv2.resize(inside * 255, full, interpolation=cv2.INTER_LINEAR) > 127).astype(np.uint8)
    mask = np.zeros(picture.shape[:2], np.uint8)
    mask[y : y + height, x : x + width] = inside[y - y0 : y - y0 + height, x - x0 : x - x0 + width]
    if mask.sum() < LEAST_OBJECT * width * height:
        raise InputError(
            f"rectangle {x},{y} {width} x {height} holds nothing that stands out: draw it around the whole object,"
            " or give a mask"
        )
    result: Bytes = mask
    return result


def mask_from_depth(depth: Floats, near: float, far: float) -> Bytes:
    """Keep what lies between two depths.

    Args:
        depth: (H, W) depths, or (H, W, 3) points of which z counts; NaN where there is none, which is not kept.
        near, far: the range, both ends in it, in the unit of `depth`.

    Raises:
        InputError: the range is empty, or `depth` has the wrong shape.
    """
    near, far = float(near), float(far)
    if math.isnan(near) or math.isnan(far) or not max(near, 0.0) < far:
        raise InputError(f"depth range {near:g} to {far:g} is empty: give the near end first, both ahead of the camera")
    depth = np.asarray(depth)
    if not (depth.ndim == 2 or (depth.ndim == 3 and depth.shape[2] == 3)):
        raise InputError(f"depth has shape {depth.shape}: give (H, W) depths or (H, W, 3) points")
    z = depth if depth.ndim == 2 else depth[..., 2]
    return ((z >= near) & (z <= far)).astype(np.uint8)


def _grabcut(bands: Bytes, labels: Bytes, iterations: int) -> Bytes:
    """1 where GrabCut sees the object."""
    labels = labels.copy()
    cv2.setRNGSeed(SEED)  # GrabCut starts from random clusters
    cv2.grabCut(bands, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), iterations, cv2.GC_INIT_WITH_MASK)
    inside: Bytes = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)).astype(np.uint8)
    return inside


def _colours(picture: Picture) -> Bytes:
    return np.dstack([grey(picture if picture.ndim == 2 else picture[..., band]) for band in range(3)])


def _texture(picture: Picture) -> Bytes:
    """The value of a grey picture, of its surroundings, and its texture.

    Where object and background are of the same greys, as the cup on the curtain, this still tells them apart;
    it is the second choice since texture is blurred, and the outline with it.
    """
    flat = grey(picture)
    value = flat.astype(np.float32)
    mean = cv2.GaussianBlur(value, (0, 0), TEXTURE_SIGMA)
    variance = cv2.GaussianBlur(value * value, (0, 0), TEXTURE_SIGMA) - mean * mean
    spread = np.clip(4 * np.sqrt(np.maximum(variance, 0)), 0, 255)  # 4: so that texture weighs as much as grey
    return np.dstack([flat, mean.astype(np.uint8), spread.astype(np.uint8)])


def _rectangle(rectangle: tuple[int, int, int, int], across: int, down: int) -> tuple[int, int, int, int]:
    try:
        numbers = [int(value) for value in rectangle]
        exact = len(numbers) == 4 and all(n == v for n, v in zip(numbers, rectangle, strict=True))
    except (TypeError, ValueError, OverflowError):
        exact = False
    if not exact:
        raise InputError(f"rectangle is {rectangle!r:.60}: give x, y, width and height in whole px")
    x, y, width, height = numbers
    if min(width, height) < SMALLEST_RECTANGLE:
        raise InputError(f"rectangle is {width} x {height} px: give {SMALLEST_RECTANGLE} px a side or more")
    if x < 0 or y < 0 or x + width > across or y + height > down:
        raise InputError(
            f"rectangle {x},{y} {width} x {height} leaves the picture of {across} x {down} px: keep it inside"
        )
    return x, y, width, height
