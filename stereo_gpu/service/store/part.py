"""What the parts of a `Store` share: the file, the time, and how a row becomes a record."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from stereo_gpu.service.records import InputFile, Job, Kind, RigRecord, State
from stereo_gpu.service.refusals import NotFound
from stereo_gpu.service.store.database import Database


class Part:
    """Some of what a `Store` can do."""

    def __init__(self, database: Database, clock: Callable[[], float]) -> None:
        self._database = database
        self._clock = clock


def dump(value: Any) -> str:
    """A column of text for a list or a dictionary; numbers of NumPy become plain ones."""
    return json.dumps(value, default=float, separators=(",", ":"))


def plain(text: str) -> str:
    """Text that UTF-8 can hold: a client's name of a file may have been bytes that are none."""
    return text.encode("utf-8", "replace").decode()


def job_columns(job: Job) -> dict[str, Any]:
    """The columns of a job that waits; the others have defaults."""
    return {
        "id": job.id,
        "client": job.client,
        "kind": job.kind.value,
        "state": State.QUEUED.value,
        "created": job.created,
        "rig": job.rig,
        "label": plain(job.label),
        "options": dump(job.options),
        "inputs": dump([asdict(picture) for picture in job.inputs]),
        "pixels": job.pixels,
        "bytes": job.bytes,
    }


def job_of(row: sqlite3.Row) -> Job:
    """The job of a row of the table jobs."""
    return Job(
        id=row["id"],
        client=row["client"],
        kind=Kind(row["kind"]),
        state=State(row["state"]),
        order=row["number"],
        created=row["created"],
        started=row["started"],
        ended=row["ended"],
        tries=row["tries"],
        stage=row["stage"],
        fraction=row["fraction"],
        error=row["error"],
        warnings=tuple(json.loads(row["warnings"])),
        seconds=json.loads(row["seconds"]),
        summary=json.loads(row["summary"]),
        rig=row["rig"],
        label=row["label"],
        options=json.loads(row["options"]),
        inputs=tuple(InputFile(**picture) for picture in json.loads(row["inputs"])),
        pixels=row["pixels"],
        bytes=row["bytes"],
        cancel_asked=bool(row["cancel_asked"]),
    )


def find_job(tables: sqlite3.Connection, client: str, id: str) -> Job:
    """A client's job.

    Raises:
        NotFound: it has none of this id.
    """
    row = tables.execute("SELECT * FROM jobs WHERE id = ? AND client = ?", (id, client)).fetchone()
    if row is None:
        raise NotFound(f"there is no job {id[:40]!r}: ask for the list of jobs")
    return job_of(row)


def rig_of(row: sqlite3.Row) -> RigRecord:
    """The rig of a row of the table rigs."""
    return RigRecord(
        id=row["id"],
        client=row["client"],
        name=row["name"],
        created=row["created"],
        order=row["number"],
        summary=json.loads(row["summary"]),
        calibration=row["calibration"],
        checked=bool(row["checked"]),
    )


def insert_rig(tables: sqlite3.Connection, rig: RigRecord) -> None:
    """Put a rig into the table; one of the same id stays as it is, so that a try can be done again."""
    tables.execute(
        "INSERT INTO rigs (id, client, name, created, summary, calibration, checked) VALUES (?, ?, ?, ?, ?, ?, ?)"
        " ON CONFLICT (id) DO NOTHING",
        (rig.id, rig.client, plain(rig.name), rig.created, dump(rig.summary), rig.calibration, rig.checked),
    )
