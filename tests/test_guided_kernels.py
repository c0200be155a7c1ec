"""Support and planes of what looks alike, against the loops in reference.py on every device, and both forms' bits."""

import numpy as np
import pytest
import reference
from test_gpu_forms import opened

# Planes are sums of up to 81 products in single precision, px.
PLANE_TOLERANCE = 1e-4
# A neighbour at the very edge of the tolerance hardly weighs; a slope may still be just above or below the largest.
SHARE_OF_FLIPS = 0.002
SUPPORT = {"reach": 8, "step": 2, "tolerance": 1.0, "slope": 0.3, "share": 0.4}
PLANE = {"reach": 6, "step": 2, "tolerance": 0.5, "slope": 0.3, "largest_slope": 1.5}
# A pixel, less than a vector, one and a bit, more than what is taken at a time.
SHAPES = [(1, 1), (2, 3), (5, 17), (31, 47), (9, 150), (37, 70)]
# The last ones reach too far or hold too many neighbours for the lines of the forms for CPUs.
GRIDS = [(8, 2), (6, 2), (4, 1), (7, 3), (1, 2), (16, 4), (40, 10), (5, 1)]


def scene(shape):
    """A leaning surface and one before it that looks different, with noise, outliers, holes and masked pixels."""
    height, width = shape
    rng = np.random.default_rng(11)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    near = x > 0.6 * width
    values = (5 + 0.1 * x + 0.3 * y + 7 * near + rng.normal(0, 0.2, shape)).astype(np.float32)
    outliers = rng.random(shape) < 0.1
    values[outliers] += rng.uniform(2, 9, np.count_nonzero(outliers)).astype(np.float32)
    values[rng.random(shape) < 0.1] = np.nan
    values[: height // 3, : width // 4] = np.nan
    validity = np.where(np.isnan(values), reference.OCCLUDED, 0).astype(np.uint8)
    masked = rng.random(shape) < 0.05
    validity[masked] = reference.MASKED  # some of which have a value that must not count
    guide = rng.normal(100, 6, (3, *shape)) + 60 * near + 25 * (y > height / 2)
    return values, validity, np.clip(guide, 0, 255).astype(np.uint8)


def launched(backend, kernel, arrays, **numbers):
    values, validity, guide = arrays
    out = {"disparity_out": backend.upload(np.full_like(values, 77))}
    if kernel == "guided_support":
        out["validity_out"] = backend.upload(np.full_like(validity, 77))
    held = {"disparity": values, "validity": validity, "guide": guide}
    held = {name: backend.upload(array) for name, array in held.items()}
    backend.launch(kernel, **held, width=values.shape[1], height=values.shape[0], **numbers, **out)
    return [backend.download(array) for array in out.values()]


@pytest.mark.parametrize("grid", [(8, 2), (7, 3), (20, 4)])
def test_guided_support(backend, grid):
    arrays, numbers = scene((29, 43)), {**SUPPORT, "reach": grid[0], "step": grid[1]}
    got = launched(backend, "guided_support", arrays, **numbers)
    want = reference.guided_support(*arrays, **numbers)
    np.testing.assert_array_equal(got[0], want[0])
    np.testing.assert_array_equal(got[1], want[1])
    taken = np.isnan(want[0]) & np.isfinite(arrays[0])
    assert 0.02 < taken.mean() < 0.3
    assert not (taken & (arrays[1] == reference.MASKED)).any()


@pytest.mark.parametrize("grid", [(6, 2), (7, 3), (20, 4)])
def test_plane_fit(backend, grid):
    arrays, numbers = scene((29, 43)), {**PLANE, "reach": grid[0], "step": grid[1]}
    (got,) = launched(backend, "plane_fit", arrays, **numbers)
    want = reference.plane_fit(*arrays, **numbers)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(want))
    given = np.isfinite(want)
    assert (np.abs(got - want)[given] > PLANE_TOLERANCE).mean() <= SHARE_OF_FLIPS
    assert (want != arrays[0])[given].mean() > 0.5


def test_a_leaning_surface_is_kept(backend):
    x, y = np.meshgrid(np.arange(60, dtype=np.float32), np.arange(40, dtype=np.float32))
    plain = 4 + 0.25 * x + 0.125 * y
    arrays = plain, np.zeros(plain.shape, np.uint8), np.full((3, *plain.shape), 90, np.uint8)
    (got,) = launched(backend, "plane_fit", arrays, **PLANE)
    # The slopes are drawn towards 0, which shows where neighbours lie to one side.
    np.testing.assert_allclose(got[6:-6, 6:-6], plain[6:-6, 6:-6], atol=PLANE_TOLERANCE)
    np.testing.assert_array_equal(launched(backend, "guided_support", arrays, **SUPPORT)[0], plain)


def test_only_what_looks_alike_counts(backend):
    shape = (24, 40)
    stripes = (np.arange(shape[1]) // 4 % 2).astype(bool) & np.ones(shape, bool)
    values = np.where(stripes, 9.3, 9.0).astype(np.float32)
    guide = np.where(stripes, 200, 100).astype(np.uint8)[None].repeat(3, axis=0)
    (got,) = launched(backend, "plane_fit", (values, np.zeros(shape, np.uint8), guide), **PLANE)
    np.testing.assert_allclose(got, values, atol=PLANE_TOLERANCE)
    (mixed,) = launched(backend, "plane_fit", (values, np.zeros(shape, np.uint8), np.zeros_like(guide)), **PLANE)
    assert np.abs(mixed - values)[:, 6:-6].min() > 0.05


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize(("kernel", "numbers"), [("guided_support", SUPPORT), ("plane_fit", PLANE)])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_both_forms(name, kernel, numbers, grid, shape):
    numbers = {**numbers, "reach": grid[0], "step": grid[1]}
    forms = [launched(opened(name, form), kernel, scene(shape), **numbers) for form in ("gpu", "cpu")]
    for gpu, cpu in zip(*forms, strict=True):
        np.testing.assert_array_equal(gpu, cpu)
