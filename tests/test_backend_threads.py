"""Threads and forked processes that use a backend at once, in fresh processes, where nothing is loaded yet."""

import os
import subprocess
import sys

import pytest

MATCH = """
import numpy as np, stereo_gpu as sg
left = np.random.default_rng(0).integers(0, 256, (40, 64), np.uint8)
right = np.roll(left, -5, 1)
match = lambda backend: sg.match(left, right, disparities=(0, 16), backend=backend)
"""
THREADS = """
from concurrent.futures import ThreadPoolExecutor
with ThreadPoolExecutor(4) as pool:
    maps = list(pool.map(match, ["{0}"] * 4))
assert all(np.array_equal(maps[0].values, other.values, equal_nan=True) for other in maps)
assert np.nanmedian(maps[0].values) == 5
print("all four agree")
"""
FORK = """
import os
from stereo_gpu.errors import BackendError
match("opencl")
child = os.fork()
if child == 0:
    try:
        match("opencl")
    except BackendError as error:
        print(error, flush=True)
    (opencl,) = [status for status in sg.devices() if status.name.startswith("opencl")]
    print("listed", opencl.reason, flush=True)
    os._exit(0)
os.waitpid(child, 0)
"""


def run(program):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", MATCH + program], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("backend", ["opencl", "warp:cpu"], indirect=True)
def test_threads_may_make_the_first_match_at_once(backend):
    assert "all four agree" in run(THREADS.format(backend.name))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
@pytest.mark.parametrize("backend", ["opencl"], indirect=True)
def test_opencl_refuses_a_forked_process(backend):
    said = run(FORK)
    assert "spawn" in said
    assert "listed OpenCL was used before this process was forked" in said


@pytest.mark.parametrize("backend", ["opencl"], indirect=True)
def test_a_device_has_one_backend_whatever_it_is_called(backend):
    from stereo_gpu.backends import open_backend

    assert open_backend("opencl") is open_backend(backend.name)
