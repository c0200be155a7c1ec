"""What the benchmark times: every kernel within the stage that launches it, and every profile."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.bench import peers
from stereo_gpu.bench.peers import Peer
from stereo_gpu.bench.scene import BenchScene, mesh_of
from stereo_gpu.config import PROFILES, MatchOptions, Profile
from stereo_gpu.device_match import download_disparity, match_on
from stereo_gpu.flat_surfaces import Surroundings, settle
from stereo_gpu.match_options import choose_options
from stereo_gpu.meshing.bounded_mesh import bounded_triangles
from stereo_gpu.prepare import GreyLevels, Levels, make_grey, sum_windows
from stereo_gpu.rectify import plan_rectification, rectify_on
from stereo_gpu.render import render
from stereo_gpu.smooth_paths import prepare_path_view
from stereo_gpu.texture import bake_texture
from stereo_gpu.timing import Stopwatch
from stereo_gpu.triangulate import triangulate_on
from stereo_gpu.types import Mesh, View
from stereo_gpu.windows import match_windows
from stereo_gpu.winners import Winners

Stage = Callable[[Backend, BenchScene], object]


@dataclass(frozen=True, kw_only=True)
class KernelCase:
    """A kernel to time.

    Args:
        name: of the case; the kernel's, and what is special.
        kernel: the kernel.
        stage: the library's own code that launches it, on the benchmark's input.
        per: what its work grows with: "cell" (pixel and disparity) or "pixel" (of the picture or the atlas).
        peer: the OpenCV function that does the same, where there is one.
        launches: how many launches make one pass.
        after: a slow kernel that must run once to make its input; empty where what comes before is quick.
        operations: additions, multiplications and comparisons for each cell or pixel that the formula needs, with
            running sums for windows; given the window's side. None where it depends on what the pictures show.
    """

    name: str
    kernel: str
    stage: Stage
    per: Literal["cell", "pixel"] = "pixel"
    peer: Peer | None = None
    launches: int = 1
    after: str = ""
    operations: Callable[[int], float] | None = None


@dataclass(frozen=True, kw_only=True)
class ProfileCase:
    """A whole call of `sg.match`, arrays of the host in and out."""

    profile: Profile
    peer: Peer

    @property
    def name(self) -> str:
        """As the benchmark's rows call it."""
        return f"match {self.profile}"


def options_of(profile: Profile, scene: BenchScene) -> MatchOptions:
    """The profile's options with the benchmark's window."""
    return dataclasses.replace(PROFILES[profile], window=scene.window)


def _matching(profile: Profile) -> Stage:
    def stage(device: Backend, scene: BenchScene) -> Winners:
        everywhere = device.upload(np.ones((scene.height, scene.width), np.uint8))
        return match_on(
            device,
            device.upload(scene.left),
            device.upload(scene.right),
            levels=(Levels(), Levels()),
            masks=(everywhere, everywhere),
            smallest=0,
            disparities=scene.disparities,
            reference=View.RIGHT,
            options=options_of(profile, scene),
            watch=Stopwatch(),
        )

    return stage


def _preparing(colour: bool, smooth: bool) -> Stage:
    def stage(device: Backend, scene: BenchScene) -> object:
        options = options_of(Profile.FAST, scene)
        if smooth:
            options = dataclasses.replace(options, smooth_sigma=peers.SMOOTH_SIGMA)
        everywhere = device.upload(np.ones((scene.height, scene.width), np.uint8))
        picture = device.upload(scene.colour[1] if colour else scene.right)
        return sum_windows(device, make_grey(device, picture, GreyLevels(), options), everywhere, options)

    return stage


def _rectifying(colour: bool) -> Stage:
    def stage(device: Backend, scene: BenchScene) -> object:
        left, right = scene.colour if colour else (scene.left, scene.right)
        return rectify_on(device, left, right, scene.rig, plan_rectification(scene.rig))

    return stage


def _path_view(device: Backend, scene: BenchScene) -> object:
    # Not the whole match, which asks for a volume's memory: this comes before that is taken.
    everywhere = device.upload(np.ones((scene.height, scene.width), np.uint8))
    options = options_of(Profile.PRECISE, scene)
    return prepare_path_view(device, device.upload(scene.colour[1]), Levels(), everywhere, options, coloured=True)


def _choosing(device: Backend, scene: BenchScene) -> object:
    options = choose_options(Profile.FAST, "auto")
    mask = device.upload(np.ones((scene.height, scene.width), np.uint8))
    pictures = device.upload(scene.right), device.upload(scene.left)
    levels = Levels(), Levels()
    search = {"smallest": 0, "disparities": scene.disparities, "direction": 1}
    return match_windows(device, pictures, levels, (mask, mask), search, options, Stopwatch())


def _downloading(profile: Profile) -> Stage:
    def stage(device: Backend, scene: BenchScene) -> object:
        found = _matching(profile)(device, scene)
        assert isinstance(found, Winners)
        options = options_of(profile, scene)
        return download_disparity(device, found, 0, scene.disparities, View.RIGHT, profile, options, Stopwatch())

    return stage


def _settling(device: Backend, scene: BenchScene) -> object:
    # All pixels of a map, each sample with its weight: the longest launch of evidence.
    shape = scene.height, scene.width
    left, right = (picture.astype(np.float32) - 128 for picture in (scene.left, scene.right))
    around = Surroundings(
        reference=device.upload(right),
        other=device.upload(left),
        guide=device.upload(np.broadcast_to(scene.right, (3, *shape)).copy()),
        direction=1,
    )
    found = Winners(
        values=device.upload(scene.disparity),
        validity=device.zeros(shape, np.uint8),
        score=device.zeros(shape, np.float32),
        ratio=device.zeros(shape, np.float32),
        noise=1.0,
    )
    return settle(device, found, around)


def _triangulating(device: Backend, scene: BenchScene) -> object:
    return triangulate_on(device, device.upload(scene.disparity), View.RIGHT, scene.pair)


def _meshing(device: Backend, scene: BenchScene) -> object:
    return bounded_triangles(device, scene.disparity, error_px=0.25, max_jump_px=3.0)


def _baking(device: Backend, scene: BenchScene) -> object:
    return bake_texture(device, device.upload(scene.colour[1]), 1.0, mesh_of(scene), scene.pair, View.RIGHT)


def _drawing(device: Backend, scene: BenchScene) -> object:
    laid = mesh_of(scene)
    mesh = Mesh(vertices=laid.vertices, faces=laid.faces, uv=laid.uv, texture=scene.colour[1])
    return render(mesh, size=(scene.width, scene.height), yaw=20.0, pitch=8.0, device=device)


def _correcting(device: Backend, scene: BenchScene) -> object:
    # Half a texel off the pixels, where drawing the model blurs.
    mesh = mesh_of(scene)
    shifted = dataclasses.replace(mesh, uv=mesh.uv + np.float32(0.5) / np.array(mesh.size, np.float32))
    return bake_texture(device, device.upload(scene.colour[1]), 1.0, shifted, scene.pair, View.RIGHT)


def _constant(operations: float) -> Callable[[int], float]:
    return lambda window: operations


_FAST, _PAPER, _PRECISE = (_matching(profile) for profile in (Profile.FAST, Profile.PAPER, Profile.PRECISE))

KERNELS = (
    # The product, its place in two running sums (2 + 2), the score (4), two comparisons.
    KernelCase(
        name="ncc_wta",
        kernel="ncc_wta",
        stage=_FAST,
        per="cell",
        peer=peers.STEREO_BM,
        operations=_constant(11),
    ),
    KernelCase(name="ncc_volume", kernel="ncc_volume", stage=_PAPER, per="cell", operations=_constant(9)),
    # A peak is told from its neighbours, and held against the best and the second best; the other view's winner.
    KernelCase(name="wta", kernel="wta", stage=_PAPER, per="cell", after="ncc_volume", operations=_constant(5)),
    KernelCase(name="masked", kernel="masked", stage=_path_view, operations=_constant(1)),
    # Of each plane a product, two sums, two comparisons.
    KernelCase(name="guide", kernel="guide", stage=_path_view, operations=_constant(15)),
    # Each of 24 bits: a comparison, and its place in the number.
    KernelCase(name="census", kernel="census", stage=_path_view, operations=_constant(48)),
    # Bits: a difference, a count. Three colours: a difference, its sign, the sum, its end. Two parabolas, their sum.
    KernelCase(name="match_cost", kernel="match_cost", stage=_PRECISE, per="cell", operations=_constant(20)),
    # All three headings. Of each of 8 paths four ways to come from, the smallest of them and of the row, the cost, and
    # the sum.
    KernelCase(
        name="aggregate",
        kernel="aggregate",
        stage=_PRECISE,
        per="cell",
        launches=3,
        after="match_cost",
        operations=_constant(64),
    ),
    # A comparison for the lowest sum, one for its place, one for the lowest one elsewhere.
    KernelCase(name="lowest", kernel="lowest", stage=_PRECISE, per="cell", after="aggregate", operations=_constant(3)),
    KernelCase(name="merge", kernel="merge", stage=_PRECISE, after="aggregate"),
    KernelCase(name="agree", kernel="agree", stage=_PRECISE, peer=peers.VALIDATE, after="aggregate"),
    KernelCase(name="rectify", kernel="rectify", stage=_rectifying(colour=False), peer=peers.REMAP),
    KernelCase(name="rectify RGB", kernel="rectify", stage=_rectifying(colour=True), peer=peers.REMAP_COLOUR),
    KernelCase(
        name="grey",
        kernel="grey",
        stage=_preparing(colour=True, smooth=False),
        peer=peers.CVT_COLOR,
        operations=_constant(9),
    ),
    # Two passes over 7 weights.
    KernelCase(
        name="smooth",
        kernel="smooth",
        stage=_preparing(colour=False, smooth=True),
        peer=peers.GAUSSIAN_BLUR,
        launches=2,
        operations=_constant(28),
    ),
    # A square, two running sums in two directions, the norm.
    KernelCase(
        name="window_norms",
        kernel="window_norms",
        stage=_preparing(colour=False, smooth=False),
        peer=peers.BOX_FILTERS,
        operations=_constant(15),
    ),
    KernelCase(name="consistency", kernel="consistency", stage=_FAST, peer=peers.VALIDATE),
    KernelCase(name="median", kernel="median", stage=_FAST, peer=peers.MEDIAN_BLUR),
    KernelCase(name="support", kernel="support", stage=_FAST),
    KernelCase(name="vote", kernel="vote", stage=_PRECISE, after="aggregate"),
    KernelCase(name="guided_support", kernel="guided_support", stage=_PRECISE, after="aggregate"),
    KernelCase(name="cells", kernel="cells", stage=_PRECISE, after="aggregate"),
    KernelCase(name="planes", kernel="planes", stage=_PRECISE, after="aggregate"),
    # Whether a pixel counts (2), its place in two running sums in two directions (4), the share.
    KernelCase(name="agreement", kernel="agreement", stage=_PRECISE, after="aggregate", operations=_constant(7)),
    KernelCase(name="flat", kernel="flat", stage=_PRECISE, after="aggregate"),
    # Two running sums in two directions (4), whether they are enough (2).
    KernelCase(name="majority", kernel="majority", stage=_PRECISE, after="aggregate", operations=_constant(6)),
    # Two comparisons, and the choice.
    KernelCase(name="unfilled", kernel="unfilled", stage=_PRECISE, after="aggregate", operations=_constant(3)),
    KernelCase(name="plane_fit", kernel="plane_fit", stage=_PRECISE, after="aggregate"),
    # Of each side a difference and its slope; both held against each other and the largest.
    KernelCase(name="slopes", kernel="slopes", stage=_settling, operations=_constant(20)),
    # 25 samples: their place (6), the other view there and how it rises (11), both rises (3), three differences of
    # colours and their weight (15), six weighted sums (14).
    KernelCase(name="evidence", kernel="evidence", stage=_settling, operations=_constant(25 * 49)),
    KernelCase(name="choose", kernel="choose", stage=_choosing),
    KernelCase(name="fill", kernel="fill", stage=_FAST),
    KernelCase(name="confidence", kernel="confidence", stage=_downloading(Profile.FAST), operations=_constant(6)),
    KernelCase(
        name="certainty",
        kernel="certainty",
        stage=_downloading(Profile.PRECISE),
        after="aggregate",
        operations=_constant(6),
    ),
    KernelCase(
        name="triangulate",
        kernel="triangulate",
        stage=_triangulating,
        peer=peers.REPROJECT,
        operations=_constant(9),
    ),
    # 12 levels, on a slope that is split only where the picture ends. A pixel of each: its place on the plane (4), two
    # comparisons.
    KernelCase(
        name="split_triangles",
        kernel="split_triangles",
        stage=_meshing,
        launches=12,
        operations=_constant(12 * 6),
    ),
    KernelCase(name="decode", kernel="decode", stage=_baking),
    KernelCase(name="cover", kernel="cover", stage=_baking),
    KernelCase(name="place", kernel="place", stage=_baking),
    # Shares of 4 + 4 pixels (26), 16 + 4 products and their sums in three colours (117), what is added (15).
    KernelCase(name="bake", kernel="bake", stage=_baking, operations=_constant(158)),
    # In three colours 6 products and their sums (27), the difference (9).
    KernelCase(name="residual", kernel="residual", stage=_correcting, operations=_constant(36)),
    KernelCase(name="pull", kernel="pull", stage=_baking),
    KernelCase(name="push", kernel="push", stage=_baking),
    KernelCase(name="encode", kernel="encode", stage=_baking),
    KernelCase(name="rasterise", kernel="rasterise", stage=_drawing),
    KernelCase(name="shade", kernel="shade", stage=_drawing),
)
MATCHES = (
    ProfileCase(profile=Profile.FAST, peer=peers.CHECKED_BM),
    ProfileCase(profile=Profile.PAPER, peer=peers.STEREO_BM),
    ProfileCase(profile=Profile.PRECISE, peer=peers.SGBM_HH),
)
# Kernels that are timed for the roofline alone.
YARDSTICKS = ("multiply_add",)
