"""How the benchmark takes time: works in turn, warm, the ends dropped, the median with its spread."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

WARM_UP_SHARE = 0.2  # of the seconds that a work is timed for: 1 s of warming up before 5 s
REPEATS = 10
FEWEST_REPEATS = 3  # of a work so slow that REPEATS would pass the cap
DROPPED = 0.05  # share of the samples that is left out at either end


@dataclass(frozen=True, kw_only=True)
class Times:
    """Repeated times of one work, s.

    Args:
        median: of all samples; dropping as many at either end does not move it.
        lowest, highest: of the samples that are left once DROPPED of them are gone at either end.
        repeats: how many samples there were.
    """

    median: float
    lowest: float
    highest: float
    repeats: int

    @classmethod
    def of(cls, samples: Sequence[float]) -> Times:
        """Sum up samples, at least one."""
        ordered = sorted(samples)
        # Rounded up at the half, so that 10 samples lose one at either end.
        dropped = int(DROPPED * len(ordered) + 0.5)
        kept = ordered[dropped : len(ordered) - dropped]
        return cls(median=float(np.median(ordered)), lowest=kept[0], highest=kept[-1], repeats=len(ordered))

    @property
    def spread(self) -> float:
        """How far the kept samples reach, as a share of the median."""
        return (self.highest - self.lowest) / self.median if self.median > 0 else 0.0


@dataclass(frozen=True)
class Work:
    """Something to time.

    Args:
        run: does it once; returns seconds on the device where something tells them, else None.
        share: of the seconds asked for, that this work is worth.
    """

    run: Callable[[], float | None]
    share: float = 1.0


@dataclass(frozen=True)
class Measured:
    """Wall time of a work and, where it is known, time on the device."""

    wall: Times
    device: Times | None


class _Samples:
    """What was measured of one work so far."""

    def __init__(self, work: Work) -> None:
        self.work = work
        self.clear()

    def clear(self) -> None:
        self.wall: list[float] = []
        self.device: list[float] = []
        self.total = 0.0

    def take(self) -> None:
        start = time.perf_counter()
        device = self.work.run()
        taken = time.perf_counter() - start
        self.wall.append(taken)
        self.total += taken
        if device is not None:
            self.device.append(device)

    def progress(self, seconds: float, cap: float) -> float:
        """How much of the wanted seconds and repeats is done; 1 or more when it is enough."""
        runs = len(self.wall)
        wanted = min(self.total / (seconds * self.work.share), runs / REPEATS)
        return max(wanted, min(self.total / cap, runs / FEWEST_REPEATS))

    def measured(self) -> Measured:
        device = Times.of(self.device) if len(self.device) == len(self.wall) else None
        return Measured(Times.of(self.wall), device)


def measure(works: Sequence[Work], *, seconds: float, cap: float) -> list[Measured]:
    """Time works in turn, so that whatever else the machine does falls on all of them alike.

    After the warm-up the work whose share is least done always goes next: all end together, and a quick one runs
    several times for each run of a slow one. Each gets at least its share of `seconds` and REPEATS runs, fewer
    where these would take longer than `cap`. A work of which not even FEWEST_REPEATS runs fit the cap is run once,
    without a warm-up.

    Args:
        works: what to time; each must have run before, so that nothing is compiled any more.
        seconds: for each work.
        cap: longest time that one work may take, s.
    """
    samples = [_Samples(work) for work in works]
    for each in samples:
        each.take()
    quick = [each for each in samples if FEWEST_REPEATS * each.total <= cap]
    while cold := [each for each in quick if each.total < WARM_UP_SHARE * seconds * each.work.share]:
        min(cold, key=lambda each: each.total).take()
    for each in quick:
        each.clear()
    while quick:
        behind = min(quick, key=lambda each: each.progress(seconds, cap))
        if behind.progress(seconds, cap) >= 1:
            break
        behind.take()
    return [each.measured() for each in samples]
