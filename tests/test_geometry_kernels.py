"""Rectify and triangulate against the loops in reference.py, on every device."""

import cv2
import numpy as np
import pytest
import reference

WIDTH, HEIGHT = 41, 29
# Single precision places a sample to about 1e-4 px, which moves a colour by less than a level but may round it over.
SHARE_OFF_BY_ONE = 0.02

MATRIX = np.array([[45.0, 0, 21.3], [0, 44.0, 13.8], [0, 0, 1]])
LENSES = {
    5: [-0.25, 0.08, 0.002, -0.001, -0.01],
    8: [0.3, -0.1, 0.002, -0.001, 0.05, 0.5, -0.1, 0.04],
    12: [0.3, -0.1, 0.002, -0.001, 0.05, 0.5, -0.1, 0.04, 0.01, -0.005, 0.004, 0.002],
}


def junk(backend, shape, dtype):
    return backend.upload(np.full(shape, 77, dtype))


def picture(dtype, channels):
    small = np.random.default_rng(2).integers(0, np.iinfo(dtype).max + 1, (8, 11, channels)).astype(np.float64)
    return np.ascontiguousarray(cv2.resize(small, (WIDTH, HEIGHT)).reshape(HEIGHT, WIDTH, channels).astype(dtype))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("coefficients", [5, 8, 12])
def test_rectify(backend, dtype, channels, coefficients):
    raw = picture(dtype, channels)
    rotation = cv2.Rodrigues(np.array([0.03, -0.05, 0.02]))[0]
    new = np.array([[40.0, 0, 24.0], [0, 40.0, 15.0], [0, 0, 1]])
    ray = rotation.T @ np.linalg.inv(new)
    width, height = 47, 31
    distortion = LENSES[coefficients]
    k = np.array([*distortion, *[0.0] * (12 - coefficients)])
    lens = np.array([MATRIX[0, 0], MATRIX[1, 1], MATRIX[0, 2], MATRIX[1, 2], *k], np.float32)
    rectified_out = junk(backend, (height, width, channels), dtype)
    valid_out = junk(backend, (height, width), np.uint8)
    backend.launch(
        "rectify",
        picture=backend.upload(raw),
        lens=backend.upload(lens),
        ray=backend.upload(ray.astype(np.float32)),
        source_width=WIDTH,
        source_height=HEIGHT,
        channels=channels,
        width=width,
        height=height,
        rectified_out=rectified_out,
        valid_out=valid_out,
    )
    want, want_valid = reference.rectify(raw, MATRIX, distortion, ray, (width, height))
    got, valid = backend.download(rectified_out), backend.download(valid_out)
    assert (valid != want_valid).mean() < 0.002
    assert 0.3 < want_valid.mean() < 1
    both = (valid == 1) & (want_valid == 1)
    difference = np.abs(got.astype(int) - want.astype(int))[both]
    unit = 1 if dtype == np.uint8 else 16  # 1e-4 px on a slope of a 16-bit picture
    assert (difference > unit - 1).mean() < SHARE_OFF_BY_ONE
    assert difference.max() <= unit
    assert (got[valid == 0] == 0).all()
    # The loops themselves against OpenCV, so that a misread lens model cannot hide in both.
    maps = cv2.initUndistortRectifyMap(MATRIX, np.array(distortion), rotation, new, (width, height), cv2.CV_32FC1)
    sampled = cv2.remap(raw.astype(np.float32), *maps, cv2.INTER_LINEAR).reshape(want.shape)
    assert np.median(np.abs(sampled - want)[want_valid == 1]) <= np.iinfo(dtype).max / 255


@pytest.mark.parametrize("direction", [1, -1])
def test_triangulate(backend, direction):
    disparity = np.random.default_rng(4).uniform(-5, 30, (HEIGHT, WIDTH)).astype(np.float32)
    disparity[3:6, 7:9] = np.nan
    out = junk(backend, (HEIGHT, WIDTH, 3), np.float32)
    numbers = {"focal_px": 612.5, "baseline": 99.8, "cx_left": 20.25, "cx_right": 17.5, "cy": 14.125}
    held = backend.upload(disparity)
    backend.launch(
        "triangulate",
        disparity=held,
        width=WIDTH,
        height=HEIGHT,
        direction=direction,
        **numbers,
        points_out=out,
    )
    want = reference.triangulate(disparity.astype(float), direction, **numbers)
    assert np.isnan(want).any()
    np.testing.assert_allclose(backend.download(out), want, rtol=1e-5, atol=1e-3)
