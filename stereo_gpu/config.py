"""Every option of a reconstruction, with the defaults of each profile."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Profile(StrEnum):
    """How disparities are found."""

    PAPER = "paper"
    FAST = "fast"
    PRECISE = "precise"


class Checking(StrEnum):
    """How a rig is checked against a pair."""

    FULL = "full"  # by features, before anything is matched
    ROWS = "rows"  # by the rows of the map, and by features only where these are not plainly right
    NEVER = "never"


@dataclass(frozen=True, kw_only=True)
class Penalties:
    """What a disparity change along a smooth path costs, where a pixel's own cost is 0 to 146.

    Args:
        small, large: a change of one, and of more.
        edge_small, edge_large: the same where the picture has an edge.
    """

    small: int
    large: int
    edge_small: int
    edge_large: int


@dataclass(frozen=True, kw_only=True)
class MatchOptions:
    """How a disparity map is made.

    Args:
        window: side of the square correlation window, px, odd, 3 to 31; with `windows`, the largest of them; the side
            of the census after smooth paths, which is fixed.
        windows: sides that are tried for each pixel, smallest first; none for `window` alone.
        windows_share: share of its surroundings that must have the disparity of one of these windows.
        texture_threshold: RMS contrast of a window, in grey levels of 0..255, at or under which it is flat.
        subpixel: whether a parabola refines the winner.
        smooth_sigma: standard deviation of the Gaussian prefilter, px; 0 for none.
        smooth_paths: whether the winner is taken over costs of census and colour that are smoothed along 8 paths
            (semi-global), in place of NCC alone; the options from here to slope_margin are theirs.
        penalties, grey_penalties: of disparity changes along such a path, between pictures in colour and others.
            Without colours costs are smaller, and what is left to tell flat surfaces apart is their lean, which must
            be cheap.
        edge_levels: change of a colour from one pixel to the next that is an edge, where 50 are the picture's standard
            deviation.
        row_slopes: disparity changes a row, px, of the surfaces that paths expect, tried in turn. 1 is a table seen at
            a grazing angle.
        slope_window: side of the window over which a slope must cost less on average than the one before, px, odd.
        slope_margin: by how much it must.
        whole_volume: whether the cost volume is held in memory, as the paper does, or fused with its winner.
        consistency_px: largest difference to the other view's winner, px; None for no left-right check.
        median: side of the median filter, 3, 5 or 7; 0 for none.
        support_share: share of the surroundings that must have a pixel's disparity; 0 for no such test.
        support_slope: by how much a disparity may change with each pixel of distance and still be shared, px.
        support_reach, support_step: how far these surroundings go and how densely they are sampled, px.
        fill_reach: longest hole in a row that is filled, px; 0 for none. Smooth paths fill every hole.
        same_surface_px: difference up to which two disparities belong to one surface, px.
        plane_reach, plane_step: how far the pixels go that a plane is fitted to at each pixel, and how densely they are
            sampled, px; after smooth paths only.
        plane_px: how far from the plane they may lie, and how far a pixel may be moved, px.
        largest_slope: of such a plane, px a pixel.
        tile: largest side of the parts that a picture is matched in, px; None for what fits the device's memory.
    """

    window: int
    texture_threshold: float
    subpixel: bool
    windows: tuple[int, ...] = ()
    windows_share: float = 0.0
    smooth_sigma: float = 0.0
    smooth_paths: bool = False
    penalties: Penalties | None = None
    grey_penalties: Penalties | None = None
    edge_levels: int = 0
    row_slopes: tuple[int, ...] = (0,)
    slope_window: int = 9
    slope_margin: float = 0.0
    whole_volume: bool = False
    consistency_px: float | None = None
    median: int = 0
    support_share: float = 0.0
    support_slope: float = 0.0
    support_reach: int = 6
    support_step: int = 3
    fill_reach: int = 0
    same_surface_px: float = 1.0
    plane_reach: int = 6
    plane_step: int = 2
    plane_px: float = 0.0
    largest_slope: float = 1.5
    tile: int | None = None


PROFILES = {
    Profile.PAPER: MatchOptions(window=11, texture_threshold=1.0, subpixel=False, whole_volume=True, median=3),
    Profile.FAST: MatchOptions(
        window=5,
        texture_threshold=0.3,  # what rounding to whole grey levels makes of a flat window, 1 / sqrt(12)
        subpixel=True,
        consistency_px=1.0,
        median=5,
        support_share=0.2,  # 10 of 49: what fewer share is also found between pictures of mere noise
        support_reach=9,
        fill_reach=64,
    ),
    Profile.PRECISE: MatchOptions(
        window=5,
        texture_threshold=0.0,
        subpixel=True,
        smooth_paths=True,
        penalties=Penalties(small=180, large=420, edge_small=34, edge_large=80),
        grey_penalties=Penalties(small=60, large=400, edge_small=24, edge_large=140),
        edge_levels=15,
        row_slopes=(0, 1),
        slope_margin=24.0,  # 3 a path
        consistency_px=1.0,
        median=3,
        support_share=0.4,
        support_slope=0.3,
        support_reach=8,
        support_step=2,
        plane_px=0.5,
    ),
}
# For window "auto": each has two to three times the pixels of the one before, up to the paper's own.
AUTO_WINDOWS = (3, 5, 7, 11)
AUTO_SHARE = 0.16  # 8 of 49, before the share that the whole map must have


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """How a mesh is made of a disparity map.

    Args:
        method: "bounded" (few triangles within `error_px` of the map) or "dense" (two a pixel).
        error_px: how far the bounded mesh may lie from a pixel's disparity, px.
        max_jump_px: disparity difference over which two pixels are not on one surface, px.
        largest_hole: holes of up to so many pixels, and narrow parts of larger ones, are closed along their surface; 0
            for none, None for all.
        smallest_part: a part that covers less than this many pixels is dropped, one that hangs by a corner alone too.
        faces: number of triangles to decimate to; 0 keeps them all.
        decimate_error: or how far decimation may move the surface, in the rig's unit; None for `faces` alone.
        smoothing: passes of the smoothing filter; 0 for none.
        unwrap: "charts" (xatlas) or "view" (the reference picture's own coordinates).
        unwrap_seconds: time limit for the charts, after which "view" is taken.
    """

    method: str = "bounded"
    error_px: float = 0.25
    max_jump_px: float = 3.0
    largest_hole: int | None = 400
    smallest_part: int = 150
    faces: int = 50_000
    decimate_error: float | None = None
    smoothing: int = 10
    unwrap: str = "charts"
    unwrap_seconds: float = 60.0
