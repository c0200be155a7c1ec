"""Aggregation and its winners against the loops in reference.py, on every device."""

import numpy as np
import pytest
import reference


def junk(backend, shape, dtype):
    return backend.upload(np.full(shape, 77, dtype))


def paths_case(shape, seed):
    """Costs with gaps, a guide with edges, and sums to begin with."""
    rng = np.random.default_rng(seed)
    cost = rng.integers(0, 147, shape).astype(np.uint8)
    cost[rng.random(shape) < 0.05] = reference.NO_MATCH
    cost[shape[0] // 3 : shape[0] // 2, : shape[1] // 2] = reference.NO_MATCH
    guide = np.full((3, *shape[:2]), 100) + rng.integers(0, 9, (3, *shape[:2]))
    guide += 15 * (rng.random(guide.shape) < 0.1)
    return cost, guide.astype(np.uint8), rng.integers(0, 60_001, shape).astype(np.uint16)


PENALTIES = {"small_penalty": 17, "large_penalty": 40, "edge_small_penalty": 5, "edge_large_penalty": 12, "edge": 15}


def aggregated(backend, cost, guide, sums, heading, row_slope):
    out = backend.upload(sums)
    backend.launch(
        "aggregate",
        cost=backend.upload(cost),
        guide=backend.upload(guide),
        width=cost.shape[1],
        height=cost.shape[0],
        disparities=cost.shape[2],
        heading=heading,
        row_slope=row_slope,
        **PENALTIES,
        sums_out=out,
    )
    return backend.download(out)


# A pixel, narrower than a band is high, several bands; less than a vector, a vector and one, more than a group holds.
@pytest.mark.parametrize("row_slope", [0, 1, -1])
@pytest.mark.parametrize("heading", [0, 1, -1])
@pytest.mark.parametrize("shape", [(1, 1, 5), (1, 30, 33), (29, 43, 11), (70, 3, 33), (40, 2, 1), (6, 5, 300)])
def test_aggregate(backend, heading, row_slope, shape):
    cost, guide, sums = paths_case(shape, sum(shape))
    want = reference.aggregate(cost, guide, heading, row_slope, (17, 40), (5, 12), 15, sums)
    np.testing.assert_array_equal(aggregated(backend, cost, guide, sums, heading, row_slope), want)


def test_a_slope_costs_nothing_where_the_paths_lean_with_it(backend):
    """Of a plane whose disparity grows by one a row, paths with that slope find the true disparity for nothing."""
    y, _, i = np.meshgrid(np.arange(20), np.arange(15), np.arange(30), indexing="ij")
    cost = np.where(i == y + 4, 0, 146).astype(np.uint8)
    guide = np.full((3, 20, 15), 7, np.uint8)
    for row_slope, costs in ((1, False), (0, True)):
        sums = np.zeros(cost.shape, np.uint16)
        for heading in (1, -1):
            sums = aggregated(backend, cost, guide, sums, heading, row_slope)
        assert (sums[cost == 0] > 0).any() == costs


def launch_lowest(backend, sums, validity, smallest, subpixel):
    shape = validity.shape
    out = {name: junk(backend, shape, np.float32) for name in ("disparity_out", "lowest_out", "ratio_out")}
    out["validity_out"] = junk(backend, shape, np.uint8)
    backend.launch(
        "lowest",
        sums=backend.upload(sums),
        validity=backend.upload(validity),
        width=shape[1],
        height=shape[0],
        smallest=smallest,
        disparities=sums.shape[2],
        subpixel=subpixel,
        **out,
    )
    return [backend.download(array) for array in out.values()]


def sums_case(shape, seed):
    """Few levels, so that equal sums are common, gaps in them, and a corner without any."""
    rng = np.random.default_rng(seed)
    sums = rng.integers(0, 40, shape).astype(np.uint16)
    sums[rng.random(shape) < 0.3] = 60_500
    sums[shape[0] // 2 :, : shape[1] // 3] = reference.UNMATCHED
    return sums, np.where(rng.random(shape[:2]) < 0.1, reference.MASKED, 0).astype(np.uint8)


@pytest.mark.parametrize("subpixel", [0, 1])
@pytest.mark.parametrize("shape", [(1, 1, 1), (13, 70, 2), (9, 31, 5), (5, 66, 33), (3, 20, 64), (4, 7, 300)])
def test_lowest(backend, shape, subpixel):
    sums, validity = sums_case(shape, sum(shape))
    for got, want in zip(
        launch_lowest(backend, sums, validity, -3, subpixel),
        reference.lowest(sums, validity, -3, subpixel),
        strict=True,
    ):
        np.testing.assert_array_equal(got, want)
