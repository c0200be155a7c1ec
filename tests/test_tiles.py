"""Tiles: every pixel is covered once, margins hold what its result depends on, and no seam is to be seen."""

import dataclasses
import logging

import numpy as np
import pytest
from test_match import textured_pair

from stereo_gpu import tiles
from stereo_gpu.backends import open_backend
from stereo_gpu.config import PROFILES, MeshOptions, Profile
from stereo_gpu.device_match import match_bytes
from stereo_gpu.errors import MemoryLimitError
from stereo_gpu.match import match
from stereo_gpu.pipeline import reconstruct_rectified
from stereo_gpu.tiles import Margin, choose_tiles, find_margin, plan_tiles
from stereo_gpu.types import RectifiedPair, Validity, View

ALLOWED = 1e-4  # share of the pixels that may change by more than CHANGED
CHANGED = 0.01  # px


def changed(whole, tiled):
    """Shares of the pixels whose value changed by more than CHANGED, and in any bit."""
    same = (whole.values == tiled.values) | (np.isnan(whole.values) & np.isnan(tiled.values))
    near = same | (np.abs(whole.values - tiled.values) <= CHANGED)
    return 1 - near.mean(), 1 - same.mean()


@pytest.mark.parametrize("largest", [None, 16, 50, 1000])
@pytest.mark.parametrize(("width", "height"), [(301, 203), (1000, 40), (17, 500), (3, 3)])
def test_every_pixel_is_kept_once(width, height, largest):
    margin = Margin(left=9, right=30, rows=7)
    planned, (across, down) = plan_tiles(width, height, margin, lambda w, h: w * h <= 40_000, largest)
    assert len(planned) == across * down
    times = np.zeros((height, width), int)
    for tile in planned:
        times[tile.kept] += 1
        rows, columns = tile.taken
        kept_rows, kept_columns = tile.kept
        # The margins are whole, but for what lies outside of the picture.
        assert (rows.start, rows.stop) == (max(0, (kept_rows.start - 7) // 8 * 8), min(height, kept_rows.stop + 7))
        assert (columns.start, columns.stop) == (
            max(0, (kept_columns.start - 9) // 8 * 8),
            min(width, kept_columns.stop + 30),
        )
        taken = np.zeros((height, width))
        taken[tile.kept] = 1
        assert taken[tile.taken][tile.inner].all() and taken[tile.taken].sum() == taken.sum()
        assert taken[tile.taken].size <= 40_000
        if largest:
            assert max(kept_rows.stop - kept_rows.start, kept_columns.stop - kept_columns.start) <= largest
    assert (times == 1).all()


def test_a_picture_that_fits_is_not_cut():
    planned, grid = plan_tiles(640, 480, Margin(left=9, right=9, rows=9), lambda w, h: True)
    assert grid == (1, 1)
    assert planned[0].taken == planned[0].kept == (slice(0, 480), slice(0, 640))


def test_the_plan_that_matches_least_is_taken():
    """Long strips along the side whose margin is the larger one."""
    across, along = (
        plan_tiles(1000, 1000, margin, lambda w, h: w * h <= 300_000)[1]
        for margin in (Margin(left=90, right=90, rows=5), Margin(left=5, right=5, rows=90))
    )
    assert across == (1, 4)
    assert along == (4, 1)


def test_nothing_fits():
    assert plan_tiles(640, 480, Margin(left=9, right=9, rows=9), lambda w, h: False) is None


@pytest.mark.parametrize("smallest", [-40, -200, 0, 150])
def test_a_margin_holds_partners_and_their_rivals(smallest):
    options = dataclasses.replace(PROFILES[Profile.PAPER], window=3, median=0)
    right = find_margin(options, smallest, 60, View.RIGHT)
    # Of a pixel at 0, from the right view: partners at smallest to smallest + 59, their rivals 59 px to either side.
    assert right.right >= max(59, smallest + 59) + 1
    assert right.left >= max(59, -smallest) + 1
    left = find_margin(options, smallest, 60, View.LEFT)
    assert (left.left, left.right) == (right.right, right.left)
    assert right.rows == 1


@pytest.mark.parametrize("smallest", [0, -20, 9])
@pytest.mark.parametrize("view", ["left", "right"])
@pytest.mark.parametrize("profile", ["paper", "fast"])
def test_no_seam_where_windows_decide(profile, view, smallest):
    left, right, _ = textured_pair(300, 200)
    left[60:90, 100:160] = right[60:90, 100:160] = 90
    if smallest < 0:
        right = np.roll(right, 15, axis=1)
    job = {"disparities": (smallest, 36), "profile": profile, "reference": view}
    whole, tiled = match(left, right, **job), match(left, right, **job, tile=40)
    assert whole.options["tiles"] == [1, 1] and tiled.options["tiles"] == [8, 5]
    assert changed(whole, tiled) == (0, 0)
    np.testing.assert_array_equal(whole.validity, tiled.validity)
    np.testing.assert_array_equal(whole.confidence, tiled.confidence)
    assert np.isfinite(whole.values).mean() > 0.5


@pytest.mark.parametrize("view", ["left", "right"])
@pytest.mark.parametrize(("width", "height"), [(240, 1600), (1600, 130)])
def test_no_seam_along_smooth_paths(view, width, height):
    """So long a picture that no tile takes all of it along.

    In the columns that only one camera sees nothing but the paths tells a disparity, so that these look further.
    """
    left, right, _ = textured_pair(width, height)
    left[height // 2 :][:70, 80:100] = right[height // 2 :][:70, 80:100] = 90
    job = {"disparities": (0, 36), "profile": "precise", "reference": view}
    whole, tiled = match(left, right, **job), match(left, right, **job, tile=130)
    margin = find_margin(PROFILES[Profile.PRECISE], 0, 36, View(view))
    assert max(2 * margin.rows, margin.left + margin.right) + 130 < 1600
    assert max(tiled.options["tiles"]) == 13
    assert np.isfinite(whole.values).mean() > 0.5
    assert changed(whole, tiled)[0] <= 10 * ALLOWED
    seen = slice(48, None) if view == "left" else slice(0, -48)
    assert changed(*(dataclasses.replace(d, values=d.values[:, seen]) for d in (whole, tiled)))[0] <= ALLOWED


def test_no_seam_with_several_windows():
    left, right, _ = textured_pair(300, 200)
    whole, tiled = (match(left, right, disparities=(0, 36), window="auto", tile=tile) for tile in (None, 40))
    assert changed(whole, tiled) == (0, 0)


def test_the_margin_is_needed(monkeypatch):
    """With less of it seams are seen, so that the test above can fail."""
    left, right, _ = textured_pair(300, 200)
    whole = match(left, right, disparities=(0, 36))
    monkeypatch.setattr(tiles, "find_margin", lambda *_: Margin(left=8, right=8, rows=2))
    assert changed(whole, match(left, right, disparities=(0, 36), tile=40))[0] > 100 * ALLOWED


def test_masks_and_colour_and_16_bits():
    left, right, _ = textured_pair(300, 200)
    deep = [np.repeat(p[..., None], 3, 2).astype(np.uint16) * 200 for p in (left, right)]
    # One tile is much darker than the others; the scale is of the whole picture.
    deep[0][:60, :60] //= 4
    mask, other_mask = np.ones((2, 200, 300), np.uint8)
    mask[:, :100], mask[150:], other_mask[:, 200:230] = 0, 0, 0
    job = {"disparities": (0, 40), "mask": mask, "other_mask": other_mask}
    whole, tiled = match(*deep, **job), match(*deep, **job, tile=50)
    np.testing.assert_array_equal(whole.values, tiled.values)
    np.testing.assert_array_equal(whole.validity, tiled.validity)
    np.testing.assert_array_equal(whole.confidence, tiled.confidence)
    assert (tiled.validity[mask == 0] == Validity.MASKED).all()
    everything_masked = match(*deep, disparities=(0, 40), mask=np.zeros_like(mask), tile=50)
    assert (everything_masked.validity == Validity.MASKED).all() and np.isnan(everything_masked.values).all()


def test_the_whole_map_is_judged():
    """A tile without texture keeps what paths carry into it; a picture without any keeps nothing."""
    left, right, _ = textured_pair(160, 900)
    left[300:600], right[300:600] = 90, 90
    job = {"disparities": (0, 24), "profile": "precise"}
    tiled = match(left, right, **job, tile=300)
    assert tiled.options["tiles"] == [1, 3]
    assert np.isfinite(tiled.values[:300]).mean() > 0.5
    noise = [np.asarray(120 + np.random.default_rng(n).integers(0, 2, (120, 160)), np.uint8) for n in range(2)]
    found = match(*noise, **job, tile=60)
    assert found.options["tiles"] == [3, 2]
    assert np.isnan(found.values).all() and not found.confidence.any()
    assert (found.validity == Validity.TEXTURELESS).all()


def test_a_reconstruction_in_tiles():
    left, right, _ = textured_pair(160, 120)
    pair = RectifiedPair.from_geometry(left, right, focal_px=150, baseline=60, cx_left=80, cx_right=80, cy=60)
    job = {"disparities": (0, 36), "profile": "fast", "mesh": MeshOptions(faces=500, unwrap="view")}
    whole, tiled = (reconstruct_rectified(pair, **job, tile=tile) for tile in (None, 64))
    assert whole.options["tiles"] == [1, 1] and tiled.options["tiles"] == [3, 2]
    assert (whole.options["tile"], tiled.options["tile"]) == (None, 64)
    np.testing.assert_array_equal(whole.disparity.values, tiled.disparity.values)
    np.testing.assert_array_equal(whole.points, tiled.points)


def test_each_device(backend):
    left, right, _ = textured_pair(160, 120)
    whole, tiled = (match(left, right, disparities=(0, 36), backend=backend.name, tile=t) for t in (None, 64))
    np.testing.assert_array_equal(whole.values, tiled.values)
    np.testing.assert_array_equal(whole.confidence, tiled.confidence)


def test_tiles_follow_from_the_memory(monkeypatch, caplog):
    left, right, _ = textured_pair(400, 300)
    device, options = open_backend(), PROFILES[Profile.PAPER]
    job = {"disparities": (0, 36), "profile": "paper"}
    whole = match(left, right, **job)
    needed, _ = match_bytes(device, 400, 300, 36, options)
    room = int(0.7 * needed) + tiles.KEPT_BYTES * 400 * 300
    monkeypatch.setattr(type(device), "available_bytes", lambda self: (room, room))
    planned, grid = choose_tiles(device, 400, 300, 0, 36, View.RIGHT, options)
    assert len(planned) > 1
    for tile in planned:
        rows, columns = (side.stop - side.start for side in tile.taken)
        assert match_bytes(device, columns, rows, 36, options)[0] <= tiles.MEMORY_SHARE * 0.7 * needed + 1
    with caplog.at_level(logging.INFO, "stereo_gpu.tiles"):
        tiled = match(left, right, **job)
    assert tiled.options["tiles"] == list(grid)
    assert len([line for line in caplog.messages if line.startswith("tile ")]) == len(planned)
    np.testing.assert_array_equal(whole.values, tiled.values)


def test_too_little_for_the_smallest_tile_says_what_would_help(monkeypatch):
    left, right, _ = textured_pair(400, 300)
    device = open_backend()
    monkeypatch.setattr(type(device), "available_bytes", lambda self: (2_000_000, 2_000_000))
    with pytest.raises(MemoryLimitError, match=r"needs [\d,]+ bytes.*2,000,000.*profile fast") as caught:
        match(left, right, disparities=(0, 128), profile="precise")
    assert "\n" not in str(caught.value)
