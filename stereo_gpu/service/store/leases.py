"""What a dispatcher does with the queue: take jobs for a while, begin and keep them, end them or give them back.

A job that is leased still waits, as far as its client is concerned, until a worker begins with it: that is a try. It
ends by whoever holds its last lease, and by nobody else: each lease has a number that is never given again, and an
ending that names another one is not applied.
"""

from __future__ import annotations

import heapq
import sqlite3
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from stereo_gpu.service.records import Job, Lease, RigRecord, State
from stereo_gpu.service.store.part import Part, dump, insert_rig, job_of, plain


@dataclass(frozen=True, kw_only=True)
class Ending:
    """How a leased job ended.

    Args:
        id: of the job.
        number: of the lease.
        state: DONE, FAILED or CANCELLED.
        error: why it failed, one line; needed there, and only there.
        stage: that had begun last; None for what the last heartbeat said.
        warnings, seconds, summary: as in `Job`.
        rig: that a calibration made, whose file is in its place; it is remembered in the same transaction.
        rig_is_right: whether a pair was found right by the full check of the job's rig, which is remembered with it.
        bytes: of its inputs and result on the disk; None for what it had.
    """

    id: str
    number: int
    state: State
    error: str | None = None
    stage: str | None = None
    warnings: Sequence[str] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    summary: Mapping[str, Any] = field(default_factory=dict)
    rig: RigRecord | None = None
    rig_is_right: bool = False
    bytes: int | None = None

    def __post_init__(self) -> None:
        if not self.state.ended or (self.state is State.FAILED) != bool(self.error):
            raise ValueError(f"job {self.id} cannot end {self.state} with error {self.error!r}")


class Leases(Part):
    """Jobs taken out of the queue, begun, kept, ended and given back by dispatchers."""

    def lease(self, owner: str, count: int, seconds: float) -> list[Lease]:
        """Take up to `count` jobs for `seconds`; each waits until `begin`.

        Fair: the next job is of the client that has the fewest leased, among those the one whose last turn is longest
        ago; of that client the oldest one.

        Args:
            owner: whose they are then.
            count: how many at most.
            seconds: after which they are anybody's, unless `beat` renews them.
        """
        now = self._clock()
        with self._database.write() as tables:
            picked = _pick(tables, count)
            for number in picked:
                tables.execute(
                    "UPDATE jobs SET owner = ?, until = ?, attempt = attempt + 1, stage = NULL, fraction = 0"
                    " WHERE number = ?",
                    (owner, now + seconds, number),
                )
            rows = [tables.execute("SELECT * FROM jobs WHERE number = ?", (number,)).fetchone() for number in picked]
        return [Lease(job=job_of(row), number=row["attempt"], until=row["until"]) for row in rows]

    def begin(self, leases: Iterable[Lease]) -> None:
        """Say that workers have jobs now: they run, and that counts as a try, whatever becomes of us.

        To say it again does nothing, and neither does a lease that is not in force any more.
        """
        now = self._clock()
        with self._database.write() as tables:
            for lease in leases:
                tables.execute(
                    "UPDATE jobs SET state = 'running', started = max(created, ?), tries = tries + 1"
                    " WHERE id = ? AND attempt = ? AND state = 'queued' AND owner IS NOT NULL",
                    (now, lease.job.id, lease.number),
                )

    def beat(self, owner: str, progress: Mapping[str, tuple[str | None, float]], seconds: float) -> set[str]:
        """Keep jobs for `seconds` more, and remember how far they are.

        Args:
            owner: whose they are.
            progress: by the ids of all that it still works on: the last stage that has begun, and the fraction.
            seconds: from now on.

        Returns:
            The ids of those that somebody wants no more, or that are not this owner's any more: stop them.
        """
        until = self._clock() + seconds
        stop = set()
        with self._database.write() as tables:
            for id, (stage, fraction) in progress.items():
                kept = tables.execute(
                    "UPDATE jobs SET until = ?, stage = ?, fraction = ? WHERE id = ? AND owner = ?",
                    (until, stage, fraction, id, owner),
                ).rowcount
                if not kept:
                    stop.add(id)
            query = "SELECT id FROM jobs WHERE owner = ? AND cancel_asked"
            return stop | {row[0] for row in tables.execute(query, (owner,))}

    def finish(self, endings: Sequence[Ending]) -> set[str]:
        """End jobs, all in one transaction.

        Returns:
            The ids of those that ended by this; the others' leases are not in force any more.
        """
        applied = set()
        now = self._clock()
        with self._database.write() as tables:
            for ending in endings:
                changed = tables.execute(
                    "UPDATE jobs SET state = :state, ended = max(coalesce(started, created), :now), owner = NULL,"
                    # One whose result is found whole has no start of its own where the service died before it was told.
                    " started = CASE WHEN :state = 'done' THEN coalesce(started, created) ELSE started END,"
                    " until = NULL, cancel_asked = 0, error = :error,"
                    " fraction = CASE WHEN :state = 'done' THEN 1 ELSE fraction END, stage = coalesce(:stage, stage),"
                    " warnings = :warnings, seconds = :seconds, summary = :summary,"
                    " rig = coalesce(:rig, rig), bytes = coalesce(:bytes, bytes)"
                    " WHERE id = :id AND attempt = :number AND owner IS NOT NULL",
                    {
                        "id": ending.id,
                        "number": ending.number,
                        "state": ending.state,
                        "now": now,
                        "error": None if ending.error is None else plain(ending.error),
                        "stage": ending.stage,
                        "warnings": dump(list(ending.warnings)),
                        "seconds": dump(dict(ending.seconds)),
                        "summary": dump(dict(ending.summary)),
                        "rig": None if ending.rig is None else ending.rig.id,
                        "bytes": ending.bytes,
                    },
                ).rowcount
                if changed:
                    applied.add(ending.id)
                    if ending.rig is not None:
                        insert_rig(tables, ending.rig)
                    if ending.rig_is_right:
                        query = "UPDATE rigs SET checked = 1 WHERE id = (SELECT rig FROM jobs WHERE id = ?)"
                        tables.execute(query, (ending.id,))
        return applied

    def give_back(self, owner: str, ids: Iterable[str], *, charge: bool) -> list[Job]:
        """Put leased jobs back into the queue, in their places; those that nobody wants any more are cancelled.

        Args:
            owner: whose they are; jobs of others are left alone.
            ids: of the jobs.
            charge: whether that counts as a try, be it begun or not: not where the service stopped for its own reasons.

        Returns:
            Those that this changed.
        """
        changed = []
        with self._database.write() as tables:
            for id in ids:
                row = tables.execute("SELECT * FROM jobs WHERE id = ? AND owner = ?", (id, owner)).fetchone()
                if row is not None:
                    changed.append(_release(tables, row, self._clock(), charge=charge))
        return changed

    def reclaim(self, owner_alive: Callable[[str], bool] | None, tries: int) -> list[Job]:
        """Put jobs back into the queue whose lease ran out, or whose owner is gone; fail them after `tries`.

        Those that had begun lose their try: such a job may be what ended the owner.

        Args:
            owner_alive: whether an owner is; None to ask for the time of the leases alone.
            tries: after so many a job has failed.

        Returns:
            Those that this changed.
        """
        now = self._clock()
        with self._database.write() as tables:
            rows = tables.execute("SELECT * FROM jobs WHERE owner IS NOT NULL").fetchall()
            alive = {row["owner"] for row in rows if owner_alive is None or owner_alive(row["owner"])}
            lost = [row for row in rows if row["until"] < now or row["owner"] not in alive]
            return [_release(tables, row, now, charge=_has_begun(row), tries=tries) for row in lost]


def _pick(tables: sqlite3.Connection, count: int) -> list[int]:
    """The numbers of the next jobs, in the order in which they are due; the turns of their clients are noted."""
    free = "FROM jobs WHERE state = 'queued' AND owner IS NULL"
    waiting = dict(tables.execute(f"SELECT client, count(*) {free} GROUP BY client").fetchall())
    query = "SELECT client, count(*) FROM jobs WHERE owner IS NOT NULL GROUP BY client"
    leased = dict(tables.execute(query).fetchall())
    turns = dict(tables.execute("SELECT name, turn FROM clients").fetchall())
    last = max(turns.values(), default=0)
    heap = [(leased.get(client, 0), turns[client], client) for client in waiting]
    heapq.heapify(heap)
    order: list[str] = []
    while heap and len(order) < count:
        busy, _, client = heapq.heappop(heap)
        last += 1
        turns[client] = last
        order.append(client)
        waiting[client] -= 1
        if waiting[client]:
            heapq.heappush(heap, (busy + 1, last, client))
    oldest = {}
    for client in set(order):
        tables.execute("UPDATE clients SET turn = ? WHERE name = ?", (turns[client], client))
        query = f"SELECT number {free} AND client = ? ORDER BY number LIMIT ?"
        oldest[client] = iter([row[0] for row in tables.execute(query, (client, order.count(client)))])
    return [next(oldest[client]) for client in order]


def _has_begun(row: sqlite3.Row) -> bool:
    return State(row["state"]) is State.RUNNING


def _release(
    tables: sqlite3.Connection, row: sqlite3.Row, now: float, *, charge: bool, tries: int | None = None
) -> Job:
    """Take a lease off a job; returns the job as it is then."""
    state, error = State.QUEUED, None
    counted = row["tries"] + charge - _has_begun(row)
    if row["cancel_asked"]:
        state = State.CANCELLED
    elif tries is not None and counted >= tries:
        state = State.FAILED
        during = f" during {row['stage']}" if row["stage"] else ""
        error = (
            f"the service ended or lost hold of it{during} in the last of {counted} tries: restart it, or try the"
            " pair by itself"
        )
    tables.execute(
        "UPDATE jobs SET state = :state, ended = :ended, error = :error, owner = NULL, until = NULL, cancel_asked = 0,"
        " tries = :tries WHERE number = :number",
        {
            "state": state,
            "ended": max(now, row["started"] or row["created"]) if state.ended else None,
            "error": error,
            "tries": counted,
            "number": row["number"],
        },
    )
    return job_of(tables.execute("SELECT * FROM jobs WHERE number = ?", (row["number"],)).fetchone())
