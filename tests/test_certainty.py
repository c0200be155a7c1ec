"""How likely a disparity of smooth paths is right, on every device, against plain loops."""

import numpy as np
import pytest
import reference
from conftest import missing

from stereo_gpu.backends.opencl import open_device
from stereo_gpu.errors import BackendError

SHAPES = [(23, 41), (1, 1), (1, 60), (50, 1), (19, 130)]


def launched(backend, ratio, validity, doubt):
    out = backend.upload(np.full(ratio.shape, 77, np.float32))
    size = {"width": ratio.shape[1], "height": ratio.shape[0]}
    given = {"ratio": backend.upload(ratio), "validity": backend.upload(validity)}
    backend.launch("certainty", **given, **size, doubt=doubt, confidence_out=out)
    return backend.download(out)


def ratios(shape):
    """Ratios of all sizes and one that is not known, and reasons."""
    rng = np.random.default_rng(3)
    ratio = rng.uniform(0, 1.1, shape).astype(np.float32)
    ratio[shape[0] // 2, shape[1] // 2] = np.nan
    validity = rng.choice(np.array([0, 4, 8, 16, 32, 40], np.uint8), shape, p=[0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    validity[shape[0] // 2, shape[1] // 2] = 0
    return ratio, validity


@pytest.mark.parametrize("doubt", [0.4, 1.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_certainty(backend, shape, doubt):
    ratio, validity = ratios(shape)
    got = launched(backend, ratio, validity, doubt)
    np.testing.assert_allclose(got, reference.certainty(ratio, validity, doubt), atol=1e-6)
    assert (got[validity != 0] == 0).all() and (got[validity == 0] > 0.999 - doubt).all()
    assert got[shape[0] // 2, shape[1] // 2] == np.float32(1 - doubt)  # nothing known is no trust


@pytest.mark.parametrize("shape", SHAPES)
def test_forms(shape):
    ratio, validity = ratios(shape)
    try:
        gpu, cpu = (launched(open_device("", form), ratio, validity, 0.4) for form in ("gpu", "cpu"))
    except BackendError as error:
        missing("opencl", str(error))
    np.testing.assert_array_equal(gpu, cpu)
