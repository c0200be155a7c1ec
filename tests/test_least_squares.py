"""The fit of a few numbers ends where SciPy's does, whose import takes longer than the fit."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import least_squares

from stereo_gpu.epipolar.least_squares import fit_softly


@pytest.mark.parametrize("seed", range(4))
def test_numbers_and_slopes_are_those_of_scipy(seed):
    random = np.random.default_rng(seed)
    x = random.uniform(-1, 1, 300)
    truth = random.normal(0, [1, 0.3, 1])
    y = truth[0] * np.exp(truth[1] * x) + truth[2] * x + random.normal(0, 0.1, 300)
    y[::5] += random.normal(0, 30, 60)

    def residuals(numbers):
        return np.concatenate([(numbers[0] * np.exp(numbers[1] * x) + numbers[2] * x - y) / 0.1, numbers / 5])

    start, scale = np.array([truth[0] + 0.5, 0.0, 0.0]), np.array([1.0, 0.3, 1.0])
    fit = fit_softly(residuals, start, scale)
    exact = least_squares(residuals, start, loss="soft_l1", x_scale=scale, xtol=1e-12, ftol=1e-12)
    deviations = np.linalg.norm(np.linalg.pinv(exact.jac), axis=1)
    assert np.allclose(fit.numbers, exact.x, rtol=0, atol=0.01 * deviations)
    assert np.allclose(np.linalg.norm(np.linalg.pinv(fit.slopes), axis=1), deviations, rtol=0.01)


def test_it_stays_within_bounds_and_takes_exact_and_flat_residuals():
    line = np.linspace(-1, 1, 9)
    assert fit_softly(lambda n: line * (n[0] - 80), np.zeros(1), np.ones(1), largest=50.0).numbers[0] == 50
    exact = fit_softly(lambda n: line * n[0] + n[1] - 1, np.zeros(2), np.ones(2)).numbers
    assert np.allclose(exact, [0, 1], atol=1e-9)
    flat = fit_softly(lambda n: np.ones(4) + 0 * n[0], np.array([3.0]), np.ones(1))
    assert flat.numbers[0] == 3 and not flat.slopes.any()


def test_a_rig_is_checked_without_scipy_optimize(raw_folder):
    code = f"""
import sys, stereo_gpu as sg
folder = {str(raw_folder)!r}
left, right = (sg.read_image(f"{{folder}}/{{side}}.png") for side in ("left", "right"))
print(sg.check_rig(left, right, sg.Rig.load(f"{{folder}}/rig.json")).verdict, "scipy.optimize" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["good", "False"]
