import boards
import corner_pairs
import numpy as np
import pytest

from stereo_gpu.calibration.bundle import Bundle, linearise, refine
from stereo_gpu.calibration.next_view import find_next_view
from stereo_gpu.calibration.uncertainty import (
    corner_variance,
    depth_deviations,
    depth_slopes,
    shared_covariance,
    working_places,
)


def fitted(bundle, seed):
    corners = corner_pairs.corners_of(bundle, seed)
    found = refine(bundle, corners)
    return found, linearise(found, corners), 2 * len(corners[0].seen)


def advised(found, normal, places):
    information = normal.reduced()[0].sum(axis=0)
    return find_next_view(found, information, places, corner_pairs.SIZES, corner_pairs.BOARD)


@pytest.fixture(scope="module")
def few():
    found, normal, count = fitted(corner_pairs.truth(5, seed=6, tilt=0.3), 6)
    places = working_places(found, corner_pairs.SIZES, [400.0, 650.0])
    return found, normal, count, places, advised(found, normal, places)


def test_it_lies_in_both_pictures(few):
    found, *_, following = few
    board = Bundle(found.lenses, found.R, found.T, following.rotation[None], following.translation[None])
    for ours in corner_pairs.corners_of(board):
        assert (ours.seen > 0).all() and (ours.seen < boards.SIZE).all()


def test_taking_it_gains_what_was_promised(few):
    found, normal, count, places, following = few
    truth = corner_pairs.truth(5, seed=6, tilt=0.3)
    more = Bundle(
        truth.lenses,
        truth.R,
        truth.T,
        np.concatenate([truth.rotations, following.rotation[None]]),
        np.concatenate([truth.translations, following.translation[None]]),
    )
    after = fitted(more, 7)
    deviations = [
        depth_deviations(depth_slopes(bundle, places), shared_covariance(there, corners))
        for bundle, there, corners in ((found, normal, count), after)
    ]
    gained = 1 - np.exp(np.log(deviations[1] / deviations[0]).mean())
    assert following.gain > 0.2
    assert gained == pytest.approx(following.gain, abs=0.1)


def test_it_beats_views_like_those_before(few):
    found, normal, count, places, following = few
    variance = corner_variance(normal, count)
    information = normal.reduced()[0].sum(axis=0)
    slopes = depth_slopes(found, places)
    now = depth_deviations(slopes, variance * np.linalg.inv(information))
    for again in normal.reduced()[0]:
        then = depth_deviations(slopes, variance * np.linalg.inv(information + again))
        assert 1 - np.exp(np.log(then / now).mean()) < following.gain


def test_words(few):
    *_, following = few
    told = following.told("mm")
    assert told.startswith("next: hold the board ")
    assert "both pictures" in told and " mm), " in told
    assert told.endswith(f"depth would be {following.gain:.0%} more certain")


def test_advice_ends_when_nothing_gains(few):
    found, normal, _, places, _ = few
    information = 1e6 * normal.reduced()[0].sum(axis=0)  # as if every view had been taken so often
    assert find_next_view(found, information, places, corner_pairs.SIZES, corner_pairs.BOARD) is None
