"""tools/gpu_report: how full a GPU gets, what bounds a kernel, and what it finds wrong."""

import sys
from pathlib import Path

import pytest
from conftest import missing

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
TOOLS = pytest.importorskip("gpu_compile", reason="needs the checkout's tools")
from gpu_chips import CHIPS, bound, occupancy  # noqa: E402
from gpu_compile import ARGUMENTS, KERNELS, Compiled, compile_for_amd, compile_for_cuda, find_clang, find_ptxas  # noqa: E402
from gpu_report import HOT, bound_lines, compiled_lines, faults  # noqa: E402

from stereo_gpu.kernels.costs import cost  # noqa: E402
from stereo_gpu.kernels.geometry import geometry  # noqa: E402


@pytest.mark.parametrize(
    ("architecture", "registers", "shared", "threads", "share"),
    [
        (75, 32, 0, 256, 1.0),
        (80, 64, 0, 256, 0.5),  # 65,536 registers for 1024 of 2048 threads
        (80, 65, 0, 256, 0.375),  # which come in lots of 8 a thread: 72 let 3 blocks in
        (86, 32, 0, 64, 1024 / 1536),  # 16 blocks at most
        (90, 32, 48 * 1024, 128, 4 * 128 / 2048),  # 228 KiB hold four of 48 + 1
        (75, 64, 13432, 128, 0.5),
    ],
)
def test_occupancy(architecture, registers, shared, threads, share):
    assert occupancy(architecture, registers, shared, threads) == share


@pytest.mark.parametrize("kernel", KERNELS)
def test_every_kernel_can_be_planned(kernel):
    plan = geometry(kernel, "warp", "gpu", ARGUMENTS, 132)
    assert all(size > 0 for size in plan.size)


def test_bound():
    h100 = CHIPS[0]
    rate, why = bound(h100, moved=4.0, words=0.0, floats=1.0, integers=1.0)
    assert (rate, why) == (pytest.approx(3.35e12 / 4), "memory")
    rate, why = bound(h100, moved=0.0, words=0.0, floats=0.0, integers=100.0)
    assert (rate, why) == (pytest.approx(132 * 1.98e9 * 64 / 100), "whole numbers")
    rate, why = bound(h100, moved=0.0, words=10.0, floats=1.0, integers=1.0)
    assert (rate, why) == (pytest.approx(132 * 1.98e9 * 32 / 10), "shared memory")


@pytest.mark.parametrize("language", ["warp", "opencl"])
def test_costs_grow_with_the_work(language):
    assert set(HOT) <= set(KERNELS)
    for kernel in HOT:
        small, large = (cost(kernel, language, 128, window, 40) for window in (5, 31))
        assert small.bytes > 0 and small.integers > 0
        assert large.words + large.floats + large.integers >= small.words + small.floats + small.integers
    # A wider window costs what enters and leaves the running sums, not its area.
    assert cost("ncc_wta", language, 128, 31, 40).integers < 2 * cost("ncc_wta", language, 128, 5, 40).integers


def test_aims_at_a_hundred_on_an_h100():
    row = next(line for line in bound_lines() if line.startswith("| ncc_wta"))
    assert float(row.split("|")[7].split("(")[0]) >= 100


def test_faults():
    good = Compiled("median", "sm_90", 32, 0, 0, 1.0)
    assert list(faults([good])) == []
    spills = Compiled("fill", "gfx90a", 32, 8, 0, 1.0)
    thin = Compiled("evidence", "sm_80", 90, 0, 0, 0.25)
    calls = Compiled("bake", "gfx1030", 32, 0, 0, 1.0, calls=2)
    # Only the hot ones must fill half of a GPU.
    modest = Compiled("bake", "sm_80", 90, 0, 0, 0.25)
    lines = list(faults([good, spills, thin, calls, modest]))
    assert [line.split(" on ")[0] for line in lines] == ["fill", "evidence", "bake"]


def test_compiles_for_cuda():
    try:
        find_ptxas()
    except FileNotFoundError as error:
        missing("ptxas", str(error))
    found = compile_for_cuda("fill")
    assert [one.architecture for one in found] == ["sm_75", "sm_80", "sm_86", "sm_90", "sm_100", "sm_120"]
    assert all(8 <= one.registers <= 64 and not one.spilled and one.occupancy == 1 for one in found)
    assert any(line.startswith("| fill | ") for line in compiled_lines("CUDA", found))


def test_compiles_for_amd():
    try:
        find_clang()
    except FileNotFoundError as error:
        missing("clang", str(error))
    found = compile_for_amd("evidence")
    assert [one.architecture for one in found] == ["gfx90a", "gfx1030", "gfx1100"]
    assert all(one.registers > 8 and not one.spilled and not one.calls and one.occupancy >= 0.5 for one in found)
