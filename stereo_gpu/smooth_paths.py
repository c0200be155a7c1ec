"""Match by costs smoothed along eight paths, each view on its own, and refine the map where the two agree."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend, DeviceArray
from stereo_gpu.config import MatchOptions, Penalties
from stereo_gpu.flat_surfaces import Surroundings, level_flats, settle
from stereo_gpu.prepare import Levels, make_grey, make_guide
from stereo_gpu.refine import filter_median, launch_on_map
from stereo_gpu.timing import Stopwatch
from stereo_gpu.winners import Winners

# Paths that run along the rows, down and up; the first of them sets the sums, so that it comes first.
HEADINGS = (0, 1, -1)
UNBOUNDED = 1 << 30
VOTERS_REACH = 33  # px
SETTLED_REACH = 4  # px; of the last planes, which only even out what single steps differ by


@dataclass(frozen=True, kw_only=True)
class PathView:
    """One view on the device: what the costs compare.

    Args:
        grey: (H, W) float32, grey levels.
        guide: (3, H, W) uint8, colours of equal mean and contrast in both views.
        compared: the same, or zeros where the views are not to be compared by it.
        bits: (H, W) int32, its census.
        validity: (H, W) uint8, MASKED or 0.
    """

    grey: DeviceArray
    guide: DeviceArray
    compared: DeviceArray
    bits: DeviceArray
    validity: DeviceArray


@dataclass(frozen=True, kw_only=True)
class Volumes:
    """Memory that both views and all slopes share, (H, W, D): uint8 costs, and uint16 sums over the paths."""

    cost: DeviceArray
    sums: DeviceArray


def match_paths(
    backend: Backend,
    pictures: tuple[DeviceArray, DeviceArray],
    levels: tuple[Levels, Levels],
    masks: tuple[DeviceArray, DeviceArray],
    search: dict[str, Any],
    options: MatchOptions,
    watch: Stopwatch,
) -> Winners:
    """Match along smooth paths, and refine.

    Args:
        backend: the device.
        pictures: the reference view and the other one.
        levels: of their values.
        masks: of the two.
        search: smallest, disparities and direction, as `find_winners` takes them.
        options: of the matching.
        watch: collects seconds a step.

    Source: semi-global matching (Hirschmueller, PAMI 2008), each view as reference in turn, on costs after AD-Census
    (Mei et al., GPUCV 2011).
    """
    with watch.step("norms"):
        # Beyond its census a grey level tells next to nothing that vignetting leaves alone; three colours do.
        coloured = all(level.coloured for level in levels)
        given = zip(pictures, levels, masks, strict=True)
        ours, theirs = (prepare_path_view(backend, *view, options, coloured=coloured) for view in given)
        backend.finish()
    height, width = ours.bits.shape
    shape = (height, width, search["disparities"])
    # Fresh memory costs as much as several paths.
    volumes = Volumes(cost=backend.empty(shape, np.uint8), sums=backend.empty(shape, np.uint16))
    penalties = options.penalties if coloured else options.grey_penalties
    assert penalties is not None  # smooth paths have both
    with watch.step("correlation"):
        found = _find(backend, ours, theirs, search, penalties, options, volumes)
        backward = {**search, "direction": -search["direction"]}
        other = _find(backend, theirs, ours, backward, penalties, options, volumes)
        backend.finish()
    del volumes
    with watch.step("refinement"):
        found = _refine(backend, found, other, (ours, theirs), search, options, levels[0].noise)
        backend.finish()
    return found


def volume_bytes(width: int, height: int, disparities: int) -> int:
    """Bytes of the volumes."""
    return width * height * disparities * 3


def scratch_bytes(backend: Backend, width: int, height: int, disparities: int) -> int:
    """Bytes of scratch that the paths take, whichever way they run."""
    size = {"width": width, "height": height, "disparities": disparities, "row_slope": 0}
    return max(backend.scratch_bytes("aggregate", **size, heading=heading) for heading in HEADINGS)


def prepare_path_view(
    backend: Backend,
    picture: DeviceArray,
    levels: Levels,
    mask: DeviceArray,
    options: MatchOptions,
    *,
    coloured: bool,
) -> PathView:
    """What the costs compare of a picture: its census, and its colours where both views have some."""
    height, width = picture.shape[:2]
    bits = backend.empty((height, width), np.int32)
    grey = make_grey(backend, picture, levels.grey, options)
    backend.launch("census", picture=grey, width=width, height=height, bits_out=bits)
    validity = backend.empty((height, width), np.uint8)
    backend.launch("masked", mask=mask, width=width, height=height, validity_out=validity)
    guide = make_guide(backend, picture, levels.colours)
    compared = guide if coloured else backend.zeros(guide.shape, np.uint8)
    return PathView(grey=grey, guide=guide, compared=compared, bits=bits, validity=validity)


def _find(
    backend: Backend,
    ours: PathView,
    theirs: PathView,
    search: dict[str, Any],
    penalties: Penalties,
    options: MatchOptions,
    volumes: Volumes,
) -> Winners:
    """The disparities of our view, for the surface slope that costs less around each pixel."""
    height, width = ours.bits.shape
    size = {"width": width, "height": height}
    backend.launch(
        "match_cost",
        reference_bits=ours.bits,
        other_bits=theirs.bits,
        reference_guide=ours.compared,
        other_guide=theirs.compared,
        reference_validity=ours.validity,
        other_validity=theirs.validity,
        **size,
        **search,
        cost_out=volumes.cost,
    )
    found: Winners | None = None
    for row_slope in options.row_slopes:
        for heading in HEADINGS:
            backend.launch(
                "aggregate",
                cost=volumes.cost,
                guide=ours.guide,
                **size,
                disparities=search["disparities"],
                heading=heading,
                row_slope=row_slope,
                small_penalty=penalties.small,
                large_penalty=penalties.large,
                edge_small_penalty=penalties.edge_small,
                edge_large_penalty=penalties.edge_large,
                edge=options.edge_levels,
                sums_out=volumes.sums,
            )
        leaning = _lowest(backend, ours, volumes, search, options)
        found = leaning if found is None else _merge(backend, found, leaning, options)
    assert found is not None  # there is always a first slope
    return found


def _lowest(
    backend: Backend, ours: PathView, volumes: Volumes, search: dict[str, Any], options: MatchOptions
) -> Winners:
    height, width = ours.bits.shape
    found = _empty(backend, height, width)
    backend.launch(
        "lowest",
        sums=volumes.sums,
        validity=ours.validity,
        width=width,
        height=height,
        smallest=search["smallest"],
        disparities=search["disparities"],
        subpixel=int(options.subpixel),
        disparity_out=found.values,
        lowest_out=found.score,
        ratio_out=found.ratio,
        validity_out=found.validity,
    )
    return found


def _merge(backend: Backend, found: Winners, rival: Winners, options: MatchOptions) -> Winners:
    height, width = found.values.shape
    merged = _empty(backend, height, width)
    backend.launch(
        "merge",
        disparity=found.values,
        lowest=found.score,
        validity=found.validity,
        ratio=found.ratio,
        rival_disparity=rival.values,
        rival_lowest=rival.score,
        rival_validity=rival.validity,
        rival_ratio=rival.ratio,
        width=width,
        height=height,
        radius=options.slope_window // 2,
        margin=options.slope_margin,
        disparity_out=merged.values,
        lowest_out=merged.score,
        validity_out=merged.validity,
        ratio_out=merged.ratio,
    )
    return merged


def _refine(
    backend: Backend,
    found: Winners,
    other: Winners,
    views: tuple[PathView, PathView],
    search: dict[str, Any],
    options: MatchOptions,
    noise: float,
) -> Winners:
    """Keep what both views agree on and like surroundings share; fill the rest, level flats, smooth along surfaces."""
    guide = views[0].guide
    checked = launch_on_map(
        backend, "agree", found, other_disparity=other.values, **search, tolerance=options.consistency_px
    )
    found = launch_on_map(backend, "vote", checked, guide=guide, reach=VOTERS_REACH, step=3, alike=8, least=5)
    found = launch_on_map(
        backend,
        "guided_support",
        found,
        guide=guide,
        reach=options.support_reach,
        step=options.support_step,
        tolerance=options.same_surface_px,
        slope=options.support_slope,
        share=options.support_share,
    )
    # Along the rows, from the side of an edge that lies behind; what rows cannot tell, along the columns.
    for axis in (0, 1):
        found = launch_on_map(
            backend, "fill", found, axis=axis, reach=UNBOUNDED, near=4, edges=1, tolerance=options.same_surface_px
        )
    around = Surroundings(reference=views[0].grey, other=views[1].grey, guide=guide, direction=search["direction"])
    found = level_flats(backend, found, checked, around, noise)
    found = filter_median(backend, found, options)
    found = _fit_planes(backend, found, guide, options.plane_reach, options)
    found = settle(backend, found, around)
    return _fit_planes(backend, found, guide, SETTLED_REACH, options)


def _fit_planes(backend: Backend, found: Winners, guide: DeviceArray, reach: int, options: MatchOptions) -> Winners:
    height, width = found.values.shape
    smoothed = backend.empty((height, width), np.float32)
    backend.launch(
        "plane_fit",
        disparity=found.values,
        validity=found.validity,
        guide=guide,
        width=width,
        height=height,
        reach=reach,
        step=options.plane_step,
        tolerance=options.plane_px,
        slope=options.support_slope,
        largest_slope=options.largest_slope,
        disparity_out=smoothed,
    )
    return dataclasses.replace(found, values=smoothed)


def _empty(backend: Backend, height: int, width: int) -> Winners:
    values, score, ratio = (backend.empty((height, width), np.float32) for _ in range(3))
    return Winners(values=values, validity=backend.empty((height, width), np.uint8), score=score, ratio=ratio)
