"""Planes that flat surfaces take: against the loops in reference.py on every device, and both forms' bits."""

import numpy as np
import pytest
import reference
from test_gpu_forms import opened

# Four products in single precision, px.
PLANE_TOLERANCE = 1e-4
# What is left unexplained may lie at a limit.
SHARE_OF_FLIPS = 0.005
NUMBERS = {"direction": 1, "noise": 6.0, "least_agreement": 0.6, "least_share": 0.8}
# A pixel, less than a vector, one and a bit, more than what is taken at a time.
SHAPES = [(1, 1), (2, 3), (5, 17), (31, 47), (9, 150), (7, 1300)]


def launched(backend, kernel, arrays, outputs, **numbers):
    shape = next(iter(arrays.values())).shape
    out = {name: backend.upload(np.full(shape, 77, dtype)) for name, dtype in outputs.items()}
    held = {name: backend.upload(array) for name, array in arrays.items()}
    backend.launch(kernel, **held, width=shape[1], height=shape[0], **numbers, **out)
    return [backend.download(array) for array in out.values()]


def launch_agreement(backend, arrays, radius):
    return launched(backend, "agreement", arrays, {"agreement_out": np.float32}, radius=radius)


def launch_majority(backend, arrays, radius):
    outputs = {"disparity_out": np.float32, "taken_out": np.uint8}
    return launched(backend, "majority", arrays, outputs, radius=radius)


def launch_flat(backend, arrays, **numbers):
    outputs = dict.fromkeys(("plane_out", "along_x_out", "along_y_out"), np.float32) | {"wanted_out": np.uint8}
    _, planes_high, planes_wide = arrays["planes"].shape
    return launched(backend, "flat", arrays, outputs, planes_wide=planes_wide, planes_high=planes_high, **numbers)


def checked_map(shape):
    """A map with holes, some of them large, and pixels that are taken."""
    rng = np.random.default_rng(3)
    checked = rng.uniform(0, 30, shape).astype(np.float32)
    checked[rng.random(shape) < 0.3] = np.nan
    checked[shape[0] // 2 :, : shape[1] // 3] = np.nan
    return {"checked": checked, "taken": rng.choice(np.array([0, 0, 1, 255], np.uint8), shape)}


def wishes(shape):
    """Who wants a plane, in patches, planes with holes, and a map with holes."""
    rng = np.random.default_rng(4)
    patches = rng.random((shape[0] // 6 + 1, shape[1] // 6 + 1)).repeat(6, axis=0).repeat(6, axis=1)
    wanted = rng.random(shape) < patches[: shape[0], : shape[1]]
    plane, disparity = (rng.uniform(0, 30, shape).astype(np.float32) for _ in range(2))
    plane[rng.random(shape) < 0.1] = np.nan
    disparity[rng.random(shape) < 0.2] = np.nan
    return {"wanted": np.where(wanted, 200, 0).astype(np.uint8), "plane": plane, "disparity": disparity}


def scene(shape, pitch, direction):
    """Two views of a surface that leans, with faint texture and noise; planes, of which some are wrong or missing."""
    rng = np.random.default_rng(5)
    height, width = shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    truth = 6 + 0.07 * x + 0.15 * y

    def grey(u, v):
        return 40 * np.sin(0.11 * u + 0.2 * v) + 0.8 * u % 60

    reference_view = grey(x, y) + rng.normal(0, 1.5, shape)
    # To first order: where the other view's pixel comes from.
    other = grey(x - direction * truth, y) + rng.normal(0, 1.5, shape) + 12
    planes_high, planes_wide = -(-height // pitch), -(-width // pitch)
    u, v = np.meshgrid(np.arange(planes_wide) * pitch, np.arange(planes_high) * pitch)
    centre = (pitch - 1) / 2
    planes = np.stack([6 + 0.07 * (u + centre) + 0.15 * (v + centre), 0.07 + 0 * u, 0.15 + 0 * u, 0 * u])
    planes += rng.normal(0, 0.02, planes.shape)
    planes[0, rng.random(u.shape) < 0.2] += 5
    planes[3] = rng.choice([1.0, 0.93, 0.5, 0.0], u.shape, p=[0.5, 0.3, 0.1, 0.1])
    missing = rng.random(u.shape) < 0.15
    missing[: planes_high // 2, planes_wide * 2 // 3 :] = True
    planes[:, missing] = np.array([np.nan, 0, 0, 0])[:, None]
    disparity = truth + rng.normal(0, 3, shape)
    disparity[rng.random(shape) < 0.05] = np.nan
    disparity[rng.random(shape) < 0.01] += 500
    arrays = {
        "reference": reference_view,
        "other": other,
        "planes": planes,
        "disparity": disparity,
        "agreement": rng.random(shape),
    }
    return {name: array.astype(np.float32) for name, array in arrays.items()}


def test_unfilled(backend):
    rng = np.random.default_rng(12)
    shape = (17, 45)
    disparity = rng.normal(9, 3, shape).astype(np.float32)
    disparity[rng.random(shape) < 0.1] = np.nan
    validity = rng.choice(np.array([0, 8, 32, 40], np.uint8), shape)
    taken = (rng.random(shape) < 0.3).astype(np.uint8)
    out = backend.upload(np.full(shape, 77, np.float32))
    given = {"disparity": disparity, "validity": validity, "taken": taken}
    held = {name: backend.upload(array) for name, array in given.items()}
    backend.launch("unfilled", **held, width=45, height=17, disparity_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.unfilled(**given))


@pytest.mark.parametrize("radius", [0, 2, 8])
def test_agreement(backend, radius):
    arrays = checked_map((23, 41))
    (got,) = launch_agreement(backend, arrays, radius)
    want = reference.agreement(**arrays, radius=radius)
    np.testing.assert_array_equal(got, want.astype(np.float32))
    assert 0 < want.mean() < 0.5


@pytest.mark.parametrize("radius", [0, 2, 5])
def test_majority(backend, radius):
    arrays = wishes((23, 41))
    got = launch_majority(backend, arrays, radius)
    want = reference.majority(**arrays, radius=radius)
    np.testing.assert_array_equal(got[0], want[0])
    np.testing.assert_array_equal(got[1], want[1])
    assert 0.1 < want[1].mean() < 0.9


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("pitch", [8, 5])
def test_flat(backend, pitch, direction):
    arrays, numbers = scene((29, 83), pitch, direction), {**NUMBERS, "pitch": pitch, "direction": direction}
    got = launch_flat(backend, arrays, **numbers)
    want = reference.flat(**arrays, **numbers)
    for found, expected in zip(got[:3], want[:3], strict=True):
        np.testing.assert_allclose(found, expected, atol=PLANE_TOLERANCE)
    assert (got[3] != want[3]).mean() <= SHARE_OF_FLIPS
    assert 0.05 < want[3].mean() < 0.5 and 0.02 < np.isnan(want[0]).mean() < 0.5


def test_a_plane_that_explains_less_is_not_wanted(backend):
    """Where there is texture, the pictures decide; where there is none, or it is out of sight, the plane does."""
    shape, rng = (32, 64), np.random.default_rng(6)
    other = rng.normal(0, 30, shape)
    other[:, :32] = 10  # no texture
    view = np.roll(other, -4, axis=1)
    planes = np.zeros((4, 4, 8))
    planes[0], planes[3] = 7, 1
    disparity = np.full(shape, 4.0)
    arrays = {"reference": view, "other": other, "planes": planes, "disparity": disparity}
    arrays = {name: array.astype(np.float32) for name, array in arrays.items()}
    arrays["agreement"] = np.zeros(shape, np.float32)
    plane, _, _, wanted = launch_flat(backend, arrays, **NUMBERS, pitch=8)
    np.testing.assert_allclose(plane, 7, atol=PLANE_TOLERANCE)
    assert wanted[:, :20].all() and not wanted[:, 33:50].any()
    arrays["disparity"][:] = np.nan
    *_, wanted = launch_flat(backend, arrays, **NUMBERS, pitch=8)
    assert wanted[:, :20].all() and not wanted[:, 33:50].any() and wanted[:, 57:].all()
    arrays["agreement"][:, :10] = 0.6
    *_, wanted = launch_flat(backend, arrays, **NUMBERS, pitch=8)
    assert not wanted[:, :10].any() and wanted[:, 10:20].all()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [0, 2, 8, 40])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_both_forms_count(name, radius, shape):
    for launch, arrays in ((launch_agreement, checked_map(shape)), (launch_majority, wishes(shape))):
        forms = [launch(opened(name, form), arrays, radius) for form in ("gpu", "cpu")]
        for gpu, cpu in zip(*forms, strict=True):
            np.testing.assert_array_equal(gpu, cpu)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("pitch", [1, 3, 8, 40])
@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_both_forms_flat(name, direction, pitch, shape):
    numbers = {**NUMBERS, "pitch": pitch, "direction": direction, "least_agreement": 0.9}
    arrays = scene(shape, pitch, direction)
    forms = [launch_flat(opened(name, form), arrays, **numbers) for form in ("gpu", "cpu")]
    for gpu, cpu in zip(*forms, strict=True):
        np.testing.assert_array_equal(gpu, cpu)


def test_languages_agree():
    arrays = scene((31, 90), 8, 1)
    first, second = (launch_flat(opened(name, "gpu"), arrays, **NUMBERS, pitch=8) for name in ("opencl", "warp:cpu"))
    for ours, theirs in zip(first, second, strict=True):
        np.testing.assert_array_equal(ours, theirs)
