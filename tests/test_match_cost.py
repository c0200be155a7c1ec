"""Census, guide and cost of a match against the loops in reference.py, on every device."""

import numpy as np
import pytest
import reference

from stereo_gpu.prepare import colour_levels, make_guide

WIDTH, HEIGHT = 43, 29


def junk(backend, shape, dtype):
    return backend.upload(np.full(shape, 77, dtype))


def test_census(backend):
    source = np.random.default_rng(1).integers(-6, 6, (HEIGHT, WIDTH)).astype(np.float32)
    out = junk(backend, (HEIGHT, WIDTH), np.int32)
    backend.launch("census", picture=backend.upload(source), width=WIDTH, height=HEIGHT, bits_out=out)
    np.testing.assert_array_equal(backend.download(out), reference.census(source))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (HEIGHT, WIDTH, 3)])
def test_guide(backend, dtype, shape):
    most = np.iinfo(dtype).max
    source = np.random.default_rng(2).integers(0, most + 1, shape).astype(dtype)
    # Levels in whole numbers and halves are exact, and so is how they are rounded.
    levels = np.array([1.5, -60.5, -1.0, 250.0, 0.0, 128.0], np.float32)
    want = reference.guide(source, levels)
    np.testing.assert_array_equal(backend.download(make_guide(backend, backend.upload(source), levels)), want)
    assert {0, 128, 255} <= set(np.unique(want))


@pytest.mark.parametrize(("smallest", "disparities", "direction"), [(0, 9, 1), (-3, 12, -1), (2, 70, 1), (-8, 33, -1)])
def test_match_cost(backend, smallest, disparities, direction):
    rng = np.random.default_rng(3)
    bits = rng.integers(0, 1 << 24, (2, HEIGHT, WIDTH)).astype(np.int32)
    bits[:, :, : WIDTH // 2] &= 63  # few of whose bits can differ
    guide = rng.integers(0, 256, (2, 3, HEIGHT, WIDTH)).astype(np.uint8)
    guide[:, :, : HEIGHT // 2] = guide[:, :, : HEIGHT // 2] // 8 + 100
    validity = np.where(rng.random((2, HEIGHT, WIDTH)) < 0.1, 16, 2).astype(np.uint8)
    out = junk(backend, (HEIGHT, WIDTH, disparities), np.uint8)
    backend.launch(
        "match_cost",
        reference_bits=backend.upload(bits[0]),
        other_bits=backend.upload(bits[1]),
        reference_guide=backend.upload(guide[0]),
        other_guide=backend.upload(guide[1]),
        reference_validity=backend.upload(validity[0]),
        other_validity=backend.upload(validity[1]),
        width=WIDTH,
        height=HEIGHT,
        smallest=smallest,
        disparities=disparities,
        direction=direction,
        cost_out=out,
    )
    want = reference.match_cost(*bits, *guide, *validity, smallest, disparities, direction)
    np.testing.assert_array_equal(backend.download(out), want)
    assert {reference.UNSEEN, reference.NO_MATCH} <= set(np.unique(want))
    assert len(np.unique(want)) > 80 and want[want != reference.NO_MATCH].max() <= 146


@pytest.mark.parametrize("bits", range(25))
def test_each_number_of_bits_and_each_difference_of_colours(backend, bits):
    """Each pixel of a row differs by one level more than the one before; the bits by as many as are asked for."""
    width = 60
    guide = np.zeros((2, 3, 1, width), np.uint8)
    guide[1] = (np.arange(width) + np.arange(3)[:, None, None]) // 3
    out = junk(backend, (1, width, 1), np.uint8)
    valid = backend.upload(np.zeros((1, width), np.uint8))
    backend.launch(
        "match_cost",
        reference_bits=backend.upload(np.full((1, width), 0, np.int32)),
        other_bits=backend.upload(np.full((1, width), (1 << bits) - 1, np.int32)),
        reference_guide=backend.upload(guide[0]),
        other_guide=backend.upload(guide[1]),
        reference_validity=valid,
        other_validity=valid,
        width=width,
        height=1,
        smallest=0,
        disparities=1,
        direction=1,
        cost_out=out,
    )
    apart = np.minimum(np.arange(width), 48)
    want = (bits * (48 - bits) * 45 >> 8) + (apart * (96 - apart) * 5 >> 8)
    np.testing.assert_array_equal(backend.download(out)[0, :, 0], want)


@pytest.mark.parametrize("channels", [1, 3])
def test_gain_and_offset_change_no_guide(backend, channels):
    rng = np.random.default_rng(4)
    shape = (HEIGHT, WIDTH) if channels == 1 else (HEIGHT, WIDTH, 3)
    source = rng.integers(10, 110, shape).astype(np.uint8)
    pictures = [source, source * np.uint8(2) + np.uint8(20), source.astype(np.uint16) * 500 + 3000]
    guides = []
    for picture in pictures:
        levels = colour_levels(picture)
        guides.append(backend.download(make_guide(backend, backend.upload(picture), levels)).astype(int))
    # A value that lies half way between two levels may be rounded to either.
    assert all(np.abs(guide - guides[0]).max() <= 1 and (guide != guides[0]).mean() < 0.02 for guide in guides)
    assert abs(guides[0].mean() - 128) < 1 and abs(guides[0].std() - 50) < 1


@pytest.mark.parametrize(
    "picture", [np.full((HEIGHT, WIDTH), 90, np.uint8), np.full((HEIGHT, WIDTH, 3), 9000, np.uint16)]
)
def test_levels_of_nothing(picture):
    assert colour_levels(picture) == (0, 128) * 3


def test_levels_of_a_large_picture_come_from_some_of_its_rows():
    rng = np.random.default_rng(6)
    picture = rng.integers(0, 256, (2100, 1000)).astype(np.uint8)
    gain, offset = colour_levels(picture)[:2]
    assert gain == pytest.approx(50 / picture.std(), rel=0.01)
    assert offset == pytest.approx(128 - picture.mean() * 50 / picture.std(), abs=1)
