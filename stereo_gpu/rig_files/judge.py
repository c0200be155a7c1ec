"""From what a file says to a rig: what it leaves open is filled in, and what no camera can be is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig import DISTORTION_COUNTS, LARGEST_SIDE, Camera, Rig
from stereo_gpu.rig_files.draft import Draft, DraftCamera, Size
from stereo_gpu.rig_files.geometry import mend_rotation
from stereo_gpu.types import METRES_PER_UNIT, Doubles

TILTED_COUNT = 14  # OpenCV's longest lens model: 12 coefficients and two angles of a tilted sensor
FOCAL_RANGE = (0.01, 1000.0)  # times the larger side: an angle of view of 178 degrees, and of 0.06
FOCAL_RATIO = 10.0  # of fx and fy
LARGEST_COEFFICIENT = 1e7  # of the lens; that of x^6 grows large with long focal lengths
BASELINE_RANGE = (1e-9, 1e9)  # in any unit
LARGEST_CAMERA = 99  # KITTI's names have two digits


def to_rig(draft: Draft, size: Size | None, unit: str | None) -> Rig:
    """The rig of a draft.

    Args:
        draft: what the file says.
        size: of the pictures, px, where the file does not say.
        unit: of the file's lengths where the file does not say; None takes mm.

    Raises:
        InputError: the size is missing, or the values make no rig.
    """
    left, right = (_camera(name, getattr(draft, name), size) for name in ("left", "right"))
    rig = Rig(
        left=left,
        right=right,
        R=mend_rotation("R", draft.R),
        T=draft.T,
        rms_px=draft.rms_px,
        epipolar_rms_px=draft.epipolar_rms_px,
        unit=draft.unit or unit or "mm",
        deviations=draft.deviations,
    )
    refuse_nonsense(rig)
    return rig


def check_size(size: object) -> None:
    """Refuse what is neither None nor a width and a height.

    Raises:
        InputError: with the value.
    """
    if size is None:
        return
    if not (isinstance(size, tuple) and len(size) == 2 and all(isinstance(side, int) for side in size)):
        raise InputError(f"size is {size!r:.40}: give width and height, as (640, 480)")
    if not all(1 <= side <= LARGEST_SIDE for side in size):
        raise InputError(f"size is {size!r:.40}: width and height must be 1 to {LARGEST_SIDE} px")


def check_cameras(cameras: object) -> None:
    """Refuse what is neither None nor the numbers of two cameras.

    Raises:
        InputError: with the value.
    """
    if cameras is not None and not (
        isinstance(cameras, tuple)
        and len(cameras) == 2
        and all(isinstance(number, int) and 0 <= number <= LARGEST_CAMERA for number in cameras)
        and cameras[0] != cameras[1]
    ):
        raise InputError(f"cameras is {cameras!r:.40}: give the left and the right one's number, as (2, 3)")


def in_unit(rig: Rig, unit: str | None) -> Rig:
    """The rig with its lengths in another unit of METRES_PER_UNIT; None leaves them.

    Raises:
        InputError: its own unit is unknown.
    """
    if unit is None or unit == rig.unit:
        return rig
    if rig.unit not in METRES_PER_UNIT:
        raise InputError(f"its lengths are in {rig.unit!r:.40}, which cannot be turned into {unit}: leave the unit out")
    scale = METRES_PER_UNIT[rig.unit] / METRES_PER_UNIT[unit]
    with np.errstate(over="ignore"):  # infinite deviations are refused as such
        deviations = rig.deviations and replace(rig.deviations, T=rig.deviations.T * scale)
    return replace(rig, T=rig.T * scale, unit=unit, deviations=deviations)


def refuse_nonsense(rig: Rig) -> None:
    """Refuse numbers that are those of a rig by their form, but that no two cameras have.

    Raises:
        InputError: a focal length, a principal point, a lens or the baseline is out of all proportion, or left and
            right are swapped.
    """
    for name, camera in (("left", rig.left), ("right", rig.right)):
        wide, high = camera.size
        (fx, _, cx), (_, fy, cy) = camera.matrix[:2].tolist()
        told = f"for pictures of {wide} x {high} px: mend the value, or give the size that belongs to it"
        low, top = (factor * max(wide, high) for factor in FOCAL_RANGE)
        for key, value in (("fx", fx), ("fy", fy)):
            if not low <= value <= top:
                raise InputError(f"{name} camera has {key} = {value:g} px {told}")
        if not 1 / FOCAL_RATIO <= fx / fy <= FOCAL_RATIO:
            raise InputError(f"{name} camera has fx = {fx:g} and fy = {fy:g} px: they must be alike; mend the value")
        if not (-wide <= cx <= 2 * wide and -high <= cy <= 2 * high):
            raise InputError(f"{name} camera has its principal point at ({cx:g}, {cy:g}) {told}")
        largest = float(np.abs(camera.distortion).max())
        if largest > LARGEST_COEFFICIENT:
            raise InputError(f"{name} camera has a lens coefficient of {largest:g}: mend the value")
    baseline = math.hypot(*rig.T.tolist())
    if not BASELINE_RANGE[0] <= baseline <= BASELINE_RANGE[1]:
        raise InputError(f"the cameras stand {baseline:g} {rig.unit} apart: mend T")
    place = -rig.R.T @ rig.T  # of the right camera as the left one sees it
    if place[0] < 0 and np.abs(place).max() == -place[0]:
        raise InputError(
            f"the right camera stands {-place[0]:g} {rig.unit} to the left of the left one: exchange left and right,"
            " or, where R and T lead from right to left, give their inverse, R' and -R' T"
        )


def _camera(name: str, draft: DraftCamera, size: Size | None) -> Camera:
    found = draft.size or size
    if found is None:
        raise InputError("it does not say how large the pictures are: add --size 640x480, or size=(640, 480)")
    try:
        return Camera(draft.matrix, _coefficients(draft.distortion), found, draft.rms_px)
    except InputError as error:
        raise InputError(f"{name} camera: {error}") from None


def _coefficients(given: Doubles) -> Doubles:
    """A lens with as many coefficients as `Camera` takes."""
    count = len(given)
    if count == 4:  # k1 k2 p1 p2, and so k3 = 0
        return np.append(given, 0.0)
    if count == TILTED_COUNT and not given[12:].any():
        return given[:12]
    if count not in DISTORTION_COUNTS:
        detail = " (a tilted sensor)" if count == TILTED_COUNT else ""
        raise InputError(f"its lens has {count} coefficients{detail}: 4, 5, 8 or 12 in OpenCV's order are supported")
    return given
