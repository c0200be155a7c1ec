"""Census, semi-global aggregation, and leaning windows against the loops in reference.py, on every device."""

import cv2
import numpy as np
import pytest
import reference

WIDTH, HEIGHT = 43, 29
EIGHT = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)]
# Plane fits and leaning windows are sums of up to 81 products in single precision.
SLANT_TOLERANCE = 2e-3
# A pixel of the surroundings may be taken in or left out by rounding, and a peak may change sides.
SHARE_OF_FLIPS = 0.01


def junk(backend, shape, dtype):
    return backend.upload(np.full(shape, 77, dtype))


def picture(seed):
    noise = np.random.default_rng(seed).normal(0, 60, (HEIGHT, WIDTH))
    return np.round(np.clip(cv2.GaussianBlur(noise, (0, 0), 1.0) * 3, -128, 127)).astype(np.float32)


@pytest.mark.parametrize("row_slope", [0, 1])
@pytest.mark.parametrize("step", EIGHT)
def test_aggregate(backend, step, row_slope):
    rng = np.random.default_rng(3)
    cost = rng.integers(0, 63, (HEIGHT, WIDTH, 11)).astype(np.uint8)
    cost[rng.random(cost.shape) < 0.05] = reference.UNSEEN
    cost[4:9, 6:12] = reference.NO_MATCH
    source = picture(4)
    start = rng.integers(0, 50, cost.shape).astype(np.float32)
    volume = backend.upload(start)
    backend.launch(
        "aggregate",
        cost=backend.upload(cost),
        picture=backend.upload(source),
        width=WIDTH,
        height=HEIGHT,
        disparities=11,
        step_x=step[0],
        step_y=step[1],
        row_slope=row_slope,
        small_penalty=9.0,
        large_penalty=40.0,
        edge_penalty=20.0,
        edge=25.0,
        weight=0.25,
        volume_out=volume,
    )
    want = start + 0.25 * reference.aggregate(cost, source, *step, row_slope, 9.0, 40.0, 20.0, 25.0)
    np.testing.assert_array_equal(backend.download(volume), want)


@pytest.mark.parametrize("direction", [1, -1])
def test_slant(backend, direction):
    source = picture(5)
    x, y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    truth = 3 + 0.4 * y + 0.1 * x
    truth[:, 28:] += 6
    other = cv2.remap(source, x - direction * truth, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    disparity = truth + np.random.default_rng(6).uniform(-0.4, 0.4, truth.shape).astype(np.float32)
    disparity[10:13, 5:9] = np.nan
    outputs = [junk(backend, truth.shape, np.float32) for _ in range(2)]
    backend.launch(
        "slant",
        reference=backend.upload(source),
        other=backend.upload(other),
        disparity=backend.upload(disparity),
        width=WIDTH,
        height=HEIGHT,
        radius=3,
        direction=direction,
        step=0.5,
        largest_slope=1.5,
        disparity_out=outputs[0],
        score_out=outputs[1],
    )
    values, scores = (backend.download(a) for a in outputs)
    want, want_scores = reference.slant(source, other, disparity.astype(float), 3, direction, 0.5, 1.5)
    np.testing.assert_array_equal(np.isnan(values), np.isnan(want))
    given = np.isfinite(want)
    assert (np.abs(values - want)[given] > SLANT_TOLERANCE).mean() <= SHARE_OF_FLIPS
    assert (np.abs(scores - want_scores) > SLANT_TOLERANCE).mean() <= SHARE_OF_FLIPS
    assert (want_scores[given] > 0.7).any()
