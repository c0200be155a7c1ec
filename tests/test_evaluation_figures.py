import numpy as np

from stereo_gpu.evaluation import figures
from stereo_gpu.evaluation.sparsification import sparsify
from stereo_gpu.figures import NO_VALUE


def test_each_error_has_its_colour():
    truth = np.full((6, 80), 10, np.float32)
    values = truth + np.array([[0], [0.5], [-1], [2], [-4], [4.5]], np.float32)
    values[:, 70:] = np.nan
    truth[:, :10] = np.nan
    picture = figures.colour_errors(values, truth)
    level = [0, 0, 1, 2, 3, 4]  # an error that equals a threshold is not over it
    for row in range(6):
        assert (picture[row, :10] == figures.UNKNOWN).all()
        assert (picture[row, 10:70] == figures.ERROR_COLOURS[level[row]]).all()
        assert (picture[row, 70:] == NO_VALUE).all()
    counted = np.zeros(truth.shape, bool)
    counted[:, 40:] = True
    picture = figures.colour_errors(values, truth, counted)
    assert (picture[:6, :40] == figures.UNKNOWN).all() and (picture[:6, 40:] != figures.UNKNOWN).any(axis=2).all()


def test_darker_is_worse():
    brightness = np.array(figures.ERROR_COLOURS).sum(axis=1)
    assert (np.diff(brightness) < -60).all()


def test_map_and_truth_share_their_colours():
    truth = np.tile(np.linspace(10, 50, 60, dtype=np.float32), (40, 1))
    shown, true = figures.colour_pair(truth - 0.0, truth)
    np.testing.assert_array_equal(shown, true)
    shown, _ = figures.colour_pair(truth / 2, truth)
    assert (shown[:40, 0] == true[:40, 0]).all() and (shown[:40, 59] != true[:40, 59]).any()


def test_sparsification_shows_three_curves():
    random = np.random.default_rng(4)
    truth = np.full((50, 60), 9, np.float32)
    errors = random.exponential(1, truth.shape).astype(np.float32)
    curve = sparsify(truth + errors, truth, random.uniform(0, 1, truth.shape) - errors / 4).bad
    picture = figures.draw_sparsification(curve, name="bad-1.0")
    assert picture.shape == (400, 640, 3)
    colours = [(205, 50, 60), (70, 120, 190), (128, 132, 138)]
    below = [np.flatnonzero((picture[30:350, 200] == colour).all(axis=1)) for colour in colours]
    map_row, oracle_row, random_row = (rows.mean() for rows in below)
    assert random_row < map_row < oracle_row  # rows count downwards: the oracle's error is the lowest
    without_errors = sparsify(truth, truth, truth).bad
    assert figures.draw_sparsification(without_errors, name="bad-1.0").shape == (400, 640, 3)
