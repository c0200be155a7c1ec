"""Which triangles must be split: the kernel against the loops in reference.py, on every device."""

import numpy as np
import pytest
import reference

SHAPES = [(1, 1), (1, 9), (2, 2), (9, 9), (13, 22), (17, 16)]


def hills(shape, seed=3):
    """Whole 64ths of a pixel, so that no error lies within rounding of the bound; with jumps and holes."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape)
    values = 20 + x / 8 - y / 4 + np.round(rng.uniform(-0.2, 0.2, shape) * 64) / 64
    values[(x > 9) & (y > 5)] += 7.25
    values[rng.random(shape) < 0.04] = np.nan
    return values.astype(np.float32)


def launch(backend, values, corners, split, **numbers):
    out = backend.upload(split)
    backend.launch(
        "split_triangles",
        disparity=backend.upload(values),
        corners=backend.upload(corners),
        width=values.shape[1],
        height=values.shape[0],
        split_out=out,
        **numbers,
    )
    return backend.download(out)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("error_px", [0.15, 0.4])
def test_split_triangles(backend, shape, error_px):
    values = hills(shape)
    corners = np.float32(1.0625) * values - np.float32(1.25)
    # What the kernel may not touch is junk; whatever else is in split is overwritten, level by level.
    split = np.full(shape, 7, np.uint8)
    for side in (2, 4, 8, 16):
        for diagonal in (0, 1):
            numbers = {"side": side, "diagonal": diagonal, "error_px": error_px, "max_jump_px": 3.0}
            want = reference.split_triangles(values, corners, split=split, **numbers)
            split = launch(backend, values, corners, split, **numbers)
            np.testing.assert_array_equal(split, want, err_msg=f"{side} {diagonal}")
    y, x = np.indices(shape)
    assert (split[(y % 16 == 0) & (x % 16 == 0)] == 7).all()
    assert set(np.unique(split[(y % 16 != 0) | (x % 16 != 0)])) <= {0, 1}


def test_a_plane_is_not_split(backend):
    y, x = np.indices((17, 33))
    values = (30 + x / 4 - y / 8).astype(np.float32)
    for side in (2, 4, 8, 16):
        split = np.zeros(values.shape, np.uint8)
        for diagonal in (0, 1):
            numbers = {"side": side, "diagonal": diagonal, "error_px": 1e-3, "max_jump_px": 3.0}
            split = launch(backend, values, values, split, **numbers)
        assert not split.any()
    # One value off the plane splits every triangle that holds it.
    off = values.copy()
    off[5, 9] += 0.25
    split = launch(backend, off, values, split, side=2, diagonal=0, error_px=0.1, max_jump_px=3.0)
    assert split[5, 8:11:2].all() and split[4:7:2, 9].all() and split.sum() == 4
