"""Warp on the CPU from several threads: the same answer however many there are, and no error lost."""

import inspect
import multiprocessing
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from test_smooth_path_kernels import aggregated, paths_case

import stereo_gpu.kernels as kernels
from stereo_gpu.backends.bands import FIRST, Crew, banded, cut
from stereo_gpu.backends.share import usable_cores
from stereo_gpu.backends.warp import WarpBackend
from stereo_gpu.kernels.warp import program

WIDTH, HEIGHT, DISPARITIES = 71, 45, 20
FOLDER = Path(kernels.__file__).parent
KERNELS = sorted(path.stem for path in (FOLDER / "opencl").glob("*.cl") if not path.stem.endswith("_cpu"))


def pictures(seed):
    wide = np.random.default_rng(seed).integers(-100, 101, (HEIGHT, WIDTH + 9)).astype(np.float32)
    return wide[:, :WIDTH].copy(), wide[:, 9:].copy()


def match(backend, left, right):
    """Window sums, correlation and left-right check: strips, scratch and pixels."""
    mask = backend.upload(np.ones((HEIGHT, WIDTH), np.uint8))
    held, norms, numbers = [], [], {"width": WIDTH, "height": HEIGHT}
    for picture in (right, left):
        held.append(backend.upload(picture))
        norms.append([backend.empty((HEIGHT, WIDTH), t) for t in (np.float32, np.float32, np.uint8)])
        outputs = dict(zip(("sum_out", "inverse_out", "validity_out"), norms[-1], strict=True))
        backend.launch("window_norms", picture=held[-1], mask=mask, **numbers, radius=2, threshold=1.0, **outputs)
    found = {f"{name}_out": backend.empty((HEIGHT, WIDTH), np.float32) for name in ("disparity", "score", "ratio")}
    found["validity_out"] = backend.empty((HEIGHT, WIDTH), np.uint8)
    found["other_out"] = backend.zeros((HEIGHT, WIDTH), np.int32)
    sums = {
        "reference_sum": norms[0][0],
        "reference_inverse": norms[0][1],
        "other_sum": norms[1][0],
        "other_inverse": norms[1][1],
    }
    numbers |= {"smallest": 0, "disparities": DISPARITIES, "direction": 1}
    pair = {"reference": held[0], "other": held[1]}
    backend.launch("ncc_wta", **pair, **sums, validity=norms[0][2], **numbers, radius=2, subpixel=1, **found)
    checked = [backend.empty((HEIGHT, WIDTH), t) for t in (np.float32, np.uint8)]
    backend.launch(
        "consistency",
        disparity=found["disparity_out"],
        other=found["other_out"],
        validity=found["validity_out"],
        **numbers,
        tolerance=1.0,
        disparity_out=checked[0],
        validity_out=checked[1],
    )
    return [backend.download(array) for array in (*found.values(), *checked)]


def smooth_paths(backend, cost, guide):
    """The paths down the picture: lines of unequal length, with scratch for each."""
    return aggregated(backend, cost, guide, np.zeros(cost.shape, np.uint16), 1, 0)


@pytest.mark.parametrize("threads", [2, 3, HEIGHT + 7])
def test_threads_change_no_answer(threads):
    left, right = pictures(1)
    cost, guide, _ = paths_case((HEIGHT, WIDTH, DISPARITIES), 2)
    one, many = WarpBackend("cpu", threads=1), WarpBackend("cpu", threads=threads)
    for got, want in zip(match(many, left, right), match(one, left, right), strict=True):
        np.testing.assert_array_equal(got, want)
    np.testing.assert_array_equal(smooth_paths(many, cost, guide), smooth_paths(one, cost, guide))


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (2, 2)])
def test_fewer_rows_than_threads(shape):
    values = np.random.default_rng(3).uniform(0, 9, shape).astype(np.float32)
    backend = WarpBackend("cpu", threads=5)
    out = backend.empty(shape, np.float32)
    backend.launch(
        "median", disparity=backend.upload(values), width=shape[1], height=shape[0], size=3, disparity_out=out
    )
    alone = WarpBackend("cpu", threads=1)
    want = alone.empty(shape, np.float32)
    alone.launch("median", disparity=alone.upload(values), width=shape[1], height=shape[0], size=3, disparity_out=want)
    np.testing.assert_array_equal(backend.download(out), alone.download(want))


def test_triangles_that_overlap_are_drawn_by_one_thread():
    """Many triangles own the same texel; the last one wins, which needs an atomic that Warp lacks on the CPU."""
    corners = np.zeros((4000, 3, 5), np.float32)
    corners[:, 1, 0] = corners[:, 2, 1] = 24
    backend = WarpBackend("cpu", threads=8)
    owner = backend.zeros((12, 12), np.int32)
    backend.launch(
        "cover",
        corners=backend.upload(corners),
        triangles=len(corners),
        reach=0.0,
        texture_width=12,
        texture_height=12,
        owner_out=owner,
    )
    np.testing.assert_array_equal(np.unique(backend.download(owner)), [4000 + (1 << 30)])


def test_callers_in_several_threads_get_their_own_answers():
    backend = WarpBackend("cpu", threads=3)
    pairs = [pictures(seed) for seed in range(4)]
    want = [match(backend, *pair) for pair in pairs]
    with ThreadPoolExecutor(4) as callers:
        for number, got in enumerate(callers.map(lambda k: match(backend, *pairs[k % 4]), range(24))):
            for a, b in zip(got, want[number % 4], strict=True):
                np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", KERNELS)
def test_every_kernel_can_count_from_elsewhere(name):
    kernel = program(name, "cpu")
    labels = [argument.label for argument in banded(kernel).adj.args]
    assert labels == [FIRST, *(argument.label for argument in kernel.adj.args)]
    assert f"+= {FIRST}" in inspect.getsource(banded(kernel).func)


@pytest.mark.parametrize("length", [1, 2, 7, 100])
@pytest.mark.parametrize("threads", [1, 2, 64])
def test_bands_cover_the_range_once(length, threads):
    items = [item for first, count in cut(length, threads) for item in range(first, first + count)]
    assert items == list(range(length))
    assert all(count > 0 for _, count in cut(length, threads))


def test_an_error_in_a_band_reaches_the_caller_after_the_others_have_ended():
    done, gate = [], threading.Event()

    def fail():
        gate.set()
        raise RuntimeError("band 1 failed")

    def last():
        gate.wait(10)
        done.append("last")

    crew = Crew(2)
    with pytest.raises(RuntimeError, match="band 1 failed"):
        crew.run([fail, last, last])
    assert done == ["last", "last"]
    crew.run([last])  # and the crew goes on
    assert len(done) == 3


def child(crew, answer):
    ran = []
    crew.run([lambda: ran.append(1), lambda: ran.append(2)])
    answer.put(sorted(ran))


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="fork: this system has none")
@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork.*:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own():
    crew, context = Crew(2), multiprocessing.get_context("fork")
    crew.run([lambda: None, lambda: None])
    answer = context.Queue()
    process = context.Process(target=child, args=(crew, answer))
    process.start()
    try:
        assert answer.get(timeout=20) == [1, 2]
    finally:
        process.kill()
        process.join()


def test_as_many_threads_as_cores_may_be_used():
    assert 1 <= usable_cores() <= 4096
