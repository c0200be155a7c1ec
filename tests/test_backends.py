"""The seam to the devices: names, what is told of what is missing, memory, and wrong calls."""

import importlib.metadata
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu import backends
from stereo_gpu.backends import DeviceStatus, devices, open_backend
from stereo_gpu.backends.contract import host_memory
from stereo_gpu.config import PROFILES, Profile
from stereo_gpu.device_match import check_match_memory
from stereo_gpu.doctor import examine
from stereo_gpu.errors import BackendError, MemoryLimitError
from stereo_gpu.kernels.opencl import parameters, source


def test_devices_are_listed_best_first():
    listed = devices()
    names = [status.name for status in listed]
    assert "warp:cpu" in names and len(set(names)) == len(names)
    assert [status.available for status in listed] == sorted((s.available for s in listed), reverse=True)
    usable = [status for status in listed if status.available]
    assert [status.kind for status in usable] == sorted((s.kind for s in usable), reverse=True)  # gpu, then cpu
    for status in listed:
        assert status.label
        assert status.available or (status.reason and status.remedy)
    assert sg.devices is devices


@pytest.mark.parametrize(
    ("driver", "there", "best", "asked"),
    [
        (True, {"warp": ["warp:cuda:0", "warp:cpu"], "opencl": ["opencl:gpu"]}, "warp:cuda:0", ["warp"]),
        (True, {"warp": ["warp:cpu"], "opencl": ["opencl:gpu", "opencl:cpu"]}, "opencl:gpu", ["warp", "opencl"]),
        (True, {"warp": ["warp:cpu"], "opencl": []}, "warp:cpu", ["warp", "opencl"]),
        (False, {"warp": ["warp:cpu"], "opencl": ["opencl:cpu"]}, "opencl:cpu", ["opencl"]),
        (False, {"warp": ["warp:cpu"], "opencl": []}, "warp:cpu", ["opencl", "warp"]),
    ],
)
def test_the_best_device_is_found_without_importing_what_cannot_be_better(monkeypatch, driver, there, best, asked):
    seen = []

    def statuses(language):
        seen.append(language)
        kinds = {name: "cpu" if name.endswith("cpu") else "gpu" for name in there[language]}
        missing = DeviceStatus(f"{language}:none", "none", "gpu", "it is missing", "buy one")
        return [missing, *(DeviceStatus(name, name, kind) for name, kind in kinds.items())]

    monkeypatch.setattr(backends, "has_cuda_driver", lambda: driver)
    monkeypatch.setattr(backends, "_statuses", statuses)
    assert backends._best.__wrapped__() == best and seen == asked


def test_every_listed_device_opens_by_its_name():
    for status in devices():
        if status.available:
            backend = open_backend(status.name)
            assert backend.name == status.name and backend.kind == status.kind
            assert open_backend(status.name) is backend  # opened once


TWINS = """
import sys
import numpy as np
from stereo_gpu import backends
from stereo_gpu.backends import DeviceStatus, devices, open_backend
from stereo_gpu.errors import BackendError
first = sys.argv[1]
second = first + "#2"
assert {first, second} <= {status.name for status in devices() if status.available}
for name in (first, second):
    backend = open_backend(name)
    assert backend.name == name
    assert (backend.download(backend.upload(np.arange(9))) == np.arange(9)).all()
part = first.removeprefix("opencl:").lower()
assert open_backend(f"opencl:{part}").name == first
assert open_backend(f"opencl:{part}#2").name == second
for number in ("0", "3", "x"):
    try:
        open_backend(f"opencl:{part}#{number}")
    except BackendError as error:
        assert second in str(error)
    else:
        raise AssertionError(number)
"""


def test_equal_devices_have_names_of_their_own():
    backend = open_backend("opencl")
    if "PoCL" not in backend.device:
        pytest.skip("only PoCL can be asked for a second device")
    subprocess.run(
        [sys.executable, "-c", TWINS, backend.name], env={**os.environ, "POCL_DEVICES": "pthread pthread"}, check=True
    )


QUIET = """
from stereo_gpu.backends import open_backend, opencl
opencl.source = lambda kernel, form: "kernel void grey(global int *out) { if (out[0] = 1) out[1] = 2; }"
open_backend("opencl")._kernel("grey", "uchar")
"""


def test_warnings_of_the_compiler_stay_off_the_terminal(tmp_path):
    fresh = {"POCL_CACHE_DIR": str(tmp_path), "PYOPENCL_NO_CACHE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", QUIET], env={**os.environ, **fresh}, check=True, capture_output=True, text=True
    )
    assert done.stdout + done.stderr == ""


def test_an_unknown_processor_is_named_by_its_instructions():
    import pyopencl as cl

    from stereo_gpu.backends import pocl

    backend = open_backend("opencl")
    device = next(d for p in cl.get_platforms() for d in p.get_devices() if backend.device.startswith(d.name.strip()))
    named = pocl.processor(device)
    if not named:
        assert pocl.build_options(device) == []
        pytest.skip(f"{backend.device} knows its processor")
    assert backend.compiler.endswith(f", for {named}")
    flags = Path("/proc/cpuinfo").read_text().split()
    for macro, flag in (("__AVX512BW__", "avx512bw"), ("__AVX2__", "avx2"), ("__SSE4_2__", "sse4_2")):
        text = f"#ifndef {macro}\n#error no {macro}\n#endif\n__kernel void k(__global int *a) {{ a[0] = 1; }}"
        program = cl.Program(cl.Context([device]), text)
        if flag in flags:
            program.build(options=pocl.build_options(device))
        else:
            with pytest.raises(cl.RuntimeError, match=f"no {macro}"):
                program.build(options=pocl.build_options(device))


@pytest.mark.parametrize("name", ["abacus", "cuda:0", "opencl:no such device", "warp:cuda:99", "warp:tpu"])
def test_unknown_names_say_what_there_is(name):
    with pytest.raises(BackendError, match=r"warp:cpu|stereo-gpu devices") as caught:
        open_backend(name)
    assert "\n" not in str(caught.value)


def test_the_environment_names_the_default(monkeypatch):
    monkeypatch.setenv("STEREO_GPU_BACKEND", "warp:cpu")
    assert open_backend().name == "warp:cpu"
    monkeypatch.setenv("STEREO_GPU_BACKEND", "abacus")
    with pytest.raises(BackendError, match="'abacus'"):
        open_backend()
    assert open_backend("warp:cpu").name == "warp:cpu"  # a name that is given comes first
    monkeypatch.delenv("STEREO_GPU_BACKEND")
    assert open_backend().name == next(status.name for status in devices() if status.available)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int32, np.float32])
def test_arrays_come_back_as_they_went(backend, dtype):
    array = np.random.default_rng(0).integers(0, 200, (7, 5, 3)).astype(dtype)
    held = backend.upload(array[::-1])  # not contiguous
    assert held.shape == (7, 5, 3) and held.dtype == dtype
    np.testing.assert_array_equal(backend.download(held), array[::-1])
    zeros = backend.download(backend.zeros((3, 4), dtype))
    assert zeros.dtype == dtype and zeros.shape == (3, 4) and not zeros.any()


def test_copies_on_the_device(backend):
    array = np.arange(12, dtype=np.float32)
    target = backend.zeros((12,), np.float32)
    backend.copy(backend.upload(array), target)
    np.testing.assert_array_equal(backend.download(target), array)


def test_says_what_runs_and_compiles_its_kernels(backend):
    assert backend.driver and backend.compiler
    assert any(digit.isdigit() for digit in backend.compiler)


def test_what_was_downloaded_stays(backend):
    held = backend.upload(np.ones((4, 4), np.float32))
    before = backend.download(held)
    backend.launch("median", disparity=backend.zeros((4, 4), np.float32), width=4, height=4, size=3, disparity_out=held)
    backend.finish()
    assert (before == 1).all()


def test_a_missing_argument_is_named(backend):
    held = backend.zeros((4, 4), np.float32)
    with pytest.raises(TypeError, match="kernel median needs size"):
        backend.launch("median", disparity=held, width=4, height=4, disparity_out=held)


def test_memory_is_checked_before_it_is_taken(backend):
    total, one = backend.available_bytes()
    assert 0 < one <= total
    backend.check_memory(1, 1, "nothing")
    with pytest.raises(
        MemoryLimitError, match=rf"needs {10**18:,} bytes on {re.escape(backend.name)}.*available: halve it"
    ):
        backend.check_memory(10**18, 1, "halve it")
    with pytest.raises(
        MemoryLimitError, match=rf"one array of {10**18:,} bytes, {backend.name}.*allows [\d,]+: cut it"
    ):
        backend.check_memory(1, 10**18, "cut it")


def test_a_volume_that_does_not_fit_says_what_would(backend):
    _, one = backend.available_bytes()
    side = 8000
    count = min(8192, one // (side * side * 4) + 64)
    if side * side * 4 * count <= one:
        pytest.skip(f"{backend.name} has room for {count} disparities of {side} x {side} px")
    with pytest.raises(MemoryLimitError, match="profile fast"):
        check_match_memory(backend, side, side, count, PROFILES[Profile.PAPER])


def test_host_memory_is_that_of_this_machine():
    assert 1 << 24 < host_memory() < 1 << 50


def test_parameters_are_read_from_the_signature():
    found = {p.name: (p.type, p.array) for p in parameters("median")}
    assert found["disparity"] == ("float", True)
    assert found["width"] == ("int", False)
    assert list(found)[-1] == "disparity_out"
    assert {p.type for p in parameters("rectify")} >= {"PIXEL", "float", "int"}
    with pytest.raises(FileNotFoundError):
        source("no_such_kernel")


def test_doctor_finds_this_installation_well():
    findings = {finding.what: finding for finding in examine()}
    assert findings["Python"].good and findings["numpy"].detail == np.__version__
    for status in devices():
        assert findings[status.name].good == status.available
        assert status.available or findings[status.name].remedy
    assert findings["a device that computes"].good
    needed = {
        re.split(r"[^\w-]", line)[0] for line in importlib.metadata.requires("stereo-gpu") if "extra ==" not in line
    }
    assert needed - set(findings) <= {"pocl-binary-distribution"}, "on other systems OpenCL comes from elsewhere"
    assert all(finding.good for finding in findings.values() if finding.needed)
