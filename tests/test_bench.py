"""The benchmark: every kernel has a case, every case gives a row, and what keeps one from running is said."""

import contextlib
import dataclasses
from pathlib import Path

import numpy as np
import pytest
import reference
from conftest import missing

import stereo_gpu.kernels as kernels
from stereo_gpu.backends import open_backend
from stereo_gpu.bench import BenchOptions, run_bench
from stereo_gpu.bench import machine as bench_machine
from stereo_gpu.bench.cases import KERNELS, MATCHES, YARDSTICKS
from stereo_gpu.bench.launches import catch_launches, compulsory
from stereo_gpu.bench.peers import MATCHERS
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.report import report_lines
from stereo_gpu.bench.row import Row
from stereo_gpu.bench.rows import Peers, time_case
from stereo_gpu.bench.scene import build_bench_scene, mesh_of
from stereo_gpu.bench.timing import Times
from stereo_gpu.errors import BackendError, InputError
from stereo_gpu.match import match
from stereo_gpu.texture import bake_texture
from stereo_gpu.types import View

SIZE = (160, 96, 32)
SLOPED_PX = 0.2  # median error of upright windows on rows that differ by 0.24 px each
ROUNDED = 1e-6  # of float32 chains whose last rounding may differ


@pytest.fixture
def small_roofs(monkeypatch):
    monkeypatch.setattr(bench_machine, "COPIED_BYTES", 1 << 20)
    monkeypatch.setattr(bench_machine, "PRODUCT_SIDE", 64)


@pytest.fixture
def opencl():
    try:
        return open_backend("opencl")
    except BackendError as error:
        missing("opencl", str(error))


def case_of(name):
    return next(case for case in (*KERNELS, *MATCHES) if case.name == name)


def test_every_kernel_is_timed():
    files = (path.stem for path in (Path(kernels.__file__).parent / "opencl").glob("*.cl"))
    assert {case.kernel for case in KERNELS} | set(YARDSTICKS) == {name.removesuffix("_cpu") for name in files}


def test_every_case_gives_a_row(backend, small_roofs, tmp_path):
    said = []
    run = run_bench(BenchOptions(sizes=(SIZE,), window=7, backends=(backend.name,), seconds=0.002, cap=20), said.append)
    ours = [row for row in run.rows if row.kind != "peer"]
    assert [row.name for row in ours] == [case.name for case in (*KERNELS, *MATCHES)]
    assert [row.name for row in run.rows if row.kind == "peer"] == [peer.name for peer in MATCHERS]
    for row in run.rows:
        assert row.note == "", f"{row.name}: {row.note}"
        assert row.size == SIZE and row.window == 7
        assert row.wall.repeats >= 10
        assert row.bytes_s > 0 and row.to_stereobm > 0
    for row in ours:
        case = case_of(row.name)
        assert row.on_device.median > 0
        assert (row.to_peer is not None) == (case.peer is not None)
        assert (row.transfer is not None) == (row.kind == "profile")
        assert run.share_of_copy(row) > 0
    assert run.devices[0].name == backend.name
    assert run.devices[0].copy_bytes_s > 0 and run.devices[0].operations_s > 0
    run.save(tmp_path / "run.json")
    loaded = BenchRun.load(tmp_path / "run.json")
    assert loaded == run
    assert list(report_lines(loaded)) == said


def test_only_what_was_asked_for(small_roofs):
    options = BenchOptions(
        sizes=(SIZE,), window=7, backends=("warp:cpu",), only=("median", "fast", "SGBM HH"), seconds=0.001, cap=9
    )
    run = run_bench(options, lambda line: None)
    assert [row.name for row in run.rows] == ["SGBM HH", "median", "match fast"]
    assert all(row.to_stereobm > 0 for row in run.rows)


def test_two_names_of_one_device_are_one_device(opencl, small_roofs):
    canonical = opencl.name
    names = ("opencl", canonical, "opencl")
    options = BenchOptions(sizes=(SIZE,), window=7, backends=names, only=("median", "fast"), seconds=0.001, cap=9)
    run = run_bench(options, lambda line: None)
    assert [facts.name for facts in run.devices] == [canonical]
    assert [(row.name, row.device) for row in run.rows] == [("median", canonical), ("match fast", canonical)]


def test_a_match_on_an_alias_has_device_time(opencl, small_roofs, tmp_path):
    options = BenchOptions(sizes=(SIZE,), window=7, backends=("opencl",), only=("fast",), seconds=0.001, cap=9)
    run = run_bench(options, lambda line: None)
    run.save(tmp_path / "run.json")
    loaded = BenchRun.load(tmp_path / "run.json")
    assert loaded == run
    (row,) = loaded.rows
    assert row.name == "match fast" and 0 < row.on_device.median < row.wall.median


def test_a_device_that_tells_no_times_has_none(monkeypatch):
    device = open_backend("warp:cpu")
    scene = build_bench_scene(*SIZE, 7)
    monkeypatch.setattr(device, "device_times", lambda: contextlib.nullcontext([]))
    for name in ("triangulate", "match fast"):
        row = time_case(case_of(name), device, scene, scene, Peers(scene), [], seconds=0.001, cap=9)
        assert row.wall.median > 0 and row.on_device is None and row.seconds == row.wall.median


def test_the_pair_has_the_slope_that_it_says():
    scene = build_bench_scene(160, 96, 32, 7)
    values = match(scene.left, scene.right, disparities=(0, 32), window=7, profile="fast").values
    inner = np.s_[8:-8, 8:120]
    assert np.isfinite(values[inner]).mean() > 0.95
    assert np.nanmedian(np.abs(values[inner] - scene.disparity[inner])) < SLOPED_PX


def test_the_mesh_lies_where_the_picture_is():
    scene = build_bench_scene(160, 96, 32, 7)
    device = open_backend("warp:cpu")
    texture = bake_texture(device, device.upload(scene.right), 1.0, mesh_of(scene), scene.pair, View.RIGHT)
    difference = np.abs(texture[4:-4, 4:-4, 0].astype(int) - scene.right[4:-4, 4:-4])
    assert np.median(difference) == 0 and (difference <= 1).mean() > 0.99


def test_a_launch_is_caught_before_it_runs(backend):
    held = backend.upload(np.arange(12, dtype=np.float32).reshape(3, 4))
    first, second = backend.zeros((3, 4), np.float32), backend.zeros((3, 4), np.float32)

    def stage(device):
        for source, target in ((held, first), (first, second)):
            device.launch("median", disparity=source, width=4, height=3, size=3, disparity_out=target)

    caught = catch_launches(backend, "median", stage)
    assert len(caught) == 1 and caught[0]["disparity_out"] is first
    assert not backend.download(first).any()
    both = catch_launches(backend, "median", stage, 2)
    assert [launch["disparity_out"] for launch in both] == [first, second]
    assert backend.download(first).any() and not backend.download(second).any()
    # What passes from the first to the second does not have to be moved.
    assert compulsory("median", both, (3, 4, 16)) == (2 * 4 * 12, "8 WH")


def test_bytes_of_volumes_and_of_what_is_added_to():
    device = open_backend("warp:cpu")
    height, width, disparities = 3, 5, 16
    launch = {
        "cost": device.zeros((height, width, disparities), np.uint8),
        "picture": device.zeros((height, width), np.float32),
        "table": device.zeros((7,), np.float32),
        "width": width,
        "volume_out": device.zeros((height, width, disparities), np.float32),
    }
    size = (height, width, disparities)
    pixels = height * width
    assert compulsory("other", [launch], size) == (pixels * (5 * disparities + 4) + 28, "5 WHD + 4 WH + 28")


@pytest.mark.parametrize(("name", "formula"), [("ncc_wta", "46 WH"), ("wta", "4 WHD + 22 WH")])
def test_keys_of_the_other_view_are_read_and_written(backend, name, formula):
    scene = build_bench_scene(*SIZE, 7)
    launches = catch_launches(backend, name, lambda device: case_of(name).stage(device, scene))
    assert compulsory(name, launches, (SIZE[1], SIZE[0], SIZE[2]))[1] == formula


def test_a_kernel_that_its_stage_never_launches():
    with pytest.raises(ValueError, match="never launches kernel median"):
        catch_launches(open_backend("warp:cpu"), "median", lambda device: None)


def test_multiply_add(backend):
    out = backend.upload(np.full((3, 5), -1, np.float32))
    backend.launch("multiply_add", width=5, height=3, rounds=9, factor=0.75, summand=1.5, sum_out=out)
    expected = reference.multiply_add(15, 9, 0.75, 1.5).reshape(3, 5)
    np.testing.assert_allclose(backend.download(out), expected, rtol=ROUNDED)


def test_what_does_not_fit_says_so(monkeypatch):
    device = open_backend("warp:cpu")
    scene = build_bench_scene(*SIZE, 7)
    monkeypatch.setattr(device, "available_bytes", lambda: (100_000, 100_000))
    row = time_case(case_of("match paper"), device, scene, scene, Peers(scene), [], seconds=0.001, cap=1)
    assert row.wall is None and row.note.startswith("not run: needs ")


def test_a_kernel_that_fails_says_so(monkeypatch):
    device = open_backend("warp:cpu")
    scene = build_bench_scene(*SIZE, 7)

    def fail(kernel, **arguments):
        raise BackendError(f"kernel {kernel} does not compile")

    monkeypatch.setattr(device, "launch", fail)
    row = time_case(case_of("triangulate"), device, scene, scene, Peers(scene), [], seconds=0.001, cap=1)
    assert row.wall is None and row.note == "not run: kernel triangulate does not compile"


def test_a_smaller_size_tells_that_a_run_would_take_too_long():
    scene = build_bench_scene(*SIZE, 7)
    slow = Times(median=2.0, lowest=2.0, highest=2.0, repeats=10)
    smaller = Row(
        name="ncc_wta", kind="kernel", device="warp:cpu", width=80, height=48, disparities=16, window=7, wall=slow
    )
    device = open_backend("warp:cpu")
    row = time_case(case_of("ncc_wta"), device, scene, scene, Peers(scene), [smaller], seconds=1, cap=15)
    assert row.wall is None
    assert row.note == "not run: about 16 s a run going by 80 x 48 x 16; --cap is 15 s"
    # What must run before counts too.
    volume, small = dataclasses.replace(smaller, name="ncc_volume"), dataclasses.replace(slow, median=0.1)
    winners = dataclasses.replace(smaller, name="wta", wall=small)
    row = time_case(case_of("wta"), device, scene, scene, Peers(scene), [volume, winners], seconds=1, cap=15)
    assert row.note.startswith("not run: about 17 s a run, with ncc_volume before it, going by 80 x 48 x 16")
    other = dataclasses.replace(smaller, device="opencl:other")
    row = time_case(case_of("ncc_wta"), device, scene, scene, Peers(scene), [other], seconds=0.001, cap=15)
    assert row.wall is not None


@pytest.mark.parametrize(
    ("size", "window", "says"),
    [
        ((128, 96, 15), 7, "15 disparities"),
        ((128, 96, 0), 7, "0 disparities"),
        ((128, 96, 16), 4, "window 4"),
        ((128, 96, 16), 33, "window 33"),
        ((16, 96, 16), 7, "size 16 x 96"),
        ((128, -1, 16), 7, "size 128 x -1"),
        ((10**9, 96, 16), 7, "at most"),
    ],
)
def test_wrong_sizes(size, window, says):
    with pytest.raises(InputError, match=says):
        run_bench(BenchOptions(sizes=(size,), window=window), print)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"only": ("median", "abacus")}, "'abacus' cannot be timed: choose from ncc_wta, "),
        ({"seconds": 0.0}, "0 seconds"),
        ({"seconds": float("nan")}, "nan seconds"),
        ({"seconds": 9.0, "cap": 8.0}, "cap of 8"),
    ],
)
def test_wrong_options(options, says):
    with pytest.raises(InputError, match=says):
        run_bench(BenchOptions(sizes=(SIZE,), **options), print)


def test_unknown_backend():
    with pytest.raises(BackendError, match="abacus"):
        run_bench(BenchOptions(sizes=(SIZE,), backends=("abacus",)), print)
