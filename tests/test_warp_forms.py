"""Warp's forms for CPUs against those for GPUs, which run on the CPU too: the same bits at shapes that are awkward."""

import numpy as np
import pytest
from test_smooth_path_kernels import PENALTIES, paths_case, sums_case

from stereo_gpu.backends.warp import WarpBackend

# A pixel, less than a vector, a vector and one, more than a block, either way.
SHAPES = [(1, 1), (5, 3), (3, 17), (2, 300), (40, 529), (131, 16)]


def forms():
    return WarpBackend("cpu", "cpu", threads=2), WarpBackend("cpu", "gpu", threads=1)


def same(kernel, shape, outputs, arrays, **numbers):
    """Launch both forms with junk in the outputs (name: array of its shape and type) and compare every bit."""
    answers = []
    for backend in forms():
        held = {name: backend.upload(array) for name, array in outputs.items()}
        given = {name: backend.upload(array) for name, array in arrays.items()}
        backend.launch(kernel, **given, width=shape[1], height=shape[0], **numbers, **held)
        answers.append([backend.download(array) for array in held.values()])
    for got, want in zip(*answers, strict=True):
        np.testing.assert_array_equal(got, want)


def junk(shape, dtype=np.float32):
    return np.full(shape, 77, dtype)


def values(shape, seed=0):
    rng = np.random.default_rng(seed)
    found = rng.uniform(-4, 30, shape).astype(np.float32)
    found[rng.random(shape) < 0.6] = 9.5
    found[rng.random(shape) < 0.25] = np.nan
    return found


def picture(shape, seed=0):
    return np.random.default_rng(seed).integers(-128, 128, shape).astype(np.float32)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_grey_and_rectify(shape, dtype, channels):
    raw = np.random.default_rng(1).integers(0, np.iinfo(dtype).max + 1, (*shape, channels)).astype(dtype)
    same("grey", shape, {"grey_out": junk(shape)}, {"picture": raw}, channels=channels, black=9.5, scale=0.7)
    source_height, source_width = shape
    lens = [
        0.9 * source_width,
        0.8 * source_width,
        source_width / 2,
        source_height / 2,
        -0.2,
        0.05,
        0.002,
        -0.001,
        0.01,
    ]
    lens = np.array([*lens, 0.1, 0.02, 0, 0.001, 0, 0.002, 0], np.float32)
    ray = np.array([1.2 / source_width, 0.001, -0.6, 0.002, 1.2 / source_width, -0.55, 0.0001, 0, 1], np.float32)
    size = {"source_width": source_width, "source_height": source_height, "channels": channels}
    outputs = {"rectified_out": junk(raw.shape, dtype), "valid_out": junk(shape, np.uint8)}
    same("rectify", shape, outputs, {"picture": raw, "lens": lens, "ray": ray}, **size)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("axis", [0, 1])
def test_smooth(shape, axis):
    weights = np.array([0.02, 0.08, 0.2, 0.4, 0.2, 0.08, 0.02], np.float32)
    arrays = {"source": picture(shape), "weights": weights}
    same("smooth", shape, {"smoothed_out": junk(shape)}, arrays, radius=3, axis=axis)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("radius", [1, 5, 15])
def test_window_norms(shape, radius):
    outputs = {"sum_out": junk(shape), "inverse_out": junk(shape), "validity_out": junk(shape, np.uint8)}
    mask = (np.random.default_rng(2).random(shape) < 0.9).astype(np.uint8)
    same("window_norms", shape, outputs, {"picture": picture(shape), "mask": mask}, radius=radius, threshold=700.0)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [3, 5, 7])
def test_median(shape, size):
    given = values(shape)
    given[given > 29] = -given[given > 29]
    if given.size > 20:
        given.flat[:2] = np.float32(np.nan), -np.float32(np.nan)
    same("median", shape, {"disparity_out": junk(shape)}, {"disparity": given}, size=size)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("reach", "step", "slope"), [(7, 3, 0.0), (20, 1, 0.25), (300, 100, 0.5)])
def test_support(shape, reach, step, slope):
    outputs = {"disparity_out": junk(shape), "validity_out": junk(shape, np.uint8)}
    arrays = {"disparity": values(shape), "validity": np.isnan(values(shape)).astype(np.uint8)}
    numbers = {"reach": reach, "step": step, "tolerance": 1.0, "slope": slope, "share": 0.3}
    same("support", shape, outputs, arrays, **numbers)


@pytest.mark.parametrize("shape", [*SHAPES, (2, 5003)])
@pytest.mark.parametrize(("smallest", "disparities", "direction"), [(0, 30, 1), (-4, 35, -1), (-4, 200, 1)])
def test_consistency(shape, smallest, disparities, direction):
    bits = max(7, (disparities - 1).bit_length())
    index = np.random.default_rng(4).integers(-9, disparities, shape)
    key = np.where(index >= 0, (3 << bits) + (1 << bits) - 1 - index, 0).astype(np.int32)
    given = values(shape)
    outputs = {"disparity_out": junk(shape), "validity_out": junk(shape, np.uint8)}
    arrays = {"disparity": given, "other": key, "validity": np.isnan(given).astype(np.uint8)}
    numbers = {"smallest": smallest, "disparities": disparities, "direction": direction, "tolerance": 6.0}
    same("consistency", shape, outputs, arrays, **numbers)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    ("smallest", "disparities", "direction"), [(0, 1, 1), (-20, 37, -1), (3, 300, 1), (-99, 530, -1)]
)
def test_match_cost(shape, smallest, disparities, direction):
    rng = np.random.default_rng(8)
    bits = rng.integers(0, 1 << 24, (2, *shape)).astype(np.int32)
    guide = rng.integers(90, 140, (2, 3, *shape)).astype(np.uint8)
    validity = np.where(rng.random((2, *shape)) < 0.1, 16, 0).astype(np.uint8)
    arrays = {
        "reference_bits": bits[0],
        "other_bits": bits[1],
        "reference_guide": guide[0],
        "other_guide": guide[1],
        "reference_validity": validity[0],
        "other_validity": validity[1],
    }
    search = {"smallest": smallest, "disparities": disparities, "direction": direction}
    same("match_cost", shape, {"cost_out": junk((*shape, disparities), np.uint8)}, arrays, **search)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("direction", [1, -1])
def test_triangulate(shape, direction):
    numbers = {"focal_px": 612.5, "baseline": 99.8, "cx_left": 20.25, "cx_right": 17.5, "cy": 14.125}
    arrays = {"disparity": values(shape)}
    same("triangulate", shape, {"points_out": junk((*shape, 3))}, arrays, direction=direction, **numbers)


@pytest.mark.parametrize("disparities", [1, 15, 32, 50, 600])
@pytest.mark.parametrize("heading", [0, 1, -1])
@pytest.mark.parametrize("row_slope", [0, 1, -3])
def test_aggregate(disparities, heading, row_slope):
    shape = (11, 19)
    cost, guide, sums = paths_case((*shape, disparities), 5)
    numbers = {"disparities": disparities, "heading": heading, "row_slope": row_slope, **PENALTIES}
    same("aggregate", shape, {"sums_out": sums}, {"cost": cost, "guide": guide}, **numbers)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("disparities", [1, 15, 32, 300])
def test_lowest(shape, disparities):
    sums, validity = sums_case((*shape, disparities), 6)
    outputs = dict.fromkeys(("disparity_out", "lowest_out", "ratio_out"), junk(shape))
    outputs["validity_out"] = junk(shape, np.uint8)
    numbers = {"disparities": disparities, "smallest": -4, "subpixel": 1}
    same("lowest", shape, outputs, {"sums": sums, "validity": validity}, **numbers)
