"""The benchmark: its lines, and that what it times gives the right answer."""

import re

import numpy as np
import pytest

from stereo_gpu import bench
from stereo_gpu.errors import BackendError, InputError
from stereo_gpu.match import match

SLOPED_PX = 0.2  # median error of upright windows on rows that differ by 0.24 px each
LINE = re.compile(r"(.+?) +([\d.]+) ms +([\d.]+) GDE/s +([\d.]+) x StereoBM")


def test_every_line_is_a_measurement(monkeypatch):
    monkeypatch.setattr(bench, "WARM_UP_SECONDS", 0.01)
    monkeypatch.setattr(bench, "REPEATS", 3)
    width, height, disparities = 128, 96, 16
    head, *lines = bench.run_bench(width, height, disparities, window=7)
    assert head.startswith("128 x 96 x 16, window 7, ")
    found = {}
    for line in lines:
        name, milliseconds, speed, ratio = LINE.fullmatch(line).groups()
        found[name] = float(milliseconds), float(speed), float(ratio)
    assert {"cv2.StereoBM", "kernel ncc_wta", "sg.match paper", "sg.match fast", "sg.match precise"} <= set(found)
    assert found["cv2.StereoBM"][2] == 1.0
    for milliseconds, speed, _ in found.values():
        # Both are rounded, to 0.1 ms and 0.01 GDE/s.
        evaluations = width * height * disparities / 1e6
        assert (milliseconds - 0.06) * (speed - 0.006) <= evaluations <= (milliseconds + 0.06) * (speed + 0.006)


def test_the_pair_has_the_slope_that_it_says():
    left, right = bench._pair(160, 96, 32)
    values = match(left, right, disparities=(0, 32), window=7, profile="fast").values
    expected = np.broadcast_to(np.linspace(0.1, 0.8, 96, dtype=np.float32)[:, None] * 32, values.shape)
    inner = np.s_[8:-8, 8:120]
    assert np.isfinite(values[inner]).mean() > 0.95
    assert np.nanmedian(np.abs(values[inner] - expected[inner])) < SLOPED_PX


@pytest.mark.parametrize(
    ("size", "window", "says"),
    [
        ((128, 96, 15), 7, "15 disparities"),
        ((128, 96, 0), 7, "0 disparities"),
        ((128, 96, 16), 4, "window 4"),
        ((128, 96, 16), 33, "window 33"),
        ((16, 96, 16), 7, "size 16 x 96"),
        ((128, -1, 16), 7, "size 128 x -1"),
        ((10**9, 96, 16), 7, "at most"),
    ],
)
def test_wrong_sizes(size, window, says):
    with pytest.raises(InputError, match=says):
        next(bench.run_bench(*size, window=window))


def test_unknown_backend():
    with pytest.raises(BackendError, match="abacus"):
        next(bench.run_bench(128, 96, 16, backend="abacus"))
