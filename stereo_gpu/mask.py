"""What is wanted of a picture: a mask from a file, a rectangle, strokes of a brush, or a range of depth.

Each is laid out on the rectified reference view, (H, W) uint8, 1 where something is wanted.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.grabcut import grabcut
from stereo_gpu.images import check_picture, read_image
from stereo_gpu.types import Bytes, Floats, Picture

SURROUNDINGS = 0.3  # of the rectangle, on each side: what background is learnt from
LEAST_OBJECT = 0.02  # of the rectangle: a mask smaller than that found nothing
STROKES_SIDE = 480  # px, of the copy that GrabCut gets: somebody waits for its outline
SMALLEST_RECTANGLE = 3  # px a side
MOST_STROKES = 2000
MOST_POINTS = 100_000  # of all strokes together
THICKEST = 32_767  # px, that cv2 draws
STEP = 16  # cv2 draws at fractions of a pixel, as whole numbers of 1/16


def mask_from_file(path: str | os.PathLike[str], size: tuple[int, int]) -> Bytes:
    """Read a mask: wanted where the picture is brighter than half its own brightest value.

    Args:
        path: any picture, the size of the rectified reference view.
        size: that size, (width, height).

    Raises:
        PictureError: it cannot be read, has another size, or is black.
    """
    picture = read_image(path)
    check_mask_size(f"mask {path}", picture.shape[1::-1], size)
    flat = picture if picture.ndim == 2 else picture.max(axis=2)
    brightest = int(flat.max())
    if brightest == 0:
        raise PictureError(f"mask {path} is black, so that nothing is wanted: paint what you want white")
    return (flat > brightest / 2).astype(np.uint8)


def check_mask_size(name: str, size: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    """Refuse a mask of a size, (width, height), other than that of the rectified view.

    Raises:
        PictureError: with both sizes; the message opens with `name`.
    """
    if tuple(size) != tuple(wanted):
        raise PictureError(
            f"{name} is {size[0]} x {size[1]} px, the rectified picture is {wanted[0]} x {wanted[1]}:"
            " draw it on the rectified reference view"
        )


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
    labels = np.full(picture.shape[:2], cv2.GC_BGD, np.uint8)
    labels[y : y + height, x : x + width] = cv2.GC_PR_FGD
    rows, columns = _surroundings((x, y, width, height), labels.shape)
    if not (labels[rows, columns] == cv2.GC_BGD).any():
        raise InputError(f"rectangle {x},{y} {width} x {height} leaves no background around it: draw it closer")
    mask = np.zeros(labels.shape, np.uint8)
    mask[rows, columns] = grabcut(picture[rows, columns], labels[rows, columns], iterations, LEAST_OBJECT)
    mask[labels == cv2.GC_BGD] = 0
    if mask.sum() < LEAST_OBJECT * width * height:
        raise InputError(
            f"rectangle {x},{y} {width} x {height} holds nothing that stands out: draw it around the whole object,"
            " or give a mask"
        )
    return mask


@dataclass(frozen=True, kw_only=True)
class Stroke:
    """What a brush went over.

    Args:
        radius: of the brush, px.
        points: (x, y) of its centre, px, one after another; one alone is a dot.
    """

    radius: float
    points: Sequence[tuple[float, float]]


def mask_from_strokes(
    picture: Picture,
    *,
    rectangle: tuple[int, int, int, int] | None = None,
    wanted: Sequence[Stroke] = (),
    unwanted: Sequence[Stroke] = (),
    iterations: int = 3,
) -> Bytes:
    """Cut out what somebody has marked with brushes, within a rectangle or without one (GrabCut with hints).

    What a brush went over is as it says, and where both did, it is unwanted. Within a rectangle the rest is as in
    `mask_from_rectangle`. Without one, only what hangs together with a wanted stroke is kept; with unwanted strokes
    alone, everything that does not look like them. The same input always gives the same mask.

    Args:
        picture: the rectified reference view.
        rectangle: as in `mask_from_rectangle`, but that it may be the whole picture where unwanted strokes lie in it.
        wanted, unwanted: the strokes; what leaves the picture is cut off.
        iterations: of GrabCut; hints tell it so much that three do.

    Raises:
        PictureError: `picture` is none.
        InputError: nothing was marked, a mark is wrong, or nothing is left of the object.
    """
    check_picture("picture", picture)
    shape = picture.shape[:2]
    if rectangle is None and not wanted and not unwanted:
        raise InputError("nothing is marked: draw a rectangle around the object, or a brush over it")
    if rectangle is not None and not wanted and not unwanted:
        return mask_from_rectangle(picture, rectangle, iterations)
    yes, no = (_paint(name, strokes, shape) for name, strokes in (("wanted", wanted), ("unwanted", unwanted)))
    yes[no != 0] = 0
    labels = np.full(shape, cv2.GC_PR_BGD if wanted else cv2.GC_PR_FGD, np.uint8)
    rows, columns = slice(None), slice(None)
    if rectangle is not None:
        x, y, width, height = _rectangle(rectangle, shape[1], shape[0])
        labels[:] = cv2.GC_BGD
        labels[y : y + height, x : x + width] = cv2.GC_PR_FGD
        rows, columns = _surroundings(_around((x, y, width, height), yes), shape)
    labels[yes != 0] = cv2.GC_FGD
    labels[no != 0] = cv2.GC_BGD
    here = labels[rows, columns]
    for kinds, said in (
        ((cv2.GC_BGD, cv2.GC_PR_BGD), "leave no background: mark some of what is unwanted"),
        ((cv2.GC_FGD, cv2.GC_PR_FGD), "leave nothing of the object: mark some of what is wanted"),
    ):
        if not np.isin(here, kinds).any():
            raise InputError(f"the marks {said}")
    mask = np.zeros(shape, np.uint8)
    mask[rows, columns] = grabcut(picture[rows, columns], here, iterations, LEAST_OBJECT, STROKES_SIDE)
    if rectangle is None and wanted:
        mask = _hanging_together(mask | yes, yes)
    mask[labels == cv2.GC_BGD] = 0
    mask[labels == cv2.GC_FGD] = 1
    if not mask.any():
        raise InputError("the marks hold nothing that stands out: mark some of what is wanted")
    return mask


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


def _surroundings(rectangle: tuple[int, int, int, int], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns that say what the background looks like: the far end of the picture misleads."""
    x, y, width, height = rectangle
    across, down = round(SURROUNDINGS * width), round(SURROUNDINGS * height)
    return (
        slice(max(0, y - down), min(shape[0], y + height + down)),
        slice(max(0, x - across), min(shape[1], x + width + across)),
    )


def _around(rectangle: tuple[int, int, int, int], marked: Bytes) -> tuple[int, int, int, int]:
    """The smallest rectangle that holds this one and all that is marked."""
    x, y, width, height = rectangle
    down, across = (np.nonzero(marked.any(axis=axis))[0] for axis in (1, 0))
    if not len(down):
        return rectangle
    x0, y0 = min(x, int(across[0])), min(y, int(down[0]))
    x1, y1 = max(x + width, int(across[-1]) + 1), max(y + height, int(down[-1]) + 1)
    return x0, y0, x1 - x0, y1 - y0


def _hanging_together(mask: Bytes, marked: Bytes) -> Bytes:
    """Those parts of a mask on which something is marked."""
    count, parts = cv2.connectedComponents(mask, connectivity=4)
    kept = np.zeros(count, np.uint8)
    kept[np.unique(parts[marked != 0])] = 1
    kept[0] = 0
    result: Bytes = kept[parts]
    return result


def _paint(name: str, strokes: Sequence[Stroke], shape: tuple[int, ...]) -> Bytes:
    """(H, W) uint8, 1 where a brush went."""
    painted = np.zeros(shape, np.uint8)
    if len(strokes) > MOST_STROKES or sum(len(stroke.points) for stroke in strokes) > MOST_POINTS:
        raise InputError(f"{name} has {len(strokes)} strokes, the limit is {MOST_STROKES}: paint with a larger brush")
    furthest = max(shape)
    for stroke in strokes:
        numbers = np.asarray([stroke.radius, *(number for point in stroke.points for number in point)], np.float64)
        if not len(stroke.points) or not np.isfinite(numbers).all() or not 0 < stroke.radius <= furthest:
            raise InputError(f"{name}: a stroke of radius {stroke.radius:.60g}: give a number of px, and finite points")
        # What lies far outside is not seen, and whole numbers end somewhere.
        points = np.clip(np.asarray(stroke.points, np.float64), -furthest, 2 * furthest)
        fixed = np.round(points * STEP).astype(np.int32)
        thick = min(THICKEST, max(1, round(2 * stroke.radius)))
        if len(fixed) > 1:
            cv2.polylines(painted, [fixed], False, 1, thick, cv2.LINE_8, STEP.bit_length() - 1)
        for x, y in (fixed[0], fixed[-1]):
            cv2.circle(painted, (int(x), int(y)), round(stroke.radius * STEP), 1, -1, cv2.LINE_8, STEP.bit_length() - 1)
    return painted


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
