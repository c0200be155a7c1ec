"""OpenCV's YAML, XML and JSON, as cv2.FileStorage writes them: two cameras, R and T under one of many names.

Read by our own parsers, since cv2.FileStorage overflows its stack on files that are nested deeply.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.draft import Draft, DraftCamera, Size
from stereo_gpu.rig_files.tree import Tree, matrix, number, whole
from stereo_gpu.types import Doubles

# Names are compared in small letters, without any other sign: cameraMatrix1, camera_matrix_1 and CAMERA_MATRIX_1.
SIDES = (("1", "2"), ("left", "right"), ("l", "r"), ("0", "1"))
MATRICES = ("m", "k", "cameramatrix", "cm", "mtx", "intrinsicmatrix", "intrinsics", "intrinsic", "a")
LENSES = (
    "d",
    "distcoeffs",
    "distcoeff",
    "distcoefs",
    "distortioncoefficients",
    "distortion",
    "dist",
    "distcoeffsmatrix",
)
ROTATIONS = ("r", "rotation", "rotationmatrix")
TRANSLATIONS = ("t", "translation", "translationvector", "tvec")
SIZES = ("imagesize", "size", "framesize", "resolution")
WIDTHS, HEIGHTS = ("imagewidth", "width", "framewidth"), ("imageheight", "height", "frameheight")
RMS = ("rmspx", "reprojectionerror", "avgreprojectionerror", "rms")
LENS_SHAPES = tuple((count,) for count in (4, 5, 8, 12, 14))
NAMES_TOLD = "M1 D1 M2 D2 R T, as OpenCV's stereo_calib sample writes, or K1, cameraMatrix1, camera_matrix_left"


def read_opencv(trees: Sequence[Tree]) -> Draft:
    """A rig from one file, or from two such as intrinsics.yml and extrinsics.yml.

    Raises:
        InputError: a part is missing, stands twice or is no such matrix.
    """
    found = _Names(trees)
    sides = next((pair for pair in SIDES if all(found.has(_sided(MATRICES, side)) for side in pair)), None)
    if sides is None:
        raise InputError(f"it does not hold two cameras: it needs {NAMES_TOLD}")
    cameras = [
        DraftCamera(
            matrix=found.matrix(_sided(MATRICES, side), (3, 3)),
            distortion=found.matrix(_sided(LENSES, side), *LENS_SHAPES),
            size=found.size(side),
            rms_px=found.number(_sided(RMS, side), 0.0) or found.number(_sided(RMS, short), 0.0),
        )
        for side, short in zip(sides, ("l", "r"), strict=True)
    ]
    return Draft(
        left=cameras[0],
        right=cameras[1],
        R=found.matrix(ROTATIONS, (3, 3)),
        T=found.matrix(TRANSLATIONS, (3,)),
        unit=found.text(("unit",)),
        rms_px=found.number(RMS, 0.0),
        epipolar_rms_px=found.number(("epipolarrmspx",), 0.0),
    )


def _sided(names: Sequence[str], side: str) -> tuple[str, ...]:
    """Each name with the side behind it, then before it."""
    return tuple(f"{name}{side}" for name in names) + tuple(f"{side}{name}" for name in names)


class _Names:
    """What the files hold, under the plain forms of its names."""

    def __init__(self, trees: Sequence[Tree]) -> None:
        self._values: dict[str, list[tuple[str, Tree]]] = {}
        for tree in trees:
            if not isinstance(tree, dict):
                raise InputError(f"it holds no named values: it needs {NAMES_TOLD}")
            for name, value in _flatten("", tree):
                self._values.setdefault(re.sub(r"[^a-z0-9]", "", name.lower()), []).append((name, value))

    def has(self, names: Sequence[str]) -> bool:
        """Whether one of the names is there."""
        return any(name in self._values for name in names)

    def find(self, names: Sequence[str]) -> tuple[str, Tree] | None:
        """The name as written, and the value, of the first of `names` that is there."""
        hits = next((self._values[name] for name in names if name in self._values), None)
        if hits is None:
            return None
        if any(value != hits[0][1] for _, value in hits):
            raise InputError(f"{hits[0][0]:.40} stands twice with two values: delete one of them")
        return hits[0]

    def matrix(self, names: Sequence[str], *shapes: tuple[int, ...]) -> Doubles:
        """The matrix of one of the names."""
        hit = self.find(names)
        if hit is None:
            raise InputError(f"it has no {names[0].upper()}: it needs {NAMES_TOLD}")
        return matrix(hit[0], hit[1], *shapes)

    def number(self, names: Sequence[str], default: float) -> float:
        """The number of one of the names; a list of them, such as one for each view, is passed over."""
        hit = self.find(names)
        return number(*hit) if hit is not None and isinstance(hit[1], str) else default

    def text(self, names: Sequence[str]) -> str | None:
        """The text of one of the names."""
        hit = self.find(names)
        return hit[1] if hit is not None and isinstance(hit[1], str) else None

    def size(self, side: str) -> Size | None:
        """Width and height of one side's pictures, or of both sides'."""
        for sizes, widths, heights in (
            (_sided(SIZES, side), _sided(WIDTHS, side), _sided(HEIGHTS, side)),
            (SIZES, WIDTHS, HEIGHTS),
        ):
            both, wide, high = self.find(sizes), self.find(widths), self.find(heights)
            if both is not None:
                width, height = matrix(both[0], both[1], (2,)).tolist()
                return whole(both[0], width), whole(both[0], height)
            if wide is not None and high is not None:
                return whole(wide[0], number(*wide)), whole(high[0], number(*high))
        return None


def _flatten(before: str, tree: dict[str, Tree]) -> list[tuple[str, Tree]]:
    """Names and values, those of nested mappings with the outer name before them; matrices stay whole."""
    found: list[tuple[str, Tree]] = []
    for name, value in tree.items():
        if isinstance(value, dict) and "data" not in value:
            found += _flatten(f"{before}{name}.", value)
        else:
            found.append((f"{before}{name}", value))
    return found
