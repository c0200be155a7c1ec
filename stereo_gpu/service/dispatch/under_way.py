"""The jobs that the dispatcher has leased, from then until the table knows what became of them."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from stereo_gpu.engines.executor import Running
from stereo_gpu.service.records import Lease


@dataclass(eq=False)
class Entry:
    """A job under way.

    Args:
        lease: ours.
        running: once it is submitted.
        began: whether a worker has it.
        noted: whether the table knows that.
        failures: of the table or the disk, while its answer was put in place.
        cancelled: its client wants it no more.
        returned: a stop of the service gives it back.
        taken: the lease is no longer ours.
    """

    lease: Lease
    running: Running | None = None
    began: bool = False
    noted: bool = False
    failures: int = 0
    cancelled: bool = False
    returned: bool = False
    taken: bool = False

    @property
    def id(self) -> str:
        """Of the job."""
        return self.lease.job.id

    def stop(self) -> None:
        """Have its worker end it."""
        if self.running is not None:
            self.running.cancel()


class UnderWay:
    """All of them by the ids of their jobs; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: dict[str, Entry] = {}

    def __len__(self) -> int:
        return len(self._entries)

    def add(self, entry: Entry) -> Entry | None:
        """Take one in; returns an older one of the same job, whose lease was lost: it is forgotten here."""
        with self._lock:
            older = self._entries.get(entry.id)
            self._entries[entry.id] = entry
            return older

    def get(self, job: str) -> Entry | None:
        """The entry of a job."""
        with self._lock:
            return self._entries.get(job)

    def all(self) -> list[Entry]:
        """Every entry, as they are now."""
        with self._lock:
            return list(self._entries.values())

    def forget(self, entry: Entry) -> bool:
        """Let go of one; whether it was there, and not a newer one of the same job."""
        with self._lock:
            known = self._entries.get(entry.id) is entry
            if known:
                del self._entries[entry.id]
            return known
