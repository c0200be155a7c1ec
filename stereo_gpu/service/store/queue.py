"""What clients do with the queue: put a job in, want it no more, want it once more."""

from __future__ import annotations

import math
import sqlite3

from stereo_gpu.service.records import Job, State
from stereo_gpu.service.refusals import Conflict, KeyReused, QueueFull, no_rig
from stereo_gpu.service.store.part import Part, find_job, job_columns

RATE_S = 60.0  # the time over which the rate is taken that a full queue tells
ROOM_FOR = 8  # jobs: a client that comes back should not find the queue full again at once
LONGEST_RETRY_S = 60


class Queue(Part):
    """Jobs put into the queue and taken out of it by clients."""

    def enqueue(
        self, job: Job, *, key: str | None, fingerprint: str, queue_limit: int, client_limit: int
    ) -> tuple[Job, bool]:
        """Put a job into the queue, unless the same request has done so before.

        Args:
            job: whose inputs are in its folder; its state, order and tries are the store's to say.
            key: the client's Idempotency-Key; it is remembered as long as its job.
            fingerprint: of the request that came with the key.
            queue_limit: of waiting jobs, of all clients.
            client_limit: of waiting jobs of this client.

        Returns:
            The job, and whether it is new: if not, it is that of the earlier request.

        Raises:
            KeyReused: the key came before with another fingerprint.
            QueueFull: a limit is reached.
            InputError: its rig is not there any more.
        """
        with self._database.write() as tables:
            if key is not None:
                query = "SELECT fingerprint, job FROM keys WHERE client = ? AND key = ?"
                known = tables.execute(query, (job.client, key)).fetchone()
                if known is not None and known["fingerprint"] != fingerprint:
                    raise KeyReused(
                        f"Idempotency-Key {key!r:.80} belongs to job {known['job']}, which is of another request:"
                        " use a new key"
                    )
                if known is not None:
                    return find_job(tables, job.client, known["job"]), False
            _check_room(tables, job.client, queue_limit, client_limit, self._clock())
            if job.rig is not None and not _has_rig(tables, job.client, job.rig):
                raise no_rig(job.rig)
            columns = job_columns(job)
            tables.execute(
                f"INSERT INTO jobs ({', '.join(columns)}) VALUES ({', '.join(f':{name}' for name in columns)})", columns
            )
            if key is not None:
                tables.execute("INSERT INTO keys VALUES (?, ?, ?, ?)", (job.client, key, fingerprint, job.id))
            return find_job(tables, job.client, job.id), True

    def ask_cancel(self, client: str, id: str) -> Job:
        """Want a job no more: one that waits is cancelled at once, one that runs is marked for its dispatcher.

        Raises:
            NotFound: the client has none of this id.
            Conflict: it is done or has failed.
        """
        with self._database.write() as tables:
            job = find_job(tables, client, id)
            if job.state in (State.DONE, State.FAILED):
                raise Conflict(f"job {id} is {job.state}: there is nothing to cancel any more; delete it")
            if job.state is State.QUEUED:
                ended = max(self._clock(), job.started or job.created)
                # Whoever has leased it loses it by this.
                query = "UPDATE jobs SET state = 'cancelled', ended = ?, owner = NULL, until = NULL WHERE id = ?"
                tables.execute(query, (ended, id))
            elif job.state is State.RUNNING:
                tables.execute("UPDATE jobs SET cancel_asked = 1 WHERE id = ?", (id,))
            return find_job(tables, client, id)

    def restart(self, client: str, id: str, *, queue_limit: int | None = None, client_limit: int | None = None) -> Job:
        """Put a job that failed or was cancelled into the queue again, with all of its tries.

        Raises:
            NotFound: the client has none of this id.
            Conflict: it waits, runs or is done, or its rig is not there any more.
            QueueFull: a limit is reached; None for none.
        """
        with self._database.write() as tables:
            job = find_job(tables, client, id)
            if job.state not in (State.FAILED, State.CANCELLED):
                raise Conflict(f"job {id} is {job.state}: only one that failed or was cancelled can be restarted")
            if job.rig is not None and not _has_rig(tables, client, job.rig):
                raise Conflict(f"job {id} needs rig {job.rig}, which has been deleted: send the pair with another rig")
            _check_room(tables, client, queue_limit, client_limit, self._clock())
            tables.execute(
                "UPDATE jobs SET state = 'queued', started = NULL, ended = NULL, tries = 0, stage = NULL, fraction = 0,"
                " error = NULL, warnings = '[]', seconds = '{}', summary = '{}' WHERE id = ?",
                (id,),
            )
            return find_job(tables, client, id)


def _has_rig(tables: sqlite3.Connection, client: str, id: str) -> bool:
    return tables.execute("SELECT 1 FROM rigs WHERE id = ? AND client = ?", (id, client)).fetchone() is not None


def _check_room(
    tables: sqlite3.Connection, client: str, queue_limit: int | None, client_limit: int | None, now: float
) -> None:
    (own,) = tables.execute("SELECT count(*) FROM jobs WHERE state = 'queued' AND client = ?", (client,)).fetchone()
    if client_limit is not None and own >= client_limit:
        raise QueueFull(
            f"{own} jobs of yours wait, the limit is {client_limit}: wait for some of them", _retry_s(tables, now)
        )
    (all_,) = tables.execute("SELECT count(*) FROM jobs WHERE state = 'queued'").fetchone()
    if queue_limit is not None and all_ >= queue_limit:
        raise QueueFull(f"{all_} jobs wait, the limit is {queue_limit}: come back later", _retry_s(tables, now))


def _retry_s(tables: sqlite3.Connection, now: float) -> int:
    """Whole seconds until there is room for some jobs, by how many ended lately."""
    (ended,) = tables.execute("SELECT count(*) FROM jobs WHERE ended > ?", (now - RATE_S,)).fetchone()
    return min(LONGEST_RETRY_S, max(1, math.ceil(ROOM_FOR * RATE_S / ended))) if ended else LONGEST_RETRY_S
