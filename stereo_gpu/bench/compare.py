"""What got slower between two runs of the benchmark."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.row import TOO_LONG, Row
from stereo_gpu.errors import InputError

LIMIT = 1.15
WORTH_TELLING = 1.05  # changes by less than this, either way, are not listed


@dataclass(frozen=True, kw_only=True)
class Change:
    """One case in two runs.

    Args:
        row: as it is now.
        old, new: time over that of StereoBM in the same run, or seconds where a run has no such ratio.
        relative: whether they are such ratios.
    """

    row: Row
    old: float
    new: float
    relative: bool

    @property
    def factor(self) -> float:
        """How many times slower it is now; under 1 where it is faster."""
        return self.new / self.old


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two runs side by side.

    Args:
        changes: cases of both, the one that lost most first.
        stopped: cases that ran before and were asked for again, but failed; their notes say why.
        left_out: cases that ran before and were left out now, since they would take longer than the cap.
        missing: cases of the old run that this one was not asked for.
        same_machine: whether processor and number of cores agree.
        limit: factor past which a case counts as slower.
    """

    changes: tuple[Change, ...]
    stopped: tuple[Row, ...]
    left_out: tuple[Row, ...]
    missing: tuple[Row, ...]
    same_machine: bool
    limit: float

    @property
    def slower(self) -> tuple[Change, ...]:
        """The cases past the limit."""
        return tuple(change for change in self.changes if change.factor > self.limit)


def compare(old: BenchRun, new: BenchRun, limit: float = LIMIT) -> Comparison:
    """Hold the kernels and profiles of two runs against each other.

    What is compared is the time over that of StereoBM in the same run, since the same machine is faster on one day
    than on another, and StereoBM with it.

    Raises:
        InputError: there is no case that both ran or that stopped running, or the limit is not above 1.
    """
    check_limit(limit)
    now = {row.key: row for row in new.rows if row.kind != "peer"}
    changes: list[Change] = []
    stopped: list[Row] = []
    left_out: list[Row] = []
    missing: list[Row] = []
    for before in old.rows:
        if before.kind == "peer" or before.wall is None:
            continue
        row = now.get(before.key)
        if row is None:
            missing.append(before)
            continue
        if row.wall is None:
            (left_out if row.note.startswith(TOO_LONG) else stopped).append(row)
            continue
        first, second = before.to_stereobm, row.to_stereobm
        relative = first is not None and second is not None
        if first is None or second is None:
            first, second = before.wall.median, row.wall.median
        changes.append(Change(row=row, old=first, new=second, relative=relative))
    if not changes and not stopped:
        raise InputError("the two runs have no case in common: compare runs of the same sizes, window and devices")
    return Comparison(
        changes=tuple(sorted(changes, key=lambda change: -change.factor)),
        stopped=tuple(stopped),
        left_out=tuple(left_out),
        missing=tuple(missing),
        same_machine=all(old.machine.get(name) == new.machine.get(name) for name in ("processor", "cores")),
        limit=limit,
    )


def check_limit(limit: float) -> None:
    """Refuse a limit that every run would pass.

    Raises:
        InputError: it is not above 1.
    """
    if not 1 < limit < 1000:
        raise InputError(f"limit {limit:g}: give a factor above 1, such as 1.15 for 15 % slower")


def comparison_lines(found: Comparison) -> Iterator[str]:
    """What changed, and the verdict."""
    yield ""
    if not found.same_machine:
        yield "the two runs are of different machines: their ratios to StereoBM need not agree"
    changed = [c for c in found.changes if not 1 / WORTH_TELLING < c.factor < WORTH_TELLING]
    for change in changed:
        what = "x StereoBM" if change.relative else "s"
        word = "slower" if change.factor > 1 else "faster"
        factor = max(change.factor, 1 / change.factor)
        mark = "  <- past the limit" if change.factor > found.limit else ""
        yield (
            f"{factor:6.2f} times {word}: {_case_words(change.row)}: {change.old:.3g} -> {change.new:.3g} {what}{mark}"
        )
    for row in found.stopped:
        yield f"ran before: {_case_words(row)}: {row.note or 'no time, and no reason given'}  <- past the limit"
    for row in found.left_out:
        yield f"left out: {_case_words(row)}: {row.note}"
    same = len(found.changes) - len(changed)
    yield f"{len(found.changes)} cases compared, {same} of them within {WORTH_TELLING - 1:.0%} of before"
    if found.missing:
        names = ", ".join(dict.fromkeys(f"{row.name} on {row.device}" for row in found.missing))
        yield f"not in this run: {len(found.missing)} cases ({names})"


def _case_words(row: Row) -> str:
    return f"{row.name} on {row.device}, {row.width} x {row.height} x {row.disparities}"
