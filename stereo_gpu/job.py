"""The options of a reconstruction, checked before any work is done."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from stereo_gpu.config import Checking, MatchOptions, MeshOptions, Profile
from stereo_gpu.errors import InputError
from stereo_gpu.match_options import Range, Window, check_range, choose_options, parse_profile, parse_view
from stereo_gpu.types import Bytes, Picture, View

Rectangle = tuple[int, int, int, int]
MOST_SMOOTHING = 1000  # passes; ten are usual, and more than this is a slip of the finger


@dataclass(frozen=True, kw_only=True)
class Job:
    """The options of a reconstruction, parsed; `pipeline.reconstruct` says what each one means."""

    profile: Profile
    matching: MatchOptions
    view: View
    disparities: Range
    mask: Bytes | None
    rectangle: Rectangle | None
    depth: tuple[float, float] | None
    mesh: MeshOptions


def plan_job(
    profile: str,
    disparities: Range,
    mask: Bytes | None,
    window: Window | None,
    reference: str,
    rectangle: Rectangle | None,
    depth: tuple[float, float] | None,
    mesh: MeshOptions | None,
    tile: int | None = None,
) -> Job:
    """Parse the options and check what can be checked without a picture.

    Raises:
        InputError: an option is wrong.
    """
    chosen = parse_profile(profile)
    matching = choose_options(chosen, window, tile)
    mesh = mesh or MeshOptions()
    _check_mesh(mesh)
    if depth is not None and not (len(depth) == 2 and 0 <= depth[0] < depth[1]):  # false for NaN, too
        given = ",".join(f"{end:g}" for end in depth)
        raise InputError(f"depth = {given}: give the nearest depth that is wanted, and then the farthest one")
    return Job(
        profile=chosen,
        matching=matching,
        view=parse_view(reference),
        disparities=disparities,
        mask=mask,
        # NumPy's numbers, too, are to be written to result.json.
        rectangle=None if rectangle is None else tuple(int(number) for number in rectangle),  # type: ignore[arg-type]
        depth=None if depth is None else (float(depth[0]), float(depth[1])),
        mesh=mesh,
    )


def parse_check(check: str) -> Checking:
    """How the rig is checked.

    Raises:
        InputError: there is no such way.
    """
    try:
        return Checking(check)
    except ValueError:
        raise InputError(f"check = {check!r:.60}: give full, rows or never") from None


def check_against(job: Job, picture: Picture) -> Job:
    """Check what only the size of the pictures can tell; returns the job with a range of whole numbers.

    Raises:
        InputError: the range or the mask does not fit it.
    """
    height, width = picture.shape[:2]
    if job.disparities != "auto":
        job = dataclasses.replace(job, disparities=check_range(job.disparities, width))
    if job.mask is not None and job.mask.shape != (height, width):
        raise InputError(f"mask has shape {job.mask.shape}, the rectified pictures {(height, width)}: draw it on those")
    return job


def _check_mesh(mesh: MeshOptions) -> None:
    for name, good, wanted in (
        ("method", mesh.method in ("bounded", "dense"), "bounded or dense"),
        ("error_px", 0 < mesh.error_px < math.inf, "a number of px above 0 (--mesh-error)"),
        ("max_jump_px", 0 < mesh.max_jump_px < math.inf, "a number of px above 0"),
        (
            "largest_hole",
            mesh.largest_hole is None or mesh.largest_hole >= 0,
            "a number of pixels, 0 or more, or None for all (--close-holes all)",
        ),
        ("smallest_part", mesh.smallest_part >= 0, "a number of pixels, 0 or more"),
        ("faces", mesh.faces >= 0, "how many triangles to keep, or 0 for all"),
        (
            "decimate_error",
            mesh.decimate_error is None or 0 < mesh.decimate_error < math.inf,
            "a length above 0 in the rig's unit, or leave it out",
        ),
        ("smoothing", 0 <= mesh.smoothing <= MOST_SMOOTHING, f"0 to {MOST_SMOOTHING} passes"),
        ("unwrap", mesh.unwrap in ("charts", "view"), "charts or view"),
        ("unwrap_seconds", 0 < mesh.unwrap_seconds < math.inf, "a number of seconds above 0"),
    ):
        if not good:
            raise InputError(f"{name} = {getattr(mesh, name)!r}: give {wanted}")
