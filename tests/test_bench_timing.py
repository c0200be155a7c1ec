"""The method of the benchmark, on a clock that moves only when a work says so."""

import pytest

from stereo_gpu.bench import timing as bench_timing
from stereo_gpu.bench.timing import Times, Work, measure


class Clock:
    """A clock, and works that take known times on it."""

    def __init__(self):
        self.now = 0.0
        self.log = []

    def work(self, name, *seconds, device=None):
        taken = iter(seconds)
        last = seconds[-1]

        def run():
            self.log.append(name)
            self.now += next(taken, last)
            return device

        return run


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(bench_timing.time, "perf_counter", lambda: made.now)
    return made


@pytest.mark.parametrize(
    ("samples", "median", "lowest", "highest"),
    [
        (range(1, 21), 10.5, 2, 19),
        (range(1, 41), 20.5, 3, 38),
        (range(10, 0, -1), 5.5, 2, 9),  # half of a sample counts as one
        ([3, 1, 2], 2, 1, 3),
        ([7], 7, 7, 7),
    ],
)
def test_five_per_cent_go_at_either_end(samples, median, lowest, highest):
    found = Times.of([float(sample) for sample in samples])
    assert (found.median, found.lowest, found.highest, found.repeats) == (median, lowest, highest, len(samples))


def test_an_outlier_changes_neither_median_nor_spread():
    calm = [1.0, 1.01, 0.99, 1.0, 1.02, 0.98, 1.0, 1.01, 0.99, 1.0]
    disturbed = [*calm, 50.0]
    assert Times.of(disturbed).median == pytest.approx(Times.of(calm).median)
    assert Times.of(disturbed).spread < 0.05


def test_spread_is_a_share_of_the_median():
    assert Times(median=2.0, lowest=1.5, highest=2.5, repeats=9).spread == 0.5


def test_works_take_turns_until_each_has_its_seconds(clock):
    first, second = measure(
        [Work(clock.work("a", 0.125, device=0.0625)), Work(clock.work("b", 0.125))], seconds=5, cap=60
    )
    assert first.wall.repeats == second.wall.repeats == 40
    assert first.wall.median == 0.125 and first.device.median == 0.0625
    assert second.device is None
    assert all(ours != theirs for ours, theirs in zip(clock.log[::2], clock.log[1::2], strict=True))
    # A second each of warming up comes before.
    assert len(clock.log) == 2 * (8 + 40)


def test_a_quick_work_runs_between_the_runs_of_a_slow_one(clock):
    slow, quick = measure([Work(clock.work("s", 1.0)), Work(clock.work("q", 0.25))], seconds=5, cap=60)
    assert slow.wall.repeats == 10
    assert quick.wall.repeats == 20
    timed = "".join(clock.log[-30:])
    assert "ss" not in timed[:-2] and "qqqq" not in timed


def test_at_least_ten_repeats(clock):
    (found,) = measure([Work(clock.work("a", 2.0))], seconds=5, cap=60)
    assert found.wall.repeats == 10


def test_a_share_of_the_seconds(clock):
    whole, part = measure([Work(clock.work("a", 0.0625)), Work(clock.work("b", 0.0625), 0.2)], seconds=5, cap=60)
    assert whole.wall.repeats == 80 and part.wall.repeats == 16


def test_the_warm_up_does_not_count(clock):
    (found,) = measure([Work(clock.work("a", 9.0, 0.5, 0.5))], seconds=5, cap=60)
    assert found.wall.highest == 0.5


def test_the_cap_leaves_three_repeats(clock):
    (found,) = measure([Work(clock.work("a", 19.0))], seconds=5, cap=60)
    assert found.wall.repeats == 4
    (found,) = measure([Work(clock.work("a", 20.0))], seconds=5, cap=60)
    assert found.wall.repeats == 3


def test_what_three_times_would_pass_the_cap_is_run_once(clock):
    slow, quick = measure([Work(clock.work("s", 21.0)), Work(clock.work("q", 0.5))], seconds=5, cap=60)
    assert slow.wall.repeats == 1 and slow.wall.median == 21.0 and slow.wall.spread == 0
    assert quick.wall.repeats == 10
    assert clock.log.count("s") == 1
