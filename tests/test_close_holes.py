"""Holes are closed along their surface, marked, and left open where they are large."""

import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.close_holes import REACH, close_holes
from stereo_gpu.errors import InputError
from stereo_gpu.types import Disparity, Validity, View

HEIGHT, WIDTH = 90, 131
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
TABLE = 20 + 0.25 * Y - 0.06 * X  # px: a surface that leans both ways
NO_VALUE, MASKED, FILLED = Validity.MISMATCH, Validity.MASKED, Validity.FILLED


def disparity_map(values, validity, reference=View.RIGHT, **options):
    """A map as `match` makes it: NaN where `validity` gives a reason and not FILLED."""
    validity = np.asarray(validity, np.uint8)
    given = (validity == 0) | ((validity & FILLED) != 0)
    return Disparity(
        values=np.where(given, values, np.nan).astype(np.float32),
        validity=validity,
        confidence=np.where(validity == 0, 0.75, 0).astype(np.float32),
        reference=reference,
        smallest=0,
        disparities=64,
        backend="none",
        device="none",
        options=options,
    )


def with_hole(rows, columns, reason=NO_VALUE):
    validity = np.zeros((HEIGHT, WIDTH), np.uint8)
    validity[rows, columns] = reason
    return validity


SMALL = with_hole(slice(30, 50), slice(40, 60))  # 400 px
LARGE = with_hole(slice(30, 60), slice(40, 70))  # 900 px


def test_a_small_hole_is_closed_along_its_surface_and_marked():
    closed = close_holes(disparity_map(TABLE, SMALL), largest=400)
    np.testing.assert_allclose(closed.values, TABLE, atol=1e-4)
    np.testing.assert_array_equal(closed.validity, np.where(SMALL, NO_VALUE | FILLED, 0))
    np.testing.assert_array_equal(closed.confidence, np.where(SMALL, 0, np.float32(0.75)))


def test_what_was_measured_stays_to_the_bit():
    rng = np.random.default_rng(5)
    validity = np.where(rng.random(TABLE.shape) < 0.3, NO_VALUE, 0)
    given = disparity_map(TABLE + rng.normal(0, 0.3, TABLE.shape), validity)
    before = given.values.copy()
    closed = close_holes(given)
    np.testing.assert_array_equal(closed.values[validity == 0], before[validity == 0])
    np.testing.assert_array_equal(given.values, before)  # the map that came is not written to
    assert np.isfinite(closed.values[5:-5, 5:-5]).all()


@pytest.mark.parametrize("filled", [0, FILLED])
def test_a_large_hole_stays_open_whether_or_not_the_matcher_filled_it(filled):
    open_ = close_holes(disparity_map(TABLE - 7, LARGE | np.where(LARGE, filled, 0)), largest=400)
    assert np.isnan(open_.values[LARGE != 0]).all()
    np.testing.assert_array_equal(open_.validity, LARGE)  # the reason stays, and nothing says FILLED


def test_a_large_hole_is_closed_on_request():
    closed = close_holes(disparity_map(TABLE, LARGE), largest=None)
    np.testing.assert_allclose(closed.values, TABLE, atol=1e-4)
    assert ((closed.validity & FILLED) != 0).sum() == 900


def test_none_is_closed_on_request():
    closed = close_holes(disparity_map(TABLE, np.where(SMALL, NO_VALUE | FILLED, 0)), largest=0)
    assert np.isnan(closed.values[SMALL != 0]).all()
    np.testing.assert_array_equal(closed.validity, SMALL)


def test_a_narrow_part_of_a_large_hole_is_closed():
    validity = LARGE.copy()
    validity[10:30, 54:57] = NO_VALUE  # a crack that runs into it
    closed = close_holes(disparity_map(TABLE, validity), largest=400)
    assert np.isfinite(closed.values[10:28, 54:57]).all()
    np.testing.assert_allclose(closed.values[10:28, 54:57], TABLE[10:28, 54:57], atol=0.05)
    assert np.isnan(closed.values[32:58, 42:68]).all()


def test_a_ragged_outline_of_a_large_hole_is_closed_to_a_plain_one():
    validity = LARGE.copy()
    validity[26:30, 41:69:5] = NO_VALUE  # teeth, 4 px long and 1 px wide
    closed = close_holes(disparity_map(TABLE, validity), largest=400)
    np.testing.assert_allclose(closed.values[26:30], TABLE[26:30], atol=0.1)
    assert np.isnan(closed.values[34:60, 44:66]).all()


def test_a_small_bound_is_kept():
    validity = with_hole(slice(30, 33), slice(40, 43)) | with_hole(slice(50, 51), slice(20, 22))
    closed = close_holes(disparity_map(TABLE, validity), largest=2)
    assert np.isnan(closed.values[30:33, 40:43]).all()
    assert np.isfinite(closed.values[50, 20:22]).all()


@pytest.mark.parametrize("filled", [0, FILLED])
def test_nothing_is_put_between_two_surfaces(filled):
    """A crack along the outline of a nearer thing takes what lies behind, and the jump stays a jump."""
    behind, before = TABLE, TABLE + 15
    thing = X > 70
    crack = np.abs(X - 72) < 3.5  # on both sides of the outline
    crack[:6] = crack[-6:] = False
    validity = np.where(crack, NO_VALUE | filled, 0)
    closed = close_holes(disparity_map(np.where(thing & ~crack, before, behind), validity), max_jump_px=3.0)
    assert np.isfinite(closed.values).all()
    # At its ends, on what is before, it may as well be a crack in that.
    assert np.abs(closed.values - behind)[crack & (Y > 12) & (Y < HEIGHT - 13)].max() < 0.5
    np.testing.assert_array_equal(closed.values[thing & ~crack], before[thing & ~crack])


def test_rows_that_were_filled_each_for_itself_are_evened_out():
    rng = np.random.default_rng(3)
    rows = TABLE + rng.normal(0, 0.5, (HEIGHT, 1))
    given = disparity_map(np.where(SMALL, rows, TABLE), np.where(SMALL, NO_VALUE | FILLED, 0))
    closed = close_holes(given)
    inside = SMALL != 0
    assert np.abs(closed.values - TABLE)[inside].mean() < 0.6 * np.abs(given.values - TABLE)[inside].mean()


def test_at_the_edge_of_picture_and_mask_a_surface_goes_on_for_a_little_only():
    validity = np.where(X >= 60, NO_VALUE | FILLED, 0)
    validity[X >= 100] = MASKED
    closed = close_holes(disparity_map(TABLE, validity), largest=None)
    assert np.isfinite(closed.values[:, : 60 + int(REACH)]).all()
    assert np.isnan(closed.values[:, 60 + int(REACH) + 1 :]).all()
    np.testing.assert_array_equal(closed.validity[X >= 100], MASKED)
    assert (closed.validity[(X > 60 + REACH) & (X < 100)] == NO_VALUE).all()


def test_an_empty_map_stays_empty():
    nothing = close_holes(disparity_map(TABLE, np.full(TABLE.shape, NO_VALUE)), largest=None)
    assert np.isnan(nothing.values).all()
    assert (nothing.validity == NO_VALUE).all()


def test_smooth_paths_keep_what_both_cameras_see_and_nothing_that_one_sees():
    """A flat wall has no texture behind a post: the matcher levelled the wall, of which the post hides a part."""
    wall, post = np.full(TABLE.shape, 10, np.float32), (X >= 20) & (X < 30)
    truth = np.where(post, 60, wall)
    # The post lies at 80 to 90 in the left picture, and so does the wall's 70 to 80; from 121 on it is not in it.
    validity = np.where((X >= 30) & (X < 125), NO_VALUE | FILLED, 0)
    closed = close_holes(disparity_map(truth, validity, smooth_paths=True))
    hidden = (X >= 70) & (X < 80)
    outside = X >= WIDTH - 10
    wide = (X >= 42) & (X < 113) & (Y > 12) & (Y < HEIGHT - 13)
    assert np.isfinite(closed.values[~hidden & ~outside]).all()
    assert np.isnan(closed.values[wide & hidden]).all()
    alone = close_holes(disparity_map(truth, validity))
    assert np.isnan(alone.values[wide]).all()


def test_both_views_are_equal():
    rng = np.random.default_rng(8)
    values = np.where((X > 60) & (Y > 30), TABLE + 12, TABLE) + rng.normal(0, 0.2, TABLE.shape).astype(np.float32)
    validity = np.where(rng.random(TABLE.shape) < 0.2, NO_VALUE | FILLED, 0)
    validity[40:75, 70:110] = NO_VALUE | FILLED
    validity[:, 50:56] = NO_VALUE
    right = close_holes(disparity_map(values, validity, smooth_paths=True))
    mirrored = disparity_map(values[:, ::-1], validity[:, ::-1], View.LEFT, smooth_paths=True)
    left = close_holes(mirrored)
    np.testing.assert_array_equal(left.validity[:, ::-1], right.validity)
    np.testing.assert_allclose(left.values[:, ::-1], right.values, atol=1e-4)


def test_wrong_options_are_refused():
    given = disparity_map(TABLE, SMALL)
    with pytest.raises(InputError, match="largest is -1"):
        close_holes(given, largest=-1)
    with pytest.raises(InputError, match="max_jump_px is nan"):
        close_holes(given, max_jump_px=float("nan"))


def test_a_reconstruction_says_how_much_was_closed_and_left_open(raw_folder):
    results = {
        largest: sg.reconstruct(
            raw_folder / "left.png",
            raw_folder / "right.png",
            sg.Rig.load(raw_folder / "rig.json"),
            profile="fast",
            disparities=(20, 32),
            mesh=sg.MeshOptions(largest_hole=largest, unwrap="view", faces=5000),
        )
        for largest in (0, 100)
    }
    for result in results.values():
        counts = result.record()["counts"]
        measured = int(((result.disparity.validity == 0) & (result.mask != 0)).sum())
        assert measured + counts["filled"] + counts["open"] == counts["wanted"]
        assert counts["with_disparity"] == measured + counts["filled"]
    none, some = (result.record()["counts"] for result in results.values())
    assert none["filled"] == 0 < some["filled"]
    assert some["open"] < none["open"]
