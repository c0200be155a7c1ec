"""The whole job, a stage a line: from a raw pair and its rig, or from a rectified pair, to a textured mesh."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

from stereo_gpu.advice import find_warnings
from stereo_gpu.backends import Backend, open_backend
from stereo_gpu.close_holes import close_holes
from stereo_gpu.config import Checking, MeshOptions
from stereo_gpu.disparity_range import find_range
from stereo_gpu.images import check_pair
from stereo_gpu.inputs import Source, describe, hash_array, read_source
from stereo_gpu.job import Job, Rectangle, check_against, parse_check, plan_job
from stereo_gpu.known_distance import KnownDistance, scale_to
from stereo_gpu.level_spikes import level_spikes
from stereo_gpu.match_options import Range, Window
from stereo_gpu.model import Show, build_model
from stereo_gpu.model_files.frame import check_shown
from stereo_gpu.prepare import find_levels, grey_scale
from stereo_gpu.rectify import DevicePair, check_sizes, download_pair, plan_rectification, rectify_on
from stereo_gpu.result import Reconstruction
from stereo_gpu.rig import Rig
from stereo_gpu.rig_check import RigCheck, Verdict, check_rig, ideal_rig, refuse_bad, unchecked
from stereo_gpu.row_check import check_rows
from stereo_gpu.self_calibrate import Known, RigFound, self_calibrate
from stereo_gpu.tiles import match_in_tiles
from stereo_gpu.timing import Stopwatch
from stereo_gpu.triangulate import triangulate_on
from stereo_gpu.types import UNSCALED, Bytes, Disparity, Floats, Picture, RectifiedPair, View
from stereo_gpu.unwrap import warm_up
from stereo_gpu.wanted import cut_depth, find_wanted

STAGES = (
    "read",
    "rig",
    "check",
    "rectify",
    "mask",
    "range",
    "match",
    "close",
    "triangulate",
    "mesh",
    "smooth",
    "decimate",
    "unwrap",
    "texture",
)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """How the two cameras stand.

    Args:
        rig: of the raw pictures.
        checking: how it is checked.
        checked: what they tell of it; None where the map is to tell.
        ignore_check: whether to go on with a rig that does not fit.
        found: how it was had, if it was made from them.
        distance: what sets the scale, where neither rig nor baseline does.
    """

    rig: Rig
    checking: Checking
    checked: RigCheck | None
    ignore_check: bool
    found: RigFound | None = None
    distance: KnownDistance | None = None


def reconstruct(
    left: Source,
    right: Source,
    rig: Rig | None = None,
    *,
    focal_px: float | None = None,
    baseline: float | None = None,
    distance: KnownDistance | None = None,
    profile: str = "precise",
    disparities: Range = "auto",
    mask: Bytes | None = None,
    backend: str | None = None,
    window: Window | None = None,
    reference: str = "right",
    rectangle: Rectangle | None = None,
    depth: tuple[float, float] | None = None,
    mesh: MeshOptions | None = None,
    tile: int | None = None,
    check: str = "full",
    ignore_check: bool = False,
    progress: Callable[[str], None] | None = None,
    show: Show | None = None,
) -> Reconstruction:
    """Reconstruct what two cameras see.

    Args:
        left, right: the raw pictures, or their files.
        rig: the calibrated pair of cameras; None makes one from this pair, up to scale.
        focal_px: without a rig, the focal length of both cameras, if it is known; else EXIF's, or a guess.
        baseline: without a rig, the distance between the cameras, mm, which sets the scale.
        distance: or one between two places in the raw reference picture, which does.
        profile: "paper", "fast" or "precise".
        disparities: smallest disparity and how many to search, px, or "auto".
        mask: (H, W) on the rectified reference view, 0 where nothing is wanted.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.
        window: side of the correlation window, px; "auto" for a choice at each pixel; None takes the profile's.
        reference: the view that the mesh is laid out on and textured from; "right" as in the paper.
        rectangle: x, y, width, height around the object on the rectified reference view, px: GrabCut finds its
            outline, where the paper cut the background away by hand.
        depth: nearest and farthest depth that is wanted, in the rig's unit.
        mesh: how the mesh is made.
        tile: largest side of the parts that are matched one after another, px; None takes what fits the memory.
        check: how the rig is checked: "full", by matched features; "rows", by those of the map's places that show on
            which row they lie, which takes a hundredth of the time, and in full only where that is not plainly good;
            or "never". Always in full without a rig.
        ignore_check: go on where the rig does not fit the pair: rows over 2 px apart, or swapped pictures. What was
            found is told as a warning.
        progress: told the name of each stage of STAGES as it begins.
        show: handed what there is, as soon as it is there, by name: "pair", "wanted", "disparity" (closed), "points",
            "surface", "smoothed" and "mesh", as in the result. Its time is no stage's.

    Returns:
        Everything that was computed; `save` writes the files.

    Raises:
        InputError: a picture, the rig or an option is wrong, or the rig does not fit the pictures.
        BackendError: the device is missing, too small or fails.
        StageError: nothing was left to make a mesh of.
    """
    job = plan_job(profile, disparities, mask, window, reference, rectangle, depth, mesh, tile)
    checking = parse_check(check)
    known = Known(focal_px=focal_px, baseline=baseline, distance=distance)
    if rig is None:
        checking = Checking.FULL
    else:
        known.refuse_beside_rig()
    device = open_backend(backend)
    watch = Stopwatch(progress)
    with watch.step("read"):
        raw_left, raw_right = read_source(left), read_source(right)
        inputs = {"left": describe(left), "right": describe(right)}
        check_pair(raw_left, raw_right)
        if distance is not None:
            distance.refuse_outside((raw_left.shape[1], raw_left.shape[0]))
        job = check_against(job, raw_left)
    found, matches = None, None
    with watch.step("rig"):
        if rig is None:
            found = self_calibrate(raw_left, raw_right, known, (left, right))
            rig, matches = found.rig, (found.matched.found_left, found.matched.found_right)
        check_sizes(raw_left, rig)
        check_shown(rig.unit)
    checked = unchecked(rig.left.size) if checking is Checking.NEVER else None
    if checking is Checking.FULL:
        with watch.step("check"):
            checked = check_rig(raw_left, raw_right, rig, matches=matches)
            if not ignore_check:
                refuse_bad(checked)
    with watch.step("rectify"):
        plan = plan_rectification(rig)
        held = rectify_on(device, raw_left, raw_right, rig, plan)
        pair = download_pair(device, held, plan)
    setup = Setup(
        rig=rig,
        checking=checking,
        checked=checked,
        ignore_check=ignore_check,
        found=found,
        distance=known.distance,
    )
    return _from_rectified(job, device, watch, pair, held, raw_left, raw_right, inputs, setup, show or _nothing)


def reconstruct_rectified(
    pair: RectifiedPair,
    *,
    profile: str = "precise",
    disparities: Range = "auto",
    mask: Bytes | None = None,
    backend: str | None = None,
    window: Window | None = None,
    reference: str = "right",
    rectangle: Rectangle | None = None,
    depth: tuple[float, float] | None = None,
    mesh: MeshOptions | None = None,
    tile: int | None = None,
    ignore_check: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Reconstruction:
    """Reconstruct a pair that is rectified already, such as Middlebury's; see `RectifiedPair.from_geometry`.

    Arguments, result and errors are those of `reconstruct`; the raw pictures of the result are the pair's own.
    """
    job = plan_job(profile, disparities, mask, window, reference, rectangle, depth, mesh, tile)
    device = open_backend(backend)
    watch = Stopwatch(progress)
    with watch.step("read"):
        inputs = {"left": describe(pair.left), "right": describe(pair.right)}
        check_pair(pair.left, pair.right)
        check_shown(pair.unit)
        job = check_against(job, pair.left)
        held = DevicePair(
            left=device.upload(pair.left),
            right=device.upload(pair.right),
            valid_left=device.upload(pair.valid_left),
            valid_right=device.upload(pair.valid_right),
        )
    rig = ideal_rig(pair)
    with watch.step("check"):
        checked = check_rig(pair.left, pair.right, rig)
        if not ignore_check:
            refuse_bad(checked)
    setup = Setup(rig=rig, checking=Checking.FULL, checked=checked, ignore_check=ignore_check)
    return _from_rectified(job, device, watch, pair, held, pair.left, pair.right, inputs, setup, _nothing)


def _from_rectified(
    job: Job,
    device: Backend,
    watch: Stopwatch,
    pair: RectifiedPair,
    held: DevicePair,
    raw_left: Picture,
    raw_right: Picture,
    inputs: dict[str, dict[str, str]],
    setup: Setup,
    show: Show,
) -> Reconstruction:
    """All stages from the rectified pair on; `held` is the same pair on the device."""
    warm_up(job.mesh.unwrap, job.mesh.faces)
    show("pair", pair)
    # Of the raw pictures, since rectified ones have black corners.
    levels = find_levels(raw_left), find_levels(raw_right)
    with watch.step("mask"):
        picture, valid, other_valid = pair.left, pair.valid_left, pair.valid_right
        if job.view is View.RIGHT:
            picture, valid, other_valid = pair.right, pair.valid_right, pair.valid_left
        wanted = find_wanted(picture, valid, job)
    show("wanted", wanted)
    with watch.step("range"):
        if job.disparities == "auto":
            masks = (wanted, other_valid) if job.view is View.LEFT else (other_valid, wanted)
            smallest, count = find_range(
                device, pair.left, pair.right, *masks, infinity_px=pair.cx_left - pair.cx_right
            )
        else:
            smallest, count = job.disparities
    with watch.step("match"):
        disparity = match_in_tiles(
            device,
            pair.left,
            pair.right,
            levels=levels,
            masks=(wanted, other_valid),
            smallest=smallest,
            disparities=count,
            reference=job.view,
            profile=job.profile,
            options=job.matching,
            watch=Stopwatch(),
        )
    checked = setup.checked
    if checked is None:
        with watch.step("check"):
            checked = _check_map(pair, disparity, raw_left, raw_right, setup)
    with watch.step("close"):
        largest, max_jump_px = job.mesh.largest_hole, job.mesh.max_jump_px
        disparity = close_holes(disparity, largest=largest, max_jump_px=max_jump_px)
        if largest != 0:
            infinity_px = pair.cx_left - pair.cx_right
            disparity = level_spikes(
                disparity, focal_px=pair.focal_px, infinity_px=infinity_px, max_jump_px=max_jump_px
            )
    show("disparity", disparity)
    with watch.step("triangulate"):
        points: Floats = device.download(triangulate_on(device, device.upload(disparity.values), job.view, pair))
        if setup.distance is not None:
            pair, points = scale_to(setup.distance, pair, points, setup.rig, job.view)
        if job.depth is not None:
            disparity, points = cut_depth(disparity, points, job.depth)
    show("points", points)
    on_device, raw = (held.left, raw_left) if job.view is View.LEFT else (held.right, raw_right)
    scale = grey_scale(raw)
    model = build_model(device, disparity.values, points, pair, job.view, on_device, scale, job.mesh, watch, show)
    return Reconstruction(
        raw_left=raw_left,
        raw_right=raw_right,
        pair=pair,
        mask=wanted,
        disparity=disparity,
        points=points,
        surface=model.surface,
        smoothed=model.smoothed,
        mesh=model.mesh,
        inputs=inputs,
        options={
            **disparity.options,
            "reference": str(job.view),
            "disparities": [smallest, count],
            "disparities_found": job.disparities == "auto",
            "mask": None if job.mask is None else hash_array(job.mask),
            "rectangle": job.rectangle,
            # JSON knows no infinity: null is an open end.
            "depth": None if job.depth is None else tuple(end if math.isfinite(end) else None for end in job.depth),
            **{f"mesh.{name}": value for name, value in dataclasses.asdict(job.mesh).items()},
            "mesh.unwrap_used": model.unwrapped.method,
            "check": str(setup.checking),
        },
        rig=setup.rig,
        checked=checked,
        found=setup.found,
        seconds=dict(watch.seconds),
        warnings=[
            *find_warnings(checked, disparity, model.unwrapped, pair.cx_left - pair.cx_right),
            *(setup.found.warnings(unscaled=pair.unit == UNSCALED) if setup.found else ()),
        ],
    )


def _nothing(name: str, thing: object) -> None:
    """Nobody wants to see it."""


def _check_map(
    pair: RectifiedPair, disparity: Disparity, raw_left: Picture, raw_right: Picture, setup: Setup
) -> RigCheck:
    """The quick check of the rig, and the full one where that does not find it plainly good."""
    checked = check_rows(pair, disparity, setup.rig)
    if checked.verdict is not Verdict.GOOD:
        checked = check_rig(raw_left, raw_right, setup.rig)
        if not setup.ignore_check:
            refuse_bad(checked)
    return checked
