"""What a cross of like colour votes for, on every device, against plain loops."""

import numpy as np
import pytest
import reference
from conftest import missing

from stereo_gpu.backends.opencl import open_device
from stereo_gpu.errors import BackendError

SHAPES = [(23, 41), (1, 1), (1, 60), (50, 1), (19, 130)]
BOTH = reference.MISMATCH | reference.FILLED  # why there was none, and that there is one now
NUMBERS = {"reach": 8, "step": 2, "alike": 10, "least": 4}


def launched(backend, values, validity, guide, **numbers):
    out = [backend.upload(np.full(values.shape, 77, dtype)) for dtype in (np.float32, np.uint8)]
    backend.launch(
        "vote",
        disparity=backend.upload(values),
        validity=backend.upload(validity),
        guide=backend.upload(guide),
        width=values.shape[1],
        height=values.shape[0],
        **numbers,
        disparity_out=out[0],
        validity_out=out[1],
    )
    return [backend.download(array) for array in out]


def patches(shape):
    """A guide of a few flat colours, and a map with holes of every reason in which each colour has its disparity."""
    rng = np.random.default_rng(7)
    height, width = shape
    rows, columns = np.mgrid[:height, :width]
    colour = rng.integers(0, 3, (height // 9 + 1, width // 9 + 1))[rows // 9, columns // 9]
    guide = np.stack([60 + 12 * colour, 90 - 5 * colour, 128 + 0 * colour]) + rng.integers(-4, 5, (3, *shape))
    values = (5 * colour - 4 + rng.normal(0, 0.4, shape)).astype(np.float32)
    validity = rng.choice(np.array([0, reference.MISMATCH, 4, 16, 1], np.uint8), shape, p=[0.5, 0.3, 0.1, 0.05, 0.05])
    values[validity != 0] = np.nan
    # A value may carry any reason, and stays.
    values[height // 2, width // 2], validity[height // 2, width // 2] = 3.25, reference.MISMATCH
    return values, validity, guide.astype(np.uint8)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "numbers", [NUMBERS, NUMBERS | {"step": 1, "reach": 3}, NUMBERS | {"step": 3, "least": 1}, NUMBERS | {"alike": 256}]
)
def test_vote(backend, shape, numbers):
    values, validity, guide = patches(shape)
    got = launched(backend, values, validity, guide, **numbers)
    want = reference.vote(values, validity, guide, *numbers.values())
    np.testing.assert_array_equal(got[0], want[0].astype(np.float32))
    np.testing.assert_array_equal(got[1], want[1])
    if min(shape) > 1 and numbers["alike"] == 10:
        asked = np.isnan(values) & (validity == reference.MISMATCH)
        assert 0 < (got[1][asked] == BOTH).sum() < asked.sum()


def test_two_surfaces_of_two_colours(backend):
    """A hole across an edge takes on either side what lies there, and a colour without values stays a hole."""
    values = np.full((20, 60), 10.0, np.float32)
    values[:, 30:] = 20.5
    guide = np.full((3, 20, 60), 100, np.uint8)
    guide[1, :, 30:] = 110
    guide[2, 8:12, 28:32] = 200
    values[5:15, 25:35] = np.nan
    validity = np.where(np.isnan(values), reference.MISMATCH, 0).astype(np.uint8)
    got = launched(backend, values, validity, guide, reach=33, step=3, alike=10, least=5)
    assert np.isnan(got[0][8:12, 28:32]).all() and (got[1][8:12, 28:32] == reference.MISMATCH).all()
    hole = (validity != 0) & (guide[2] != 200)
    np.testing.assert_array_equal(got[0][:, :30][hole[:, :30]], 10.0)
    np.testing.assert_array_equal(got[0][:, 30:][hole[:, 30:]], 20.5)
    assert (got[1][hole] == BOTH).all()


@pytest.mark.parametrize("step", [1, 3])  # the first gives more votes than the form for CPUs keeps
@pytest.mark.parametrize("shape", [*SHAPES, (75, 90)])
def test_forms(shape, step):
    values, validity, guide = patches(shape)
    values = np.where(np.arange(shape[1]) % 5 < 4, values % 0.4, values)
    numbers = {"reach": 40, "step": step, "alike": 60, "least": 5}
    try:
        gpu, cpu = (launched(open_device("", form), values, validity, guide, **numbers) for form in ("gpu", "cpu"))
    except BackendError as error:
        missing("opencl", str(error))
    np.testing.assert_array_equal(gpu[0], cpu[0])
    np.testing.assert_array_equal(gpu[1], cpu[1])
    if shape == (75, 90):
        assert (gpu[1] == BOTH).any()
