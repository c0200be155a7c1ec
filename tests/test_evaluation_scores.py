import json

import numpy as np
import pytest

from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.masks import read_mask
from stereo_gpu.evaluation.scores import score
from stereo_gpu.evaluation.truth import read_truth

NAN = np.nan
# Errors, row by row: 0, 0.5, 0.75, 1 | 1.5, 3, no value, 4.5 | not counted, truth unknown, 2, 4.
TRUTH = np.array([[10, 10, 10, 10], [20, 20, 20, 20], [5, NAN, 7, 8]], np.float32)
VALUES = np.array([[10, 9.5, 10.75, 11], [21.5, 17, NAN, 15.5], [99, 3, 9, 12]], np.float32)
COUNTED = np.ones((3, 4), bool)
COUNTED[2, 0] = False


def test_scores_by_hand():
    found = score(VALUES, TRUTH, COUNTED)
    errors = [0, 0.5, 0.75, 1, 1.5, 3, 4.5, 2, 4]
    assert (found.counted, found.given) == (10, 9)
    assert found.coverage == 0.9
    assert found.bad == {0.5: 0.8, 1.0: 0.6, 2.0: 0.4, 4.0: 0.2}
    assert found.bad_given == {0.5: 7 / 9, 1.0: 5 / 9, 2.0: 3 / 9, 4.0: 1 / 9}
    assert found.mean == pytest.approx(sum(errors) / 9)
    assert found.rms == pytest.approx((sum(error**2 for error in errors) / 9) ** 0.5)
    # Nine sorted errors: the median is the fifth, 90 % lies 7.2 steps in, 95 % 7.6.
    assert found.quantiles == pytest.approx({50: 1.5, 90: 4.1, 95: 4.3})


def test_without_a_mask_every_known_pixel_counts():
    found = score(VALUES, TRUTH)
    assert (found.counted, found.given) == (11, 10)
    assert found.bad[4.0] == 3 / 11


def test_infinite_is_no_value_on_either_side():
    values, truth = VALUES.copy(), TRUTH.copy()
    values[np.isnan(values)] = np.inf
    truth[np.isnan(truth)] = -np.inf
    assert score(values, truth, COUNTED) == score(VALUES, TRUTH, COUNTED)


def test_a_map_without_values_is_bad_everywhere():
    found = score(np.full_like(VALUES, NAN), TRUTH)
    assert found.coverage == 0 and set(found.bad.values()) == {1.0}
    assert np.isnan([*found.bad_given.values(), found.mean, found.rms, *found.quantiles.values()]).all()
    flat = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert flat["bad_1.0"] == 1 and flat["bad_1.0_given"] is None and flat["a90"] is None


def test_an_error_equal_to_the_threshold_is_good_whatever_the_scale():
    """Thirds of a px are not exact in float32: (10 - 7) / 3 would be wrong by more than 1 px."""
    levels = np.arange(4, 256, dtype=np.float32)[None]
    for scale in (1, 3, 4, 16):
        found = score((levels - scale) / np.float32(scale), levels / np.float32(scale))
        assert found.bad[1.0] == 0 and found.bad[0.5] == 1


@pytest.mark.parametrize(
    ("values", "truth", "counted", "says"),
    [
        (VALUES[:2], TRUTH, None, "the map is 4 x 2 px, its truth 4 x 3 px"),
        (VALUES[None], TRUTH, None, "the map is of shape"),
        (VALUES, TRUTH, COUNTED[:, :3], "the mask is 3 x 3 px, the truth 4 x 3 px"),
        (VALUES, TRUTH, np.full((3, 4), 255, np.uint8), "holds uint8"),
        (VALUES, TRUTH, np.isnan(TRUTH), "none of 12 pixels"),
        (VALUES, np.full_like(TRUTH, NAN), None, "none of 12 pixels"),
    ],
)
def test_what_cannot_be_scored_is_refused(values, truth, counted, says):
    with pytest.raises(InputError, match=says):
        score(values, truth, counted)


@pytest.mark.parametrize(
    ("pair", "scale", "published"), [("teddy", 4, (2.99, 8.16, 9.62)), ("tsukuba", 16, (2.09, 2.33, 9.31))]
)
def test_patchmatch_stereo_scores_as_published(data, pair, scale, published):
    folder = data / "stereo" / pair
    values, truth = (read_truth(folder / name, scale) for name in ("alg117.png", "groundtruth.png"))
    for name, share in zip(("nonocc", "all", "disc"), published, strict=True):
        found = score(values, truth, read_mask(folder / f"{name}.png"))
        assert round(100 * found.bad[1.0], 2) == share
