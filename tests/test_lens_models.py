import boards
import corner_pairs
import numpy as np
import pytest

from stereo_gpu.calibration.bundle import Bundle
from stereo_gpu.calibration.fit import fit_pairs
from stereo_gpu.calibration.lens_models import choose_lens_model

# A lens of 100 degrees across whose image shrinks to the edge as no polynomial of three terms can follow.
WIDE_LEFT = boards.lens(210.0, 243.0, 176.0, [0.9, 0.25, 0.0005, 0.0002, 0.01, 1.25, 0.5, 0.03])
WIDE_RIGHT = boards.lens(212.0, 240.0, 180.0, [0.92, 0.26, 0.0005, 0.0002, 0.01, 1.26, 0.5, 0.03])


def wide_pairs(count=16, seed=2):
    """Boards all over the pictures of two wide lenses."""
    random = np.random.default_rng(seed)
    lenses = corner_pairs.truth(1, 0, left=WIDE_LEFT, right=WIDE_RIGHT)
    kept = []
    for rotation in corner_pairs.held(400, seed, tilt=0.5)[0]:
        place = random.uniform((-0.9, -0.7, 1.0), (1.0, 0.7, 1.0)) * random.uniform(170, 300)
        middle = np.array([105.0, 75.0, 0.0])
        trial = Bundle(lenses.lenses, lenses.R, lenses.T, rotation[None], (place - rotation @ middle)[None])
        seen = np.concatenate([ours.seen for ours in corner_pairs.corners_of(trial)])
        if (seen > 3).all() and (seen < np.array(boards.SIZE) - 4).all():
            kept.append((rotation, trial.translations[0]))
        if len(kept) == count:
            break
    poses = (np.stack(part) for part in zip(*kept, strict=True))
    whole = Bundle(lenses.lenses, lenses.R, lenses.T, *poses)
    return corner_pairs.as_pairs(corner_pairs.corners_of(whole, seed))


def test_a_plain_lens_takes_the_fewest():
    fit = fit_pairs(corner_pairs.pairs(12), corner_pairs.SIZES, corner_pairs.BOARD, 5)
    models = choose_lens_model(fit)
    assert models.chosen == 5
    assert sorted(models.errors_px) == [5, 8, 12]
    # What is left out is predicted about as well as the noise allows: 0.1 px in each direction.
    assert all(0.12 < error < 0.2 for error in models.errors_px.values())


def test_a_wide_lens_takes_more():
    fit = fit_pairs(wide_pairs(), corner_pairs.SIZES, corner_pairs.BOARD, 5)
    models = choose_lens_model(fit)
    assert models.chosen == 8
    assert models.errors_px[8] < 0.75 * models.errors_px[5]
    again = fit_pairs(wide_pairs(), corner_pairs.SIZES, corner_pairs.BOARD, 8)
    np.testing.assert_allclose(again.bundle.T, corner_pairs.SHIFT, atol=0.5)


def test_few_views_do():
    fit = fit_pairs(corner_pairs.pairs(4), corner_pairs.SIZES, corner_pairs.BOARD, 5)
    assert choose_lens_model(fit).chosen == 5


@pytest.mark.parametrize("coefficients", [5, 8, 12])
def test_every_model_can_be_asked_for(coefficients):
    fit = fit_pairs(corner_pairs.pairs(12), corner_pairs.SIZES, corner_pairs.BOARD, coefficients)
    assert [len(lens) for lens in fit.bundle.lenses] == [4 + coefficients] * 2
    np.testing.assert_allclose(np.linalg.norm(fit.bundle.T), np.linalg.norm(corner_pairs.SHIFT), rtol=0.01)
