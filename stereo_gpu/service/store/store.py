"""All that the service remembers, in one SQLite file."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

from stereo_gpu.service.store.clients import Clients
from stereo_gpu.service.store.database import Database
from stereo_gpu.service.store.jobs import Jobs
from stereo_gpu.service.store.leases import Leases
from stereo_gpu.service.store.queue import Queue
from stereo_gpu.service.store.rigs import Rigs

# What the tables cannot say of themselves: each finds the ids of what breaks a rule.
_RULES = {
    "waits for a rig that is not there": "SELECT id FROM jobs WHERE ended IS NULL AND kind = 'reconstruction'"
    " AND rig IS NOT NULL AND rig NOT IN (SELECT id FROM rigs)",
    "runs, or is done, and was never begun": "SELECT id FROM jobs WHERE state IN ('running', 'done')"
    " AND (started IS NULL OR attempt < 1)",
    "ended before it began": "SELECT id FROM jobs WHERE ended < started OR ended < created OR started < created",
    "has a key of another client": "SELECT jobs.id FROM jobs JOIN keys ON keys.job = jobs.id"
    " WHERE keys.client <> jobs.client",
}


class Store(Clients, Rigs, Jobs, Queue, Leases):
    """Clients, rigs and jobs; every method is one transaction and may be called from any thread.

    What a method has returned from is on the disk: neither a killed process nor a power cut takes it back.
    """

    def __init__(
        self, path: str | os.PathLike[str], clock: Callable[[], float] = time.time, *, create: bool = True
    ) -> None:
        """Open the file of a store; a missing one is made if `create` is set.

        Args:
            path: of the file, in a folder that is there.
            clock: seconds since 1970.
            create: whether to make a new one.

        Raises:
            InputError: the file is missing, another program's, or of a newer version than this package.
            DiskFull, StoreError: it is damaged, or cannot be read or written.
        """
        super().__init__(Database(path, create=create), clock)

    @property
    def path(self) -> Path:
        """The file."""
        return self._database.path

    def check(self) -> list[str]:
        """What is wrong, a line each, by SQLite's own check and the rules of jobs; nothing where all is well."""
        found = self._database.check()
        with self._database.read() as tables:
            for rule, query in _RULES.items():
                found += [f"job {row[0]} {rule}" for row in tables.execute(query)]
        return found

    def close(self) -> None:
        """Let go of the file; a second call does nothing."""
        self._database.close()
