"""Every kernel, in both of its forms, on a device that allows little; and the same map of every profile.

The device is the best OpenCL one that is here; its backend is told to believe in groups of 64 work-items and
16 KiB of local memory, which is what OpenCL 1.2 promises for the smallest devices and the least that the
kernels' forms for GPUs are written for. That no kernel needs fp64 is read from the sources and asked of a compiler.
"""

import inspect
import re
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import test_flat_kernels
import test_geometry_kernels
import test_match_cost
import test_matching_kernels
import test_plane_kernels
import test_raster
import test_smooth_path_kernels
import test_split_triangles
import test_texture_kernels
from conftest import missing
from test_smooth_path_kernels import PENALTIES

import stereo_gpu as sg
import stereo_gpu.kernels as kernels
from stereo_gpu import backends
from stereo_gpu.backends import open_backend
from stereo_gpu.config import PROFILES, Profile
from stereo_gpu.device_match import check_match_memory
from stereo_gpu.errors import BackendError
from stereo_gpu.kernels.opencl import source
from stereo_gpu.scene_render import render_pair

GROUP, LOCAL_BYTES = 64, 16 * 1024
FOLDER = Path(kernels.__file__).parent / "opencl"
KERNELS = sorted(path.stem for path in FOLDER.glob("*.cl") if not path.stem.endswith("_cpu"))
# A number such as 0.5 or 1e9, which is a double unless an f follows.
DOUBLE_NUMBER = re.compile(r"(?<![\w.])(\d+\.\d*|\.\d+|\d+(?=[eE]))([eE][-+]?\d+)?(?![fF\w.])")
DOUBLE_NAME = re.compile(r"\b(double\d*|convert_double\w*|M_(?!\w*_F\b)[A-Z0-9_]+|DBL_\w+)\b")


@cache
def open_limited(form, group=GROUP, local_bytes=LOCAL_BYTES):
    try:
        from stereo_gpu.backends import opencl

        return opencl.open_device("", form, opencl.Limits(group, local_bytes))
    except (BackendError, ImportError) as error:
        missing("opencl", str(error))


@pytest.fixture(params=["gpu", "cpu"])
def backend(request):
    """Takes the place of the fixture of that name for the kernels' tests, which are collected here once more."""
    return open_limited(request.param)


def kernel_tests():
    found = {}
    modules = (
        test_flat_kernels,
        test_geometry_kernels,
        test_match_cost,
        test_matching_kernels,
        test_plane_kernels,
        test_raster,
        test_smooth_path_kernels,
        test_split_triangles,
        test_texture_kernels,
    )
    for module in modules:
        for name, test in vars(module).items():
            if name.startswith("test_") and "backend" in inspect.signature(test).parameters:
                assert name not in found, f"two kernel tests are called {name}"
                found[name] = test
    return found


globals().update(kernel_tests())


@pytest.mark.parametrize("direction", [1, -1])
def test_fused_on_few_pixels(backend, direction):
    """Several groups, strips, chunks of disparities and directions, in as few pixels as Oclgrind has time for."""
    shape, radius = (19, 9), 1
    left, right = (picture[: shape[0], : shape[1]].copy() for picture in test_matching_kernels.scene())
    arrays, validity = test_matching_kernels.prepared(backend, left, right, np.ones(shape, np.uint8), radius, 1.0)
    numbers = {"width": shape[1], "height": shape[0], "smallest": -60, "disparities": 70, "direction": direction}
    volume = test_matching_kernels.junk(backend, (*shape, 70), np.float32)
    backend.launch("ncc_volume", **arrays, **numbers, radius=radius, volume_out=volume)
    apart, fused = (test_matching_kernels.winners(backend, shape) for _ in range(2))
    backend.launch("wta", volume=volume, validity=validity, **numbers, subpixel=1, **apart)
    backend.launch("ncc_wta", **arrays, validity=validity, **numbers, radius=radius, subpixel=1, **fused)
    for name in apart:
        np.testing.assert_array_equal(backend.download(apart[name]), backend.download(fused[name]))
    assert np.isfinite(backend.download(fused["disparity_out"])).any()


@pytest.fixture
def opened_by_name(monkeypatch):
    """Let `backend="limited ..."` name one of the backends of this file."""
    whole = open_backend("opencl")

    def opener(name):
        return whole if name == "opencl" else open_limited(name.removeprefix("limited "))

    monkeypatch.setattr(backends, "_open", opener)


@pytest.mark.parametrize("profile", ["paper", "fast", "precise"])
@pytest.mark.parametrize("form", ["gpu", "cpu"])
def test_the_map_is_that_of_the_whole_device(small_scene, opened_by_name, form, profile):
    open_limited(form)
    pair = sg.rectify(*render_pair(small_scene), small_scene.rig)
    left, right = pair.left[60:160, 40:220], pair.right[60:160, 40:220]
    found = [
        sg.match(left, right, disparities=(4, 40), profile=profile, backend=name)
        for name in ("opencl", f"limited {form}")
    ]
    assert np.isfinite(found[0].values).mean() > 0.5
    for member in ("values", "validity", "confidence"):
        np.testing.assert_array_equal(getattr(found[0], member), getattr(found[1], member))


def test_a_device_that_allows_too_little_is_told_so():
    arguments = {"width": 4, "height": 4, "size": 3}
    for limits in ((32, LOCAL_BYTES), (GROUP, 512)):
        device = open_limited("gpu", *limits)
        zeros = {name: device.zeros((4, 4), np.float32) for name in ("disparity", "disparity_out")}
        device.launch("median", **zeros, **arguments)  # any number of work-items does
        with pytest.raises(BackendError, match=r"kernel (ncc_)?wta needs groups of 64 and [\d,]+ bytes") as caught:
            test_matching_kernels.test_fused_on_extreme_shapes(device, (1, 1))
        assert "\n" not in str(caught.value)


def test_scratch_is_counted_and_a_large_one_goes(backend, monkeypatch):
    options = PROFILES[Profile.FAST]
    size = {"width": 640, "height": 480, "disparities": 128}
    scratch = backend.scratch_bytes("ncc_wta", **size, radius=options.window // 2)
    asked = []
    monkeypatch.setattr(backend, "check_memory", lambda needed, largest, remedy: asked.append(needed))
    check_match_memory(backend, *size.values(), options)
    monkeypatch.undo()
    assert scratch > 0 and asked == [640 * 480 * 90 + scratch]

    # Lines of so many disparities that their scratch is not worth keeping.
    size = {"width": 40, "height": 3, "disparities": 420_000}
    wanted = backend.scratch_bytes("aggregate", **size, heading=1)
    assert wanted > 64 << 20
    total, one = backend.available_bytes()
    if 4 * wanted > min(total, one):
        pytest.skip(f"{backend.name} has too little memory")
    backend.launch(
        "aggregate",
        cost=backend.zeros((3, 40, 420_000), np.uint8),
        guide=backend.zeros((3, 3, 40), np.uint8),
        **size,
        heading=1,
        row_slope=0,
        **PENALTIES,
        sums_out=backend.zeros((3, 40, 420_000), np.uint16),
    )
    assert backend._scratch.size == wanted
    backend.finish()
    assert backend._scratch is None


def test_no_source_has_a_double():
    for path in sorted(FOLDER.glob("*.cl")) + sorted(FOLDER.glob("*.h")):
        text = re.sub(r"//[^\n]*|/\*.*?\*/", "", path.read_text("utf-8"), flags=re.DOTALL)
        assert not (found := DOUBLE_NUMBER.search(text) or DOUBLE_NAME.search(text)), f"{path.name}: {found[0]}"


@pytest.mark.parametrize("text", ["0.5", "1.", ".5", "1e9", "1.0e-3", "double x", "double4", "M_PI", "DBL_MAX"])
def test_a_double_would_be_found(text):
    assert DOUBLE_NUMBER.search(f"x = {text};") or DOUBLE_NAME.search(f"x = {text};")
    for harmless in ("0.5f", "1.e3f", "a.x", "v1.5f", "x2", "1 << 5", "M_PI_F", "0x1e5", "doubled"):
        assert not DOUBLE_NUMBER.search(harmless) and not DOUBLE_NAME.search(harmless)


def test_no_compiler_makes_a_double(backend):
    """Clang, which most drivers build on, finds the double that a built-in or a mixed expression would bring."""
    import pyopencl as cl

    device = next(d for p in cl.get_platforms() for d in p.get_devices() if backend.device.startswith(d.name.strip()))
    context, guard = cl.Context([device]), '#pragma clang diagnostic error "-Wdouble-promotion"\n'
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        try:
            cl.Program(context, guard + "__kernel void k(__global float *a) { a[0] = a[0] * 0.1; }").build()
        except cl.RuntimeError:
            for kernel in KERNELS:
                program = cl.Program(context, guard + source(kernel, backend.form))
                assert program.build(options=["-cl-std=CL1.2", "-DPIXEL=uchar"])
        else:
            pytest.skip(f"the compiler of {device.platform.name} is not known to tell of doubles")
