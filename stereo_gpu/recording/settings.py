"""How a camera runs: asked for, set where the driver allows it, and read back."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import cv2

from stereo_gpu.errors import InputError

# The driver's own units: V4L2 gives exposure in 0.1 ms, Windows as a power of two of seconds.
VALUES = {
    "fps": cv2.CAP_PROP_FPS,
    "exposure": cv2.CAP_PROP_EXPOSURE,
    "gain": cv2.CAP_PROP_GAIN,
    "focus": cv2.CAP_PROP_FOCUS,
    "white_balance": cv2.CAP_PROP_WB_TEMPERATURE,
}
AUTOMATICS = {  # property, and the value that turns it off
    "auto_exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, 1.0),  # V4L2: 1 is manual, 3 aperture priority
    "auto_focus": (cv2.CAP_PROP_AUTOFOCUS, 0.0),
    "auto_white_balance": (cv2.CAP_PROP_AUTO_WB, 0.0),
}
OWNER = {"exposure": "auto_exposure", "focus": "auto_focus", "white_balance": "auto_white_balance"}
UNKNOWN = -1.0  # what OpenCV answers for a property that the driver does not have


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """What is asked of the cameras; None leaves a setting as it is.

    Args:
        size: width and height, px, of what the camera delivers.
        fps: pictures a second; for folders, which tell no time, their rate.
        exposure, gain, focus, white_balance: in the driver's units; each turns its automatic off.
        lock: turn automatic exposure, focus and white balance off, and leave the values at what they found.
        fourcc: the pixel format, such as "MJPG", which two cameras on one USB hub may need.

    Raises:
        InputError: a value makes no sense.
    """

    size: tuple[int, int] | None = None
    fps: float | None = None
    exposure: float | None = None
    gain: float | None = None
    focus: float | None = None
    white_balance: float | None = None
    lock: bool = False
    fourcc: str | None = None

    def __post_init__(self) -> None:
        if self.size is not None and not (len(self.size) == 2 and min(self.size) >= 1):
            raise InputError(f"size = {self.size}: give width and height in px, such as 1280x720")
        for name in VALUES:
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise InputError(f"{name} = {value:g}: give a number that the camera's driver knows")
        if self.fps is not None and not 0 < self.fps <= 10_000:
            raise InputError(f"fps = {self.fps:g}: give pictures a second, such as 30")
        if self.fourcc is not None and not (len(self.fourcc) == 4 and self.fourcc.isascii()):
            raise InputError(f"fourcc = {self.fourcc!r:.20}: give the four letters of a pixel format, such as MJPG")

    @property
    def asked(self) -> tuple[str, ...]:
        """The names of what is asked for."""
        names = (field.name for field in fields(self) if getattr(self, field.name) not in (None, False))
        return tuple(name.replace("_", " ") for name in names)


NO_SETTINGS = CameraSettings()


def apply_settings(capture: cv2.VideoCapture, wanted: CameraSettings) -> tuple[str, ...]:
    """Set what is asked for; the names of what the driver refused or set to something else."""
    refused = []
    # The format first, since it decides which sizes there are, and they which rates.
    if wanted.fourcc is not None:
        code = cv2.VideoWriter.fourcc(*wanted.fourcc)
        if not capture.set(cv2.CAP_PROP_FOURCC, code) or int(capture.get(cv2.CAP_PROP_FOURCC)) != code:
            refused.append(f"fourcc {wanted.fourcc}")
    if wanted.size is not None:
        width, height = wanted.size
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        given = (int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        if given != (width, height):
            refused.append(f"size {width}x{height} (it gives {given[0]}x{given[1]})")
    for automatic, (number, off) in AUTOMATICS.items():
        owned = any(getattr(wanted, name) is not None for name, owner in OWNER.items() if owner == automatic)
        if (wanted.lock or owned) and not (capture.set(number, off) and capture.get(number) == off):
            refused.append(f"{automatic.replace('_', ' ')} off")
    for name, number in VALUES.items():
        value = getattr(wanted, name)
        if value is None:
            continue
        accepted = capture.set(number, value)
        given_value = capture.get(number)
        if not accepted or abs(given_value - value) > 0.02 * max(1.0, abs(value)):
            refused.append(f"{name.replace('_', ' ')} {value:g} (it has {given_value:g})")
    return tuple(refused)


def read_settings(capture: cv2.VideoCapture) -> dict[str, float]:
    """What the driver tells of how the camera runs; what it does not know is left out."""
    numbers = {**VALUES, **{name: number for name, (number, _) in AUTOMATICS.items()}}
    told = {name: float(capture.get(number)) for name, number in numbers.items()}
    return {name: value for name, value in told.items() if value != UNKNOWN and math.isfinite(value)}
