import json

import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.sparsification import sparsify

ERRORS = np.array([[0, 4, 2, 0]], np.float32)
TRUTH = np.full((1, 4), 10, np.float32)
VALUES = TRUTH + ERRORS


def test_by_hand():
    """Confidence takes away, in turn, the errors 2, 0, 4, 0; the oracle 4, 2, 0, 0."""
    found = sparsify(VALUES, TRUTH, np.array([[0.9, 0.6, 0.2, 0.4]], np.float32))
    # Kept, from the surest on: errors 0 (0.9), 4 (0.6), 0 (0.4), 2 (0.2).
    assert found.bad.area == pytest.approx((0 + 1 / 2 + 1 / 3 + 2 / 4) / 4)
    assert found.bad.oracle_area == pytest.approx((0 + 0 + 1 / 3 + 2 / 4) / 4)
    assert found.bad.random_area == 0.5
    assert found.mean.area == pytest.approx((0 + 4 / 2 + 4 / 3 + 6 / 4) / 4)
    assert found.mean.oracle_area == pytest.approx((0 + 0 + 2 / 3 + 6 / 4) / 4)
    assert found.mean.random_area == 1.5
    assert found.bad.ause == pytest.approx(1 / 8)
    assert found.bad.share_of_random == pytest.approx((1 / 8) / (0.5 - 5 / 24))


def test_the_oracle_scores_zero_and_a_constant_scores_as_random():
    random = np.random.default_rng(3)
    truth = random.uniform(0, 50, (40, 57)).astype(np.float32)
    errors = random.gamma(0.6, 1.2, truth.shape).astype(np.float32)
    oracle = sparsify(truth + errors, truth, -np.abs((truth + errors) - truth))
    assert oracle.mean.ause == 0 and oracle.bad.ause == pytest.approx(0, abs=1e-12)
    # Source of the closed form: Hu and Mordohai, equation 14.
    share = (errors > 1).mean()
    assert oracle.bad.oracle_area == pytest.approx(share + (1 - share) * np.log(1 - share), abs=1e-3)
    constant = sparsify(truth + errors, truth, np.full(truth.shape, 0.3, np.float32))
    assert constant.bad.share_of_random == pytest.approx(1)
    assert constant.mean.share_of_random == pytest.approx(1)
    np.testing.assert_allclose(constant.mean.rest, constant.mean.random_area)
    wrong_way = sparsify(truth + errors, truth, errors)
    assert wrong_way.bad.share_of_random > 1.5


def test_curves_end_at_the_error_of_all():
    random = np.random.default_rng(5)
    truth = np.full((31, 47), 20, np.float32)
    errors = random.exponential(1, truth.shape).astype(np.float32)
    confidence = (1 / (1 + errors + random.uniform(0, 1, truth.shape))).astype(np.float32)
    found = sparsify(truth + errors, truth, confidence)
    for curve in (found.bad, found.mean):
        assert curve.density.shape == curve.rest.shape == curve.oracle.shape == (100,)
        assert curve.rest[-1] == pytest.approx(curve.random_area) and curve.oracle[-1] == pytest.approx(curve.rest[-1])
        assert (curve.rest >= curve.oracle - 1e-12).all() and (np.diff(curve.oracle) >= -1e-12).all()
        assert 0 < curve.share_of_random < 0.6
        stored = json.loads(json.dumps(curve.as_dict(), allow_nan=False))
        assert stored["ause"] == pytest.approx(curve.area - curve.oracle_area) and len(stored["rest"]) == 100


def test_pixels_without_value_truth_or_count_take_no_part():
    values = np.hstack([VALUES, [[np.nan, 99, 99]]]).astype(np.float32)
    truth = np.hstack([TRUTH, [[10, np.nan, 10]]]).astype(np.float32)
    confidence = np.array([[0.9, 0.6, 0.2, 0.4, 1, 1, 1]], np.float32)
    counted = np.array([[True] * 6 + [False]])
    small = sparsify(VALUES, TRUTH, confidence[:, :4])
    large = sparsify(values, truth, confidence, counted)
    assert large.bad.area == small.bad.area and large.mean.area == small.mean.area


def test_confidence_that_is_not_finite_goes_first():
    confidence = np.array([[0.9, np.nan, 0.2, 0.4]], np.float32)
    lowest = np.array([[0.9, -5, 0.2, 0.4]], np.float32)
    assert sparsify(VALUES, TRUTH, confidence).bad.area == sparsify(VALUES, TRUTH, lowest).bad.area


def test_a_map_without_errors():
    found = sparsify(TRUTH, TRUTH, TRUTH)
    assert found.bad.ause == 0 and np.isnan(found.bad.share_of_random)
    assert found.bad.as_dict()["share_of_random"] is None


def test_what_cannot_be_sparsified_is_refused():
    with pytest.raises(InputError, match="the confidence is 3 x 1 px, the map 4 x 1 px"):
        sparsify(VALUES, TRUTH, TRUTH[:, :3])
    with pytest.raises(InputError, match="none of 4 pixels a value"):
        sparsify(np.full_like(VALUES, np.nan), TRUTH, TRUTH)
