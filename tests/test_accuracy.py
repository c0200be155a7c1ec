"""The bars that the profiles must clear on real pictures; what is measured in full stands in docs/accuracy.md.

Shares in per cent of the counted pixels; a pixel without a value counts as wrong. One set of parameters for all.
"""

import functools

import numpy as np
import pytest

from stereo_gpu.evaluation.accuracy import (
    board_files,
    board_mean,
    calibrate_boards,
    found_range,
    measure_boards,
    measure_pair,
)
from stereo_gpu.evaluation.cost import bench_pair, measure_costs
from stereo_gpu.evaluation.matchers import AUTO, FAST, PRECISE, YARDSTICK, opencv_matchers, our_matchers
from stereo_gpu.evaluation.pairs import PAIRS, PUBLISHED, load_pair
from stereo_gpu.evaluation.sparsification import sparsify

# Non-occluded pixels wrong by more than 1 px, at most. PatchMatch Stereo has 2.09 and 2.99, AD-Census 1.07 and 4.10,
# OpenCV's SGBM HH 4.71 and 10.02; the aim of precise is 1.0 and 2.9.
WRONG = {
    (FAST, "tsukuba"): 7.5,
    (FAST, "teddy"): 13.0,
    (PRECISE, "tsukuba"): 2.5,
    (PRECISE, "teddy"): 4.5,
}
MOTORCYCLE_TO_SGBM = 0.5  # wrong pixels of precise, occluded ones too, over those of OpenCV's best SGBM HH
LIGHT_POINTS = {"aloe, other exposure": 1.0, "aloe, other light": 8.0}  # more than in the same light
BOARD_COVERAGE, BOARD_MEDIAN_PX, BOARD_WRONG = 95.0, 0.3, 10.0  # inside of the outline, average of the 13 pairs
RANGE_RATIO = 1.5  # found over true range, on average
TIME_TO_SGBM = 3.0  # precise over SGBM HH, 640 x 480 x 64
# What PatchMatch Stereo submitted, as Middlebury scored it: the evaluation must say the same.
SUBMITTED = {"tsukuba": (2.09, 2.33, 9.31), "teddy": (2.99, 8.16, 9.62)}


def ours(*names):
    return [matcher for matcher in our_matchers(None) if matcher.name in names]


def sgbm():
    return [matcher for matcher in opencv_matchers() if matcher.name.startswith("SGBM HH")]


@pytest.fixture(scope="module")
def measured(data):
    """Every pair with fast and precise, and with the range that is found; each is measured once."""

    @functools.cache
    def of(name):
        others = sgbm() if name == "motorcycle" else []
        return measure_pair(load_pair(data, name), ours(FAST, PRECISE, AUTO) + others)

    return of


@pytest.fixture(scope="module")
def boards(data):
    files = board_files(data)
    return list(measure_boards(files, calibrate_boards(files), ours(AUTO), None))


def wrong(measured, matcher, mask=None):
    return 100 * measured.results[matcher].scores[mask or measured.pair.mask].bad[1.0]


@pytest.mark.parametrize(("matcher", "name"), WRONG)
def test_wrong_pixels(measured, matcher, name):
    assert wrong(measured(name), matcher) <= WRONG[matcher, name]


def test_motorcycle_has_half_the_wrong_pixels_of_opencv(measured):
    found = measured("motorcycle")
    best = min(wrong(found, matcher.name) for matcher in sgbm())
    assert wrong(found, PRECISE) < MOTORCYCLE_TO_SGBM * best


@pytest.mark.parametrize(
    ("matcher", "name"), [(FAST, "aloe, other exposure"), *((PRECISE, name) for name in LIGHT_POINTS)]
)
def test_light_changes_little(measured, matcher, name):
    assert wrong(measured(name), matcher) - wrong(measured("aloe"), matcher) <= LIGHT_POINTS[name]


def test_board_is_covered(boards):
    assert 100 * board_mean(boards, AUTO, lambda scores: scores.coverage) >= BOARD_COVERAGE


def test_board_is_flat(boards):
    assert board_mean(boards, AUTO, lambda scores: scores.quantiles[50]) <= BOARD_MEDIAN_PX


def test_board_has_few_wrong_pixels(boards):
    assert 100 * board_mean(boards, AUTO, lambda scores: scores.bad[1.0]) <= BOARD_WRONG


def test_board_lies_in_the_range_that_is_found(boards):
    assert len(boards) == 13
    assert {board.name: board.range.inside for board in boards if board.range.inside < 1} == {}


def test_range_that_is_found_is_true_and_short(measured):
    ranges = [found_range(name, measured(name).pair.truth, measured(name).results[AUTO].found.search) for name in PAIRS]
    assert {found.name: found.inside for found in ranges if found.inside < 1} == {}
    ratio = np.mean([found.ratio for found in ranges])
    assert ratio <= RANGE_RATIO


@pytest.mark.parametrize("matcher", [FAST, PRECISE])
@pytest.mark.parametrize("name", PAIRS)
def test_confidence_tells_more_than_chance(measured, matcher, name):
    found, pair = measured(name).results[matcher].found, measured(name).pair
    share = sparsify(found.values, pair.truth, found.confidence, pair.masks[pair.mask]).bad.share_of_random
    assert share < 1


@pytest.mark.parametrize("name", SUBMITTED)
def test_published_maps_score_as_published(measured, name):
    for mask, share in zip(("nonocc", "all", "disc"), SUBMITTED[name], strict=True):
        assert wrong(measured(name), PUBLISHED, mask) == pytest.approx(share, abs=0.005)


def test_precise_takes_at_most_three_times_as_long_as_opencv():
    yardstick = [matcher for matcher in sgbm() if matcher.name == YARDSTICK]
    cost = measure_costs(*bench_pair(), ours(PRECISE) + yardstick, seconds=0.5, cap=5.0)[PRECISE]
    # Other work on the machine lengthens the wall time of all cores more than that of OpenCV's one; where there is
    # none, the wall time is the smaller one.
    ratio = min(cost.wall, cost.cpu)
    assert ratio <= TIME_TO_SGBM
