"""The real pairs whose disparities are known: pictures, truth, and which pixels count."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.masks import read_mask
from stereo_gpu.evaluation.scores import Mask
from stereo_gpu.evaluation.truth import read_truth
from stereo_gpu.images import read_image
from stereo_gpu.types import Doubles, Floats, Picture


@dataclass(frozen=True, kw_only=True)
class TruePair:
    """A rectified pair with the truth of its left view.

    Args:
        name: as PAIRS has it.
        left, right: pictures.
        truth: (H, W) float32, px; NaN where it is not known.
        masks: (H, W) bool by name, the pixels to count: "all", and where the data tells them apart "nonocc" (both
            cameras see it) and "disc" (near a jump in depth, and seen by both).
        search: smallest disparity and how many to search, as the benchmark has it or next to that.
        published: maps of others on this pair, (H, W) px, by the name of their method.
        depth: takes disparities to depth in mm, where the camera is known.
    """

    name: str
    left: Picture
    right: Picture
    truth: Floats
    masks: dict[str, Mask]
    search: tuple[int, int]
    published: dict[str, Floats]
    depth: Callable[[Floats], Doubles] | None = None

    @property
    def span(self) -> tuple[float, float]:
        """Smallest and largest true disparity, px."""
        return float(np.nanmin(self.truth)), float(np.nanmax(self.truth))

    @property
    def mask(self) -> str:
        """The mask that bad pixels are counted over first: "nonocc" where there is one."""
        return "nonocc" if "nonocc" in self.masks else "all"


@dataclass(frozen=True)
class _Place:
    """Where a pair lies in the folder of real pictures.

    Args:
        folder, left, right, truth: its files.
        scale: what the truth's file holds for one px.
        search: see TruePair.
    """

    folder: str
    left: str
    right: str
    truth: str
    scale: float
    search: tuple[int, int]


_PLACES = {
    "tsukuba": _Place("stereo/tsukuba", "im3.png", "im4.png", "groundtruth.png", 16, (0, 16)),
    "teddy": _Place("stereo/teddy", "im2.png", "im6.png", "groundtruth.png", 4, (0, 64)),
    "motorcycle": _Place(
        "stereo/motorcycle", "motorcycle_left.png", "motorcycle_right.png", "motorcycle_disp.npz", 1, (0, 64)
    ),
    "aloe": _Place("stereo/aloe_light", "left.png", "right.png", "groundtruth.png", 256, (0, 80)),
    "aloe, other exposure": _Place(
        "stereo/aloe_light", "left.png", "right_exposure.png", "groundtruth.png", 256, (0, 80)
    ),
    "aloe, other light": _Place("stereo/aloe_light", "left.png", "right_light.png", "groundtruth.png", 256, (0, 80)),
}
PAIRS = tuple(_PLACES)
MASKS = ("nonocc", "all", "disc")
PUBLISHED = "PatchMatch Stereo, published map"


def load_pair(data: Path, name: str) -> TruePair:
    """Read a pair.

    Args:
        data: the folder of real pictures, which CONTRIBUTING.md describes.
        name: one of PAIRS.

    Raises:
        InputError: there is no such pair, or a file is missing or damaged.
    """
    if name not in _PLACES:
        raise InputError(f"pair {name!r:.40}: it must be one of {'; '.join(PAIRS)}")
    place = _PLACES[name]
    folder = data / place.folder
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder: set STEREO_GPU_DATA to the folder of real pictures")
    left, right = (read_image(folder / file) for file in (place.left, place.right))
    masks: dict[str, Mask] = {"all": np.ones(left.shape[:2], np.bool_)}
    masks |= {name: read_mask(folder / f"{name}.png") for name in MASKS if (folder / f"{name}.png").is_file()}
    camera, map_of_others = folder / "calib.json", folder / "alg117.png"
    return TruePair(
        name=name,
        left=left,
        right=right,
        truth=read_truth(folder / place.truth, place.scale),
        masks=masks,
        search=place.search,
        published={PUBLISHED: read_truth(map_of_others, place.scale)} if map_of_others.is_file() else {},
        depth=_depth(camera) if camera.is_file() else None,
    )


def _depth(camera: Path) -> Callable[[Floats], Doubles]:
    """Middlebury 2014: Z = baseline * focal / (disparity + doffs)."""
    known = json.loads(camera.read_text("utf-8"))
    scale, offset = known["baseline_mm"] * known["focal_px"], known["doffs_px"]
    return lambda disparity: np.asarray(scale / (disparity.astype(np.float64) + offset))
