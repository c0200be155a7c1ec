"""The kernels' forms for CPUs as a processor without AVX-512, and one without AVX2, gets them.

These forms take 16 lanes where the compiler has AVX-512 and 8 elsewhere, and special instructions where it has
AVX2. Here the compiler is told that it has them not, and the tests of the kernels and of their forms are run once
more, so that what most processors run is tested on the newest ones too.
"""

import inspect
import warnings
from functools import cache

import numpy as np
import pytest
import test_flat_kernels
import test_guided_kernels
import test_kernel_forms
import test_matching_kernels
import test_plane_kernels
import test_raster
from conftest import missing

import stereo_gpu as sg
from stereo_gpu import backends
from stereo_gpu.errors import BackendError
from stereo_gpu.kernels.opencl import program_source, source, together
from stereo_gpu.scene_render import render_pair

WITHOUT = {"avx512": "#undef __AVX512BW__\n", "avx2": "#undef __AVX512BW__\n#undef __AVX2__\n"}
# The maps below come of the same kernels.
SLOW = "test_volume_then_wta_and_fused"


@cache
def open_form(form, without=""):
    """One device for each way to compile, which keeps what it has compiled; `without` tells them apart."""
    try:
        from stereo_gpu.backends.opencl import open_device

        return open_device("", form)
    except (BackendError, ImportError) as error:
        missing("opencl", str(error))


@pytest.fixture(params=WITHOUT)
def narrow(request, monkeypatch):
    """A backend that runs the forms for CPUs, compiled as if the processor had less."""
    found = open_form("cpu", request.param)
    as_they_are = found._kernel

    def compile_narrow(kernel, pixel):
        with monkeypatch.context() as during:
            narrowed = WITHOUT[request.param] + program_source(together(kernel), "cpu")
            during.setattr(backends.opencl, "program_source", lambda names, form: narrowed)
            return as_they_are(kernel, pixel)

    monkeypatch.setattr(found, "_kernel", compile_narrow)
    return found


@pytest.fixture
def backend(narrow):
    """Takes the place of the fixture of that name for the kernels' tests, which are collected here once more."""
    return narrow


@pytest.fixture
def forms(narrow):
    """Takes the place of the fixture of that name for the tests that compare the forms of a kernel."""
    return open_form("gpu"), narrow


def collected():
    """The tests of the forms, and those of the kernels that have no such test, but for the slowest."""
    found = {n: test for n, test in vars(test_kernel_forms).items() if n.startswith("test_")}
    modules = test_matching_kernels, test_guided_kernels, test_plane_kernels, test_flat_kernels, test_raster
    for name, test in [item for module in modules for item in vars(module).items()]:
        if name.startswith("test_") and "backend" in inspect.signature(test).parameters and name != SLOW:
            assert name not in found, f"two tests are called {name}"
            found[name] = test
    return found


globals().update(collected())


def test_the_compiler_is_told(narrow):
    import pyopencl as cl

    tell = """
    __kernel void tell(__global int *out)
    {
        out[0] = LANES;
    #ifdef __AVX2__
        out[1] = 1;
    #else
        out[1] = 0;
    #endif
    }"""
    without = next(name for name in WITHOUT if open_form("cpu", name) is narrow)
    out = narrow.upload(np.full(2, 77, np.int32))
    program = cl.Program(narrow._context, WITHOUT[without] + source("census", "cpu") + tell)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        program.build(["-cl-std=CL1.2"])
    program.tell(narrow._queue, (1,), (1,), out.handle)
    lanes, avx2 = narrow.download(out)
    assert lanes == 8
    assert without == "avx512" or not avx2


@pytest.mark.parametrize("profile", ["paper", "fast", "precise"])
def test_the_map_is_that_of_wide_vectors(small_scene, narrow, monkeypatch, profile):
    pair = sg.rectify(*render_pair(small_scene), small_scene.rig)
    left, right = pair.left[60:137, 40:191], pair.right[60:137, 40:191]
    arguments = {"disparities": (4, 40), "profile": profile, "backend": "opencl"}
    wide = sg.match(left, right, **arguments)
    monkeypatch.setattr(backends, "_open", lambda name: narrow)
    found = sg.match(left, right, **arguments)
    assert narrow._kernels
    assert np.isfinite(wide.values).mean() > 0.5
    for member in ("values", "validity", "confidence"):
        np.testing.assert_array_equal(getattr(wide, member), getattr(found, member))
