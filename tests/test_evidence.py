"""Slopes and evidence against the loops in reference.py on every device, and the same bits in every form."""

import cv2
import numpy as np
import pytest
import reference
from test_gpu_forms import opened

# Sums of 25 products of grey levels in single precision, whose means are then taken away.
STEP_TOLERANCE = 2e-3  # px
SHARE_TOLERANCE = 5e-3  # of information and residual
# The grey levels of where a sample hardly lies in the other picture may or may not count.
SHARE_OF_FLIPS = 0.003
STEP = {"noise": 2.0, "damping": 50.0, "largest_step": 1.0}
# A pixel, less than the other picture's four neighbours, than a vector, than two, and a bit more.
SHAPES = [(1, 1), (5, 3), (4, 11), (3, 16), (9, 33), (7, 35), (6, 150)]
FORMS = [("opencl", "gpu"), ("opencl", "cpu"), ("warp:cpu", "gpu"), ("warp:cpu", "cpu")]


def scene(shape, direction, off=0.3):
    """Two pictures of a surface with a bend and a jump, and its disparity, off by so much, with outliers and holes."""
    height, width = shape
    rng = np.random.default_rng(13)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    truth = 6 + 0.2 * x + 0.1 * np.abs(y - height / 2) - 0.3 * np.maximum(x - width / 2, 0) + 4 * (x > 0.8 * width)
    texture = cv2.GaussianBlur(rng.normal(0, 60, (height, width + 80)), (0, 0), 1.2) * 3
    other = np.clip(np.round(texture[:, 40 : 40 + width]), -128, 127).astype(np.float32)
    places = (x + direction * truth).astype(np.float32)
    ours = cv2.remap(texture.astype(np.float32), places + 40, y.astype(np.float32), cv2.INTER_LINEAR)
    ours = np.clip(np.round(ours + 9), -128, 127).astype(np.float32)
    disparity = (truth + off * np.where(y % 2, 1, -1)).astype(np.float32)
    disparity[rng.random(shape) < 0.05] += 7
    disparity[rng.random(shape) < 0.1] = np.nan
    guide = np.clip(ours + 128 + rng.normal(0, 9, (3, *shape)), 0, 255).astype(np.uint8)
    return (ours, other), (disparity, *reference.slopes(disparity, 2, 1.0).astype(np.float32)), guide, truth


def launched(backend, pictures, planes, guide, **numbers):
    given = dict(zip(("reference", "other"), pictures, strict=True))
    given |= dict(zip(("disparity", "along_x", "along_y"), planes, strict=True)) | {"guide": guide}
    held = {name: backend.upload(np.ascontiguousarray(array)) for name, array in given.items()}
    names = ("moved_out", "information_out", "residual_out")
    out = {name: backend.upload(np.full_like(planes[0], 77)) for name in names}
    height, width = planes[0].shape
    backend.launch("evidence", **held, width=width, height=height, **numbers, **out)
    return [backend.download(array) for array in out.values()]


def leaning(backend, disparity, reach, largest):
    out = {name: backend.upload(np.full_like(disparity, 77)) for name in ("along_x_out", "along_y_out")}
    numbers = {"width": disparity.shape[1], "height": disparity.shape[0], "reach": reach, "largest": largest}
    backend.launch("slopes", disparity=backend.upload(disparity), **numbers, **out)
    return [backend.download(array) for array in out.values()]


@pytest.mark.parametrize(("reach", "largest"), [(2, 1.0), (1, 0.25), (5, 9.0)])
def test_slopes(backend, reach, largest):
    disparity = scene((23, 37), 1)[1][0]
    want = reference.slopes(disparity, reach, largest)
    np.testing.assert_allclose(leaning(backend, disparity, reach, largest), want, atol=1e-5)
    assert (want == 0).any() and (want[0] > 0.1).any() and (want[0] < 0).any()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(
    ("radius", "stride", "weighted", "keep"), [(2, 1, 1, 16.0), (2, 2, 0, 0.0), (1, 1, 0, 0.0), (3, 3, 1, 4.0)]
)
def test_evidence(backend, direction, radius, stride, weighted, keep):
    *given, _truth = scene((21, 71), direction)
    numbers = {"radius": radius, "stride": stride, "direction": direction, "weighted": weighted, **STEP, "keep": keep}
    moved, information, residual = launched(backend, *given, **numbers)
    wanted, certain, variance = reference.evidence(*given, **numbers)
    np.testing.assert_array_equal(np.isnan(moved), np.isnan(wanted))
    off = np.abs(moved - wanted) > STEP_TOLERANCE
    off |= np.abs(information - certain) > SHARE_TOLERANCE * (1 + certain)
    off |= np.abs(residual - variance) > SHARE_TOLERANCE * (1 + variance)
    assert off.mean() <= SHARE_OF_FLIPS
    assert ((certain > 0).mean() > 0.5 / stride**2) and (certain == 0).any()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("weighted", [0, 1])
def test_a_step_leads_to_the_truth(backend, direction, weighted):
    *given, truth = scene((41, 90), direction)
    numbers = {"radius": 2, "stride": 1, "direction": direction, "weighted": weighted, **STEP, "keep": 0.0}
    moved, information, _ = launched(backend, *given, **numbers)
    sure = (information > 20) & (np.abs(given[1][0] - truth) < 0.5)
    assert sure.mean() > 0.25
    before, after = (np.median(np.abs(values - truth)[sure]) for values in (given[1][0], moved))
    assert before > 0.29 and after < 0.1
    damped, same, _ = launched(backend, *given, **{**numbers, "keep": 16.0})
    np.testing.assert_array_equal(information, same)
    shrunk = (moved - given[1][0]) * information / (information + 16)
    np.testing.assert_allclose(damped - given[1][0], shrunk, atol=1e-5)


def test_where_nothing_is_asked_or_known(backend):
    pictures, planes, guide, _ = scene((12, 70), 1)
    numbers = {"radius": 2, "stride": 2, "direction": 1, "weighted": 0, **STEP, "keep": 0.0}
    moved, information, residual = launched(backend, pictures, planes, guide, **numbers)
    skipped = np.ones(moved.shape, bool)
    skipped[::2, ::2] = np.isnan(planes[0][::2, ::2])
    np.testing.assert_array_equal(moved[skipped], planes[0][skipped])
    assert (information[skipped] == 0).all() and (residual[skipped] == 1e6).all()
    assert (information[~skipped] > 0).any()
    # A surface whose partners all lie outside of the other picture, and one without texture.
    away = np.full_like(planes[0], 500)
    moved, information, residual = launched(backend, pictures, (away, *planes[1:]), guide, **numbers)
    assert (moved == 500).all() and (information == 0).all() and (residual == 1e6).all()
    flat = np.full_like(away, 5)
    level = np.full_like(away, 5), np.full_like(away, 4)
    moved, information, residual = launched(backend, level, (flat, flat * 0, flat * 0), guide, **numbers)
    assert (moved == 5).all() and (information == 0).all() and (residual[::2, ::2] < 1).any()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("name", "form"), FORMS)
def test_the_same_bits(name, form, shape):
    first, other = opened(*FORMS[0]), opened(name, form)
    for direction, weighted, stride, radius in (
        (1, 1, 1, 2),
        (-1, 0, 2, 2),
        (1, 1, 2, 1),
        (-1, 1, 3, 2),
        (1, 0, 1, 4),
        (1, 1, 2, 17),
    ):
        *given, _ = scene(shape, direction)
        numbers = {"radius": radius, "stride": stride, "direction": direction, "weighted": weighted, **STEP}
        found = [launched(backend, *given, **numbers, keep=16.0) for backend in (first, other)]
        found[0] += leaning(first, given[1][0], radius, 0.5)
        found[1] += leaning(other, given[1][0], radius, 0.5)
        for want, got in zip(*found, strict=True):
            np.testing.assert_array_equal(got, want)
