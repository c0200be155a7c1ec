"""Pictures from a camera, a stream or a video file, through OpenCV."""

from __future__ import annotations

import math
import re
import stat
import time
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.recording.settings import NO_SETTINGS, CameraSettings, apply_settings, read_settings
from stereo_gpu.types import Picture

URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
ACCOUNT = re.compile(r"(?<=://)[^/?#]*@")
USUAL_PERIOD_S = 1 / 30  # where a source does not say
NETWORK_LIMIT_MS = 4000  # OpenCV itself would wait 30 s for a stream that says nothing
LATEST_STAMP_S = 2.0  # a driver's time stamp that is older is of another clock
WARM_UP_S = 1.0  # a camera's automatic exposure takes about as long
CUT_SHARE = 0.01  # of the pictures that a file says it has: more missing, and it is cut off


def is_live(name: str) -> bool:
    """Whether the name means a camera or a stream rather than a file."""
    if name.isdecimal() or URL.match(name):
        return True
    try:
        kind = Path(name).stat().st_mode
    except (OSError, ValueError):
        return name.startswith("/dev/")
    return not stat.S_ISREG(kind)


def without_account(name: str) -> str:
    """The name as it may be written and shown: a stream's URL may hold a password."""
    return ACCOUNT.sub("***@", name)


class VideoSource:
    """A camera by its number or path, a stream by its URL, or a video file.

    A file's times are those in the file, so that pictures dropped when it was recorded leave a gap. A camera's are
    the driver's time stamps, where they are on the computer's own clock as with V4L2, else when the grab returned.

    Raises:
        InputError: it cannot be opened.
    """

    def __init__(self, name: str, wanted: CameraSettings = NO_SETTINGS) -> None:
        self.name = without_account(name)
        self.live = is_live(name)
        self.stamped = not self.live
        self._camera = self.live and not URL.match(name)
        self.warm_up_s = WARM_UP_S if self._camera else 0.0
        self._capture = _open(name, self._camera)
        if not self._capture.isOpened():
            self._capture.release()
            raise InputError(
                f"camera or video {self.name!r} cannot be opened: check that it is there and that nothing else uses it"
            )
        # Films and streams are as they are.
        self.refused = apply_settings(self._capture, wanted) if self._camera else wanted.asked
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.period_s = 1 / rate if math.isfinite(rate) and 0 < rate <= 10_000 else USUAL_PERIOD_S
        count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        # Of a stream with no end OpenCV gives a negative number, of a camera -1.
        self._count = int(count) if math.isfinite(count) and 0 < count < 2**40 else 0
        self._grabbed = 0
        self._last_s = -self.period_s

    def grab(self) -> float | None:
        """Take the next picture without decoding it; its time in seconds, or None where there is none."""
        try:
            if not self._capture.grab():
                return None
        except cv2.error:  # a driver that lost its device
            return None
        now = time.monotonic()
        self._grabbed += 1
        told = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
        if self._camera:
            self.stamped = 0 <= now - told < LATEST_STAMP_S
            return told if self.stamped else now
        if self.live:
            return now
        # A file that tells no times, or some that go backwards, plays at its rate.
        self._last_s = told if math.isfinite(told) and told > self._last_s else self._last_s + self.period_s
        return self._last_s

    def retrieve(self) -> Picture:
        """Decode what was grabbed last, in RGB."""
        try:
            decoded, picture = self._capture.retrieve()
        except cv2.error:  # cut off on its way from the camera
            decoded, picture = False, None
        if not decoded or picture is None or picture.dtype not in (np.uint8, np.uint16):
            raise InputError(
                f"{self.name} gave a picture that cannot be decoded: check the cable, or convert the video"
            )
        result: Picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB) if picture.shape[2:] == (3,) else np.squeeze(picture)
        return result

    @property
    def ended(self) -> str:
        """Why there is no further picture, if this is a file's end."""
        if self.live and not 0 < self._count <= self._grabbed:
            return ""
        missing = self._count - self._grabbed
        cut = (
            f" of the {self._count} that it says it has; it may be cut off" if missing > self._count * CUT_SHARE else ""
        )
        return f"{self.name} ended after {self._grabbed} pictures{cut}"

    @property
    def settings(self) -> dict[str, float]:
        """What the driver tells; of a file or stream, its rate alone."""
        return read_settings(self._capture) if self._camera else {"fps": round(1 / self.period_s, 6)}

    def close(self) -> None:
        """Let it go."""
        self._capture.release()


def _open(name: str, camera: bool) -> cv2.VideoCapture:
    try:
        if URL.match(name):
            limits = [
                cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
                NETWORK_LIMIT_MS,
                cv2.CAP_PROP_READ_TIMEOUT_MSEC,
                NETWORK_LIMIT_MS,
            ]
            return cv2.VideoCapture(name, cv2.CAP_FFMPEG, limits)
        if camera:
            return cv2.VideoCapture(int(name)) if name.isdecimal() else cv2.VideoCapture(name, cv2.CAP_V4L2)
        # Not any backend: for left01.png one of them would go on with left02.png.
        return cv2.VideoCapture(name, cv2.CAP_FFMPEG)
    except (cv2.error, OverflowError, ValueError):  # a number that no camera can have
        return cv2.VideoCapture()
