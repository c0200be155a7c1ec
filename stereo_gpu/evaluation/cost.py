"""What matchers cost: time beside that of OpenCV's semi-global matcher, in turn with it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from stereo_gpu.bench.scene import build_bench_scene
from stereo_gpu.bench.timing import Work, measure
from stereo_gpu.evaluation.matchers import YARDSTICK, Matcher, Search
from stereo_gpu.types import Picture

BENCH_SIZE = (640, 480, 64)
BENCH_WINDOW = 9


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What one map costs; medians.

    Args:
        wall_s: how long one waits.
        cpu_s: time of the process on all cores.
        wall, cpu: the same over the yardstick's.
    """

    wall_s: float
    cpu_s: float
    wall: float
    cpu: float


def bench_pair() -> tuple[Picture, Picture, Search]:
    """The benchmark's pair of 640 x 480, grey, and its 64 disparities."""
    scene = build_bench_scene(*BENCH_SIZE, BENCH_WINDOW)
    return scene.left, scene.right, (0, BENCH_SIZE[2])


def measure_costs(
    left: Picture, right: Picture, search: Search, matchers: Sequence[Matcher], *, seconds: float, cap: float
) -> dict[str, Cost]:
    """Time matchers in turn on one pair, warm.

    Args:
        left, right, search: the pair and the range.
        matchers: what to time, YARDSTICK among them.
        seconds, cap: for each matcher at least, and at most as long as a few repeats fit; see `bench.timing.measure`.
    """
    runs = [matcher.prepare(left, right, search) for matcher in matchers]
    for run in runs:
        run()  # compiles what is not compiled yet
    times = measure([Work(_with_cpu_time(run)) for run in runs], seconds=seconds, cap=cap)
    medians = {
        matcher.name: (taken.wall.median, taken.device.median if taken.device else 0.0)
        for matcher, taken in zip(matchers, times, strict=True)
    }
    wall, cpu = medians[YARDSTICK]
    return {name: Cost(wall_s=w, cpu_s=c, wall=w / wall, cpu=c / cpu) for name, (w, c) in medians.items()}


def _with_cpu_time(run: Callable[[], object]) -> Callable[[], float]:
    """The same, returning the time of all cores in the place of that of a device: the clock takes both alike."""

    def timed() -> float:
        start = time.process_time()
        run()
        return time.process_time() - start

    return timed
