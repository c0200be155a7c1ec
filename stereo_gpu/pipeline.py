"""The whole job, a stage a line: from a raw pair and its rig to a textured mesh."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from stereo_gpu.backends import open_backend
from stereo_gpu.check import PairCheck, check_rectified, refuse_swapped
from stereo_gpu.config import PROFILES, MeshOptions
from stereo_gpu.decimate import decimate
from stereo_gpu.disparity_range import find_range
from stereo_gpu.errors import InputError
from stereo_gpu.fairing import fair
from stereo_gpu.images import check_pair, read_image
from stereo_gpu.mask import mask_from_depth, mask_from_rectangle
from stereo_gpu.match import Range, check_options, check_range, coverage, download_disparity, match_on
from stereo_gpu.match import parse_profile, parse_view
from stereo_gpu.mesh import build_mesh
from stereo_gpu.prepare import grey_scale
from stereo_gpu.rectify import check_rig, download_pair, plan_rectification, rectify_on
from stereo_gpu.result import Reconstruction
from stereo_gpu.rig import Rig
from stereo_gpu.texture import bake_texture, project
from stereo_gpu.timing import Stopwatch
from stereo_gpu.triangulate import triangulate_on
from stereo_gpu.types import Bytes, Disparity, Mesh, Picture, Validity, View
from stereo_gpu.unwrap import Unwrapped, unwrap

STAGES = ("read", "rectify", "check", "mask", "range", "match", "triangulate", "mesh", "decimate", "smooth", "unwrap", "texture")

LARGE_VERTICAL_PX = 0.5  # rows that differ by more cost matches
LOW_COVERAGE = 0.5
RANGE_HIT = 0.02  # share of the winners at either end of the range that says the range is too small


def reconstruct(
    left: Picture | str | os.PathLike[str],
    right: Picture | str | os.PathLike[str],
    rig: Rig,
    *,
    profile: str = "fast",
    disparities: Range = "auto",
    mask: Bytes | None = None,
    backend: str | None = None,
    window: int | None = None,
    reference: str = "right",
    rectangle: tuple[int, int, int, int] | None = None,
    depth: tuple[float, float] | None = None,
    mesh: MeshOptions | None = None,
    progress: Callable[[str], None] | None = None,
) -> Reconstruction:
    """Reconstruct what two calibrated cameras see.

    Args:
        left, right: the raw pictures, or their files.
        rig: the calibrated pair of cameras.
        profile: "paper" or "fast".
        disparities: smallest disparity and how many to search, px, or "auto".
        mask: (H, W) on the rectified reference view, 0 where nothing is wanted.
        backend: where to compute; None takes STEREO_GPU_BACKEND, else the best device.
        window: side of the correlation window, px; None takes the profile's.
        reference: the view that the mesh is laid out on and textured from; "right" as in the paper.
        rectangle: x, y, width, height around the object on the rectified reference view, px: GrabCut finds its
            outline, where the paper cut the background away by hand.
        depth: nearest and farthest depth that is wanted, in the rig's unit.
        mesh: how the mesh is made.
        progress: told the name of each stage of STAGES as it begins.

    Returns:
        Everything that was computed; `save` writes the files.

    Raises:
        InputError: a picture, the rig or an option is wrong, or the pictures are swapped.
        BackendError: the device is missing, too small or fails.
        StageError: nothing was left to make a mesh of.
    """
    view, chosen, options = parse_view(reference), parse_profile(profile), PROFILES[parse_profile(profile)]
    if window is not None:
        options = dataclasses.replace(options, window=window)
    check_options(options)
    mesh = mesh or MeshOptions()
    device = open_backend(backend)
    watch = Stopwatch(progress)

    with watch.step("read"):
        inputs = {name: _describe(given) for name, given in (("left", left), ("right", right))}
        raw_left, raw_right = _read(left), _read(right)
        check_pair(raw_left, raw_right)
        check_rig(raw_left, rig)
    with watch.step("rectify"):
        plan = plan_rectification(rig)
        held = rectify_on(device, raw_left, raw_right, rig, plan)
        pair = download_pair(device, held, plan)
    with watch.step("check"):
        checked = check_rectified(pair.left, pair.right, offset_px=pair.cx_left - pair.cx_right)
        refuse_swapped(checked)
    with watch.step("mask"):
        picture, valid, other_valid = pair.left, pair.valid_left, pair.valid_right
        if view is View.RIGHT:
            picture, valid, other_valid = pair.right, pair.valid_right, pair.valid_left
        wanted = _wanted(picture, valid, mask, rectangle)
    with watch.step("range"):
        if disparities == "auto":
            ours, theirs = (wanted, other_valid) if view is View.LEFT else (other_valid, wanted)
            disparities = find_range(device, pair.left, pair.right, ours, theirs)
        smallest, count = check_range(disparities, pair.left.shape[1])
    with watch.step("match"):
        steps = Stopwatch()
        found = match_on(
            device,
            held.left,
            held.right,
            scales=(grey_scale(raw_left), grey_scale(raw_right)),
            masks=(device.upload(wanted), device.upload(other_valid)),
            smallest=smallest,
            disparities=count,
            reference=view,
            options=options,
            watch=steps,
        )
        disparity = download_disparity(device, found, smallest, count, view, chosen, options, steps)
    with watch.step("triangulate"):
        points = device.download(triangulate_on(device, found.values, view, pair))
        if depth is not None:
            disparity, points = _cut_depth(disparity, points, depth)
    with watch.step("mesh"):
        centre = (pair.baseline if view is View.RIGHT else 0.0, 0.0, 0.0)
        surface = build_mesh(disparity.values, points, max_jump_px=mesh.max_jump_px, centre=centre)
    with watch.step("decimate"):
        decimated = decimate(surface, mesh.faces, centre=centre) if mesh.faces else surface
    with watch.step("smooth"):
        smoothed = fair(decimated, iterations=mesh.smoothing) if mesh.smoothing else decimated
    with watch.step("unwrap"):
        seen = project(smoothed.vertices, pair, view)[:, :2]
        unwrapped = unwrap(smoothed, seen, method=mesh.unwrap, time_limit_s=mesh.unwrap_seconds)
    with watch.step("texture"):
        on_device, raw = (held.left, raw_left) if view is View.LEFT else (held.right, raw_right)
        texture = bake_texture(device, on_device, grey_scale(raw), unwrapped, pair, view)

    return Reconstruction(
        raw_left=raw_left,
        raw_right=raw_right,
        pair=pair,
        mask=wanted,
        disparity=disparity,
        points=points,
        surface=surface,
        smoothed=smoothed,
        mesh=Mesh(
            vertices=unwrapped.vertices, faces=unwrapped.faces, uv=unwrapped.uv, texture=texture, unit=pair.unit
        ),
        inputs=inputs,
        options={
            **disparity.options,
            "reference": str(view),
            "disparities": [smallest, count],
            "rectangle": rectangle,
            "depth": depth,
            **{f"mesh.{name}": value for name, value in dataclasses.asdict(mesh).items()},
            "mesh.unwrap_used": unwrapped.method,
        },
        checked=checked,
        seconds=dict(watch.seconds),
        warnings=_warnings(checked, disparity, unwrapped),
    )


def _wanted(
    picture: Picture, valid: Bytes, mask: Bytes | None, rectangle: tuple[int, int, int, int] | None
) -> Bytes:
    """Where the reference view has content and somebody wants it."""
    wanted = valid
    if mask is not None:
        if mask.shape != valid.shape:
            raise InputError(
                f"mask is {mask.shape[::-1]}, the rectified pictures are {valid.shape[::-1]}: draw it on those"
            )
        wanted = np.asarray(wanted & (mask != 0), np.uint8)
    if rectangle is not None:
        wanted = wanted & mask_from_rectangle(picture, rectangle)
    if not wanted.any():
        raise InputError("the mask leaves no pixel of the reference view: widen it")
    return wanted


def _cut_depth(
    disparity: Disparity, points: np.ndarray[Any, Any], depth: tuple[float, float]
) -> tuple[Disparity, np.ndarray[Any, Any]]:
    """Take away what lies outside of the wanted depths."""
    outside = (mask_from_depth(points, *depth) == 0) & np.isfinite(disparity.values)
    cut = dataclasses.replace(
        disparity,
        values=np.where(outside, np.float32(np.nan), disparity.values),
        validity=np.where(outside, np.uint8(Validity.MASKED), disparity.validity),
        confidence=np.where(outside, np.float32(0), disparity.confidence),
    )
    return cut, np.where(outside[..., None], np.float32(np.nan), points)


def _warnings(checked: PairCheck, disparity: Disparity, unwrapped: Unwrapped) -> list[str]:
    found = []
    if checked.vertical_px > LARGE_VERTICAL_PX:
        found.append(
            f"Matched features differ by {checked.vertical_px:.2f} px in height (median of {checked.matches}):"
            " the cameras moved since the calibration, or the rig belongs to others. Calibrate again."
        )
    if np.isnan(checked.vertical_px):
        found.append(f"Only {checked.matches} features matched: whether the rig fits the pictures was not checked.")
    covered = coverage(disparity)
    if covered < LOW_COVERAGE:
        found.append(f"Only {covered:.0%} of the wanted pixels have a disparity: too little texture, or a wrong range.")
    good = disparity.values[disparity.validity == 0]
    for share, where, way in (
        ((good < disparity.smallest + 1).mean() if len(good) else 0, "smallest", "lower"),
        ((good > disparity.smallest + disparity.disparities - 2).mean() if len(good) else 0, "largest", "higher"),
    ):
        if share > RANGE_HIT:
            found.append(f"{share:.0%} of the disparities are at the {where} one searched: start or end {way}.")
    if unwrapped.reason:
        found.append(f"The texture uses the view's own coordinates instead of charts: {unwrapped.reason}.")
    return found


def _read(given: Picture | str | os.PathLike[str]) -> Picture:
    return given if isinstance(given, np.ndarray) else read_image(given)


def _describe(given: Picture | str | os.PathLike[str]) -> dict[str, str]:
    if isinstance(given, np.ndarray):
        return {"name": "array", "sha256": hashlib.sha256(np.ascontiguousarray(given)).hexdigest()}
    path = Path(given)
    # A file that cannot be read is named by read_image, which comes next.
    content = path.read_bytes() if path.is_file() else b""
    return {"name": path.name, "sha256": hashlib.sha256(content).hexdigest()}
