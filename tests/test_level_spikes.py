"""Noise that would tear a mesh is drawn smooth; edges between surfaces stay."""

import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.level_spikes import FROM_EDGE, level_spikes
from stereo_gpu.mesh import build_mesh
from stereo_gpu.meshing.membrane import relax
from stereo_gpu.types import Disparity, Validity, View

HEIGHT, WIDTH, FOCAL, BASELINE = 80, 113, 400.0, 50.0
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
# At 20 px and this focal length a wall is seen at 10 degrees where it rises by 0.28 px a pixel.
CURTAIN = (20 + 0.02 * X + 0.01 * Y).astype(np.float32)
MOVED = Validity.MISMATCH | Validity.FILLED


def disparity_map(values):
    return Disparity(
        values=values.astype(np.float32),
        validity=np.where(np.isfinite(values), 0, Validity.OCCLUDED).astype(np.uint8),
        confidence=np.where(np.isfinite(values), 0.5, 0).astype(np.float32),
        reference=View.RIGHT,
        smallest=0,
        disparities=64,
        backend="none",
        device="none",
    )


def with_spikes(values, share=0.02, height=0.6):
    rng = np.random.default_rng(11)
    spikes = rng.random(values.shape) < share
    return values + np.where(spikes, height, 0).astype(np.float32)


def points_of(values):
    depth = FOCAL * BASELINE / values
    return np.stack([(X - WIDTH / 2) * depth / FOCAL, (Y - HEIGHT / 2) * depth / FOCAL, depth], axis=-1)


def test_spikes_on_a_surface_come_nearer_to_it():
    given = with_spikes(CURTAIN)
    levelled = level_spikes(disparity_map(given), focal_px=FOCAL)
    before, after = given - CURTAIN, levelled.values - CURTAIN
    assert np.abs(after).max() < 0.5 * np.abs(before).max()
    assert np.sqrt(np.mean(after**2)) < 0.5 * np.sqrt(np.mean(before**2))
    moved = levelled.values != given
    np.testing.assert_array_equal(levelled.validity[moved], MOVED)
    assert (levelled.confidence[moved] == 0).all()
    calm = levelled.validity == 0
    np.testing.assert_array_equal(levelled.values[calm], given[calm])
    assert (levelled.confidence[calm] == np.float32(0.5)).all()


def test_a_mesh_of_it_has_no_hole_that_it_had_before():
    given = with_spikes(CURTAIN)
    levelled = level_spikes(disparity_map(given), focal_px=FOCAL).values
    before, after = (len(build_mesh(v, points_of(v), method="dense").faces) for v in (given, levelled))
    whole = 2 * (HEIGHT - 1) * (WIDTH - 1)
    assert before < whole
    assert after == whole


def test_an_edge_between_two_surfaces_stays_to_the_bit():
    given = with_spikes(np.where(X > 60, CURTAIN + 2.5, CURTAIN), share=0.01)
    levelled = level_spikes(disparity_map(given), focal_px=FOCAL)
    edge = np.abs(X - 60.5) < FROM_EDGE - 1
    np.testing.assert_array_equal(levelled.values[edge], given[edge])
    assert (levelled.validity[edge] == 0).all()
    far = np.abs(X - 60.5) > FROM_EDGE + 8
    assert (levelled.values[far] != given[far]).any()


def test_what_is_near_may_be_rough():
    """The same step lies deeper in the picture where the cameras are near: it is shape there."""
    near = with_spikes(CURTAIN + 200)
    assert (level_spikes(disparity_map(near), focal_px=FOCAL).values == near.astype(np.float32)).all()
    # And the other way round where infinity is at 180 px.
    assert (level_spikes(disparity_map(near), focal_px=FOCAL, infinity_px=200).values != near).any()


def test_a_hole_and_a_jump_stay():
    given = np.where(X > 60, CURTAIN + 20, CURTAIN)
    given[20:30, 20:30] = np.nan
    levelled = level_spikes(disparity_map(given), focal_px=FOCAL)
    np.testing.assert_array_equal(levelled.values, given.astype(np.float32))
    np.testing.assert_array_equal(levelled.validity == Validity.OCCLUDED, np.isnan(given))


@pytest.mark.parametrize("wrong", [{"focal_px": 0}, {"max_jump_px": 0}, {"min_angle_deg": 90}])
def test_wrong_options_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        level_spikes(disparity_map(CURTAIN), **{"focal_px": FOCAL, **wrong})


def test_a_membrane_is_held_by_its_own_surface_only():
    """Between rims at 10 and at 30, what starts at 12 ends at 10, and feels nothing of 30."""
    values = np.full((9, 12), 10, np.float32)
    values[:, 8:] = 30
    moving = (X[:9, :12] >= 3) & (X[:9, :12] < 8) & (Y[:9, :12] > 0) & (Y[:9, :12] < 8)
    values[moving] = 12
    held = values.copy()
    relax(values, np.flatnonzero(moving), max_jump_px=3.0, slack=1.0, passes=300)
    np.testing.assert_array_equal(values[~moving], held[~moving])
    np.testing.assert_allclose(values[moving], 10, atol=1e-3)
