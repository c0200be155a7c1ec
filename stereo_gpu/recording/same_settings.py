"""Do both cameras run alike? What differs, in words, with the way out.

Correlation forgives a difference in brightness, but not in sharpness, and a texture shows a difference in colour;
the paper (Medina-Zegarra and Lobaton 2011, section 2) sets both cameras alike by hand. What a driver tells is compared
as it is; what it does not tell is estimated from a pair of pictures, which show about the same things.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import cv2
import numpy as np

from stereo_gpu.images import grey
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.types import Doubles, Picture

UNLIKE = 1.1  # values of a driver: steps of one setting are finer than this
BRIGHTER = 1.35  # mean brightness: two views of one scene 0.1 of its width apart differ by less
SHARPER = 1.8  # share of fine detail in all detail
MORE_COLOUR = 1.2  # red or blue against green
DARK = 4  # of 255: a picture so dark on average tells nothing but that
WORKING_WIDTH = 640  # px: sharpness is compared on copies of this size, since noise is finer

VALUE_OPTIONS = {
    "fps": ("runs at {a:g} pictures a second, the {other} one at {b:g}", "--fps"),
    "exposure": ("exposes {ratio:.2g} times as long as the {other} one", "--exposure"),
    "gain": ("has a gain of {a:g}, the {other} one of {b:g}", "--gain"),
    "focus": ("is focused at {a:g}, the {other} one at {b:g}", "--focus"),
    "white_balance": ("has its white balance at {a:g}, the {other} one at {b:g}", "--white-balance"),
}
AUTOMATIC_NAMES = {
    "auto_exposure": "exposure",
    "auto_focus": "focus",
    "auto_white_balance": "white balance",
}


def compare_settings(left: Mapping[str, float], right: Mapping[str, float]) -> list[str]:
    """What the drivers tell that differs, a sentence each.

    Args:
        left, right: values by the names of `CameraSettings`, and `auto_...`; what a driver does not tell is missing.
    """
    found = []
    for name, (text, option) in VALUE_OPTIONS.items():
        if name not in left or name not in right or left[name] == right[name]:
            continue
        a, b = left[name], right[name]
        side, other = ("left", "right")
        if b > a:
            a, b, side, other = b, a, other, side
        if b > 0 and a / b < UNLIKE:
            continue
        if name == "exposure" and b <= 0:  # a driver that counts in powers of two
            text = "has an exposure of {a:g}, the {other} one of {b:g}"
        told = text.format(a=a, b=b, ratio=a / b if b > 0 else 0.0, other=other)
        found.append(f"the {side} camera {told}: set both alike with {option}")
    for name, what in AUTOMATIC_NAMES.items():
        if name in left and name in right and left[name] != right[name]:
            found.append(
                f"automatic {what} is on in one camera and off in the other, or of another kind: turn it off in both"
                " with --lock"
            )
    return found


def look_at(frame: StereoFrame) -> Doubles:
    """(2, 4): of the left and right picture, brightness, share of fine detail, red and blue against green."""
    return np.array([_look(picture) for picture in (frame.left, frame.right)])


def compare_looks(looks: Sequence[Doubles], told: Collection[str] = ()) -> list[str]:
    """What differs between the two cameras' pictures, a sentence each.

    Args:
        looks: at a few moments, by `look_at`; their medians are compared.
        told: what both cameras' drivers tell, which needs no estimate: "exposure" with "gain", "focus",
            "white_balance".
    """
    brightness, detail, red, blue = np.median(np.array(looks), axis=0).T
    found = []
    dark = [side for side, value in zip(("left", "right"), brightness, strict=True) if value < DARK]
    if dark:
        return [f"the {' and the '.join(dark)} picture is black: take the cap off, or light the scene"]
    if not {"exposure", "gain"} <= set(told):
        found += _unlike(
            brightness,
            BRIGHTER,
            "pictures are {ratio:.1f} times as bright as",
            "set both alike with --exposure and --gain",
        )
    if "focus" not in told:
        found += _unlike(
            detail,
            SHARPER,
            "pictures are {ratio:.1f} times as sharp as",
            "focus both on the object, and wipe the lenses",
        )
    if "white_balance" not in told:
        for name, values in (("redder", red), ("bluer", blue)):
            found += _unlike(
                values,
                MORE_COLOUR,
                f"pictures are {{ratio:.1f}} times {name} than",
                "set both alike with --white-balance",
            )
    return found


def _unlike(values: Doubles, limit: float, text: str, way_out: str) -> list[str]:
    if not (np.isfinite(values).all() and values.min() > 0):
        return []
    ratio = float(values.max() / values.min())
    if ratio < limit:
        return []
    side = int(values.argmax())
    names = ("left", "right")
    return [f"the {names[side]} camera's {text.format(ratio=ratio)} those of the {names[1 - side]} one: {way_out}"]


def _look(picture: Picture) -> tuple[float, float, float, float]:
    """Mean brightness, share of fine detail, red and blue against green; NaN where there is no such thing."""
    flat = grey(picture)
    scale = WORKING_WIDTH / flat.shape[1]
    small = cv2.resize(flat, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else flat
    coarse = cv2.GaussianBlur(small, (0, 0), 2.0).astype(np.float32)
    fine = cv2.GaussianBlur(small, (0, 0), 0.8).astype(np.float32) - coarse
    spread = float(coarse.std())
    detail = float(fine.std()) / spread if spread > 1 else np.nan
    if picture.ndim == 2:
        return float(flat.mean()), detail, np.nan, np.nan
    red, green, blue = (float(value) for value in cv2.mean(picture)[:3])
    return float(flat.mean()), detail, red / green if green > 0 else np.nan, blue / green if green > 0 else np.nan
