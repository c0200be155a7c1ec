"""The jobs of the clients: one, a page of them, how many, and their end."""

from __future__ import annotations

from collections.abc import Sequence

from stereo_gpu.service.records import Job, Kind, State
from stereo_gpu.service.refusals import Conflict
from stereo_gpu.service.store.part import Part, find_job, job_of


class Jobs(Part):
    """Jobs as they stand in the table, and how old ones leave it."""

    def job(self, client: str, id: str) -> Job:
        """A client's job.

        Raises:
            NotFound: it has none of this id.
        """
        with self._database.read() as tables:
            return find_job(tables, client, id)

    def any_job(self, id: str) -> Job | None:
        """The job of this id, whose ever it is; None where there is none."""
        with self._database.read() as tables:
            row = tables.execute("SELECT * FROM jobs WHERE id = ?", (id,)).fetchone()
        return None if row is None else job_of(row)

    def jobs(
        self,
        client: str,
        *,
        state: State | None = None,
        kind: Kind | None = None,
        limit: int = 50,
        after: int | None = None,
    ) -> list[Job]:
        """A client's jobs, newest first: up to `limit` of those whose `order` is smaller than `after`."""
        wanted = {"state": state, "kind": kind}
        bounds = [f"{name} = :{name}" for name, value in wanted.items() if value is not None]
        if after is not None:
            bounds.append("number < :after")
        with self._database.read() as tables:
            rows = tables.execute(
                f"SELECT * FROM jobs WHERE {' AND '.join(['client = :client', *bounds])}"
                " ORDER BY number DESC LIMIT :limit",
                {**wanted, "client": client, "after": after, "limit": limit},
            ).fetchall()
        return [job_of(row) for row in rows]

    def counts(self) -> dict[State, int]:
        """How many jobs of all clients are in each state."""
        with self._database.read() as tables:
            found = dict(tables.execute("SELECT state, count(*) FROM jobs GROUP BY state").fetchall())
        return {state: found.get(state.value, 0) for state in State}

    def places(self, jobs: Sequence[Job]) -> dict[str, int]:
        """How many jobs wait before each of those that wait, by their ids.

        Clients take turns: before the third job of one go its first two, and up to three of each other one. Before all
        of them go those that are leased and have not begun.
        """
        places = {}
        free = "FROM jobs WHERE state = 'queued' AND owner IS NULL"
        with self._database.read() as tables:
            waiting = dict(tables.execute(f"SELECT client, count(*) {free} GROUP BY client").fetchall())
            turn = dict(tables.execute("SELECT name, turn FROM clients").fetchall())
            query = "SELECT number FROM jobs WHERE owner IS NOT NULL AND state = 'queued' ORDER BY number"
            leased = [row[0] for row in tables.execute(query)]
            for job in jobs:
                query = f"SELECT count(*), max(number) {free} AND client = ? AND number <= ?"
                count, last = tables.execute(query, (job.client, job.order)).fetchone()
                if last != job.order:
                    if job.order in leased:
                        places[job.id] = leased.index(job.order)
                    continue
                others = (
                    min(theirs, count - 1 + ((turn[client], client) < (turn[job.client], job.client)))
                    for client, theirs in waiting.items()
                    if client != job.client
                )
                places[job.id] = len(leased) + count - 1 + sum(others)
        return places

    def delete(self, client: str, id: str) -> None:
        """Forget a job that has ended; its folder is left to the caller.

        Raises:
            NotFound: the client has none of this id.
            Conflict: it waits or runs.
        """
        with self._database.write() as tables:
            job = find_job(tables, client, id)
            if not job.state.ended:
                raise Conflict(f"job {id} is {job.state}: cancel it first")
            tables.execute("DELETE FROM jobs WHERE id = ?", (id,))

    def ended_before(self, time: float, *, limit: int = 100) -> list[Job]:
        """Jobs that ended before `time` (seconds since 1970), the longest ago first."""
        query = "SELECT * FROM jobs WHERE ended IS NOT NULL AND ended < ? ORDER BY ended LIMIT ?"
        with self._database.read() as tables:
            return [job_of(row) for row in tables.execute(query, (time, limit))]

    def oldest_ended(self, *, limit: int = 100) -> list[Job]:
        """Jobs that have ended, the longest ago first."""
        return self.ended_before(float("inf"), limit=limit)

    def ended_bytes(self) -> int:
        """What the inputs and results of all jobs that have ended take on the disk."""
        with self._database.read() as tables:
            query = "SELECT coalesce(sum(bytes), 0) FROM jobs WHERE ended IS NOT NULL"
            return int(tables.execute(query).fetchone()[0])

    def every_job(self, *, after: int = 0, limit: int = 1000) -> list[Job]:
        """Jobs of all clients, oldest first: up to `limit` of those whose `order` is larger than `after`."""
        with self._database.read() as tables:
            query = "SELECT * FROM jobs WHERE number > ? ORDER BY number LIMIT ?"
            return [job_of(row) for row in tables.execute(query, (after, limit))]

    def known(self) -> set[str]:
        """The ids of all jobs and rigs: folders of others may be swept."""
        with self._database.read() as tables:
            return {row[0] for row in tables.execute("SELECT id FROM jobs UNION ALL SELECT id FROM rigs")}

    def leased(self) -> set[str]:
        """The ids of all jobs that are leased, whether they have begun or not."""
        with self._database.read() as tables:
            return {row[0] for row in tables.execute("SELECT id FROM jobs WHERE owner IS NOT NULL")}
