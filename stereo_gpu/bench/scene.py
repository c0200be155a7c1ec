"""What the benchmark runs on: a pair with known disparities, two cameras, and a mesh to texture."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from stereo_gpu.errors import InputError
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.types import Bytes, Floats, Ints, RectifiedPair
from stereo_gpu.unwrap import Unwrapped

LARGEST_SIDE = 16_384  # px
NEAREST, FARTHEST = 0.8, 0.1  # disparity at the bottom and at the top, as a share of the range
BASELINE = 100.0  # mm
FACES = 50_000  # of the mesh, as `reconstruct` makes it


@dataclass(frozen=True, kw_only=True)
class BenchScene:
    """One size of the benchmark's input: random texture on a slope, 8 bits.

    Args:
        width, height: px.
        disparities: how many are searched, from 0.
        window: side of the window, px.
        left, right: the rectified pair, (H, W), grey.
        disparity: (H, W) float32, the truth on the right view, px.
        rig: two cameras with lens distortion that take pictures of this size.
    """

    width: int
    height: int
    disparities: int
    window: int
    left: Bytes
    right: Bytes
    disparity: Floats
    rig: Rig

    @property
    def colour(self) -> tuple[Bytes, Bytes]:
        """The pair as (H, W, 3)."""
        return cv2.cvtColor(self.left, cv2.COLOR_GRAY2RGB), cv2.cvtColor(self.right, cv2.COLOR_GRAY2RGB)

    @property
    def pair(self) -> RectifiedPair:
        """The pair with the geometry of its cameras."""
        middle = (self.width - 1) / 2
        return RectifiedPair.from_geometry(
            left=self.left,
            right=self.right,
            focal_px=float(self.width),
            baseline=BASELINE,
            cx_left=middle,
            cx_right=middle,
            cy=(self.height - 1) / 2,
        )


def build_bench_scene(width: int, height: int, disparities: int, window: int) -> BenchScene:
    """Make the input of one size.

    Raises:
        InputError: a size that OpenCV's StereoBM, the peer, does not take, or that is too large.
    """
    check_bench_size(width, height, disparities, window)
    noise = np.random.default_rng(0).integers(0, 256, (height, width + disparities)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    slope = np.linspace(FARTHEST, NEAREST, height, dtype=np.float32)[:, None] * disparities
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    left = cv2.remap(texture, np.maximum(x - slope + disparities, 0), y, cv2.INTER_LINEAR)
    return BenchScene(
        width=width,
        height=height,
        disparities=disparities,
        window=window,
        left=left,
        right=np.ascontiguousarray(texture[:, disparities : disparities + width]),
        disparity=np.ascontiguousarray(np.broadcast_to(slope, (height, width))),
        rig=_rig(width, height),
    )


def check_bench_size(width: int, height: int, disparities: int, window: int) -> None:
    """Refuse a size that cannot be compared with StereoBM.

    Raises:
        InputError: with what it takes.
    """
    if disparities < 16 or disparities % 16 or window < 5 or window % 2 == 0 or window > 31:
        raise InputError(
            f"{disparities} disparities and window {window}: StereoBM takes a multiple of 16, and 5 to 31, odd"
        )
    if not (disparities + window < width <= LARGEST_SIDE and window < height <= LARGEST_SIDE):
        raise InputError(
            f"size {width} x {height}: give more px than disparities and window take, at most {LARGEST_SIDE} a side"
        )


def mesh_of(scene: BenchScene) -> Unwrapped:
    """A mesh of the slope of about FACES triangles, laid out on an atlas of the picture's size."""
    step = max(1.0, (2 * scene.width * scene.height / FACES) ** 0.5)
    columns, rows = (max(2, round(side / step)) for side in (scene.width, scene.height))
    x, y = np.meshgrid(np.linspace(1, scene.width - 2, columns), np.linspace(1, scene.height - 2, rows))
    pair = scene.pair
    depth = pair.focal_px * BASELINE / scene.disparity[np.round(y).astype(int), np.round(x).astype(int)]
    vertices = np.stack(
        [(x - pair.cx_right) * depth / pair.focal_px + BASELINE, (y - pair.cy) * depth / pair.focal_px, depth], axis=-1
    )
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + columns, corner + 1], axis=1),
            np.stack([corner + 1, corner + columns, corner + columns + 1], axis=1),
        ]
    )
    uv = np.stack([(x + 0.5) / scene.width, (y + 0.5) / scene.height], axis=-1)
    kept: Ints = np.arange(rows * columns, dtype=np.int32)
    return Unwrapped(
        vertices=vertices.reshape(-1, 3).astype(np.float32),
        faces=faces.astype(np.int32),
        uv=uv.reshape(-1, 2).astype(np.float32),
        vertex_map=kept,
        size=(scene.width, scene.height),
        method="view",
    )


def _rig(width: int, height: int) -> Rig:
    focal, middle = float(width), ((width - 1) / 2, (height - 1) / 2)

    def camera(shift: float, lens: tuple[float, ...]) -> Camera:
        matrix = np.array([[focal, 0, middle[0] + shift], [0, focal, middle[1] - shift], [0, 0, 1.0]])
        return Camera(matrix, np.array(lens), (width, height))

    rotation = cv2.Rodrigues(np.array([0.005, 0.03, -0.004]))[0]
    return Rig(
        left=camera(3.0, (-0.25, 0.07, 0.0007, -0.0004, 0.0)),
        right=camera(-4.0, (-0.24, 0.06, -0.0005, 0.0006, 0.0)),
        R=rotation,
        T=-rotation @ np.array([BASELINE, 1.0, -1.0]),
    )
