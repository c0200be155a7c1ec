"""Devices and data that tests run on; what is missing is skipped by name, or fails if it is required.

STEREO_GPU_REQUIRE=opencl,warp:cpu,data turns the skip of a missing device, or of missing data, into a failure.
"""

import os
from pathlib import Path

import pytest

from stereo_gpu.backends import devices, open_backend
from stereo_gpu.errors import BackendError

REQUIRED = {name for name in os.environ.get("STEREO_GPU_REQUIRE", "").split(",") if name}
DATA = Path(os.environ.get("STEREO_GPU_DATA", Path(__file__).parents[1] / ".." / "shared" / "data"))


def missing(name, reason):
    if name in REQUIRED:
        pytest.fail(f"{name} is required here: {reason}")
    pytest.skip(f"{name}: {reason}")


def device_names():
    gpus = [status.name for status in devices() if status.kind == "gpu" and status.available]
    return ["opencl", "warp:cpu", *gpus]


@pytest.fixture(params=device_names())
def backend(request):
    """Every device that can be had; the whole suite of kernel tests runs on each."""
    try:
        return open_backend(request.param)
    except BackendError as error:
        missing(request.param, str(error))


@pytest.fixture(scope="session")
def data():
    """The folder of real pictures with known truth."""
    if not DATA.is_dir():
        missing("data", f"no folder {DATA}; set STEREO_GPU_DATA")
    return DATA
