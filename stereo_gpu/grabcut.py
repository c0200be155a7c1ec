"""Cut an object out of a picture, given what is known of it (GrabCut: Rother, Kolmogorov and Blake 2004)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.images import grey
from stereo_gpu.types import Bytes, Picture

SIDE = 640  # px: it works on a copy of at most this size, since its time grows faster than the area
TEXTURE_SIGMA = 3.0  # px
SEED = 5


def grabcut(picture: Picture, labels: Bytes, iterations: int, least: float, side: int = SIDE) -> Bytes:
    """1 where the object is; the same input always gives the same.

    Args:
        picture: (H, W) or (H, W, 3).
        labels: (H, W) uint8 as OpenCV has them: GC_BGD and GC_FGD where it is known, GC_PR_BGD and GC_PR_FGD elsewhere.
        iterations: of GrabCut.
        least: of the pixels that may be the object; where a grey picture yields fewer, its texture is asked, too.
        side: px, of the copy that it works on.
    """
    full = labels.shape[::-1]
    scale = min(1.0, side / max(full))
    if scale < 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        labels = _shrink(labels, picture.shape[1::-1])
    inside = _run(_colours(picture), labels, iterations)
    if picture.ndim == 2 and inside.sum() < least * (labels == cv2.GC_PR_FGD).sum():
        inside = _run(_texture(picture), labels, iterations)
    if scale < 1:
        # Interpolated and cut at half, so that the outline has no stairs.
        inside = (cv2.resize(inside * 255, full, interpolation=cv2.INTER_LINEAR) > 127).astype(np.uint8)
    return inside


def _shrink(labels: Bytes, size: tuple[int, int]) -> Bytes:
    """Labels of a smaller picture, in which no thin stroke is lost."""
    small: Bytes = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST)
    rows, columns = (_places(there, here) for there, here in zip(labels.shape, small.shape, strict=True))
    for known in (cv2.GC_FGD, cv2.GC_BGD):
        where = np.nonzero(labels == known)
        marked = np.zeros_like(small)
        marked[rows[where[0]], columns[where[1]]] = 1
        small[(marked != 0) & (small != cv2.GC_BGD) & (small != cv2.GC_FGD)] = known
    return small


def _places(there: int, here: int) -> NDArray[np.intp]:
    """For each of `there` pixels, the one of `here` that it falls into."""
    return np.minimum(np.arange(there) * here // there, here - 1)


def _run(bands: Bytes, labels: Bytes, iterations: int) -> Bytes:
    if not (labels & 1).any():  # nothing can be the object
        return np.zeros(labels.shape, np.uint8)
    labels = labels.copy()
    cv2.setRNGSeed(SEED)  # it starts from random clusters
    cv2.grabCut(bands, labels, None, np.zeros((1, 65)), np.zeros((1, 65)), iterations, cv2.GC_INIT_WITH_MASK)
    inside: Bytes = (labels & 1).astype(np.uint8)  # GC_FGD is 1, GC_PR_FGD 3
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
