"""How much memory a process holds with all that it started, as Linux tells it in /proc."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

SCAN_S = 0.5  # a look at all processes of a machine takes 10 microseconds each, and serves all who ask meanwhile
_PROC = Path("/proc")
MEMORY_IS_KNOWN = (_PROC / "self" / "statm").exists()


class _Groups:
    """Which processes are in which process group, looked up now and then."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._members: dict[int, list[int]] = {}
        self._seen = -SCAN_S

    def members(self, group: int) -> list[int]:
        with self._lock:
            if time.monotonic() - self._seen >= SCAN_S:
                self._members = _look()
                self._seen = time.monotonic()
            return self._members.get(group, [])


_groups = _Groups()


def group_memory(leader: int) -> int:
    """Resident bytes of a process group, what its members share counted for each; 0 where that cannot be told.

    The leader's are of this moment, and which others there are was seen half a second ago at most.
    """
    return sum(resident_memory(pid) for pid in {leader, *_groups.members(leader)}) if MEMORY_IS_KNOWN else 0


def resident_memory(pid: int | None = None) -> int:
    """Resident bytes of one process, by default of this one; 0 where it is gone or that cannot be told."""
    try:
        statm = (_PROC / str(pid or "self") / "statm").read_text()
    except OSError:
        return 0
    return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE")


def _look() -> dict[int, list[int]]:
    found: dict[int, list[int]] = {}
    for entry in os.scandir(_PROC):
        if entry.name.isdecimal():
            try:
                stat = (_PROC / entry.name / "stat").read_text(errors="replace")
            except OSError:
                continue  # it has ended meanwhile
            # Its name stands in brackets, and may hold some; then come its state, its parent and its group.
            group = int(stat.rpartition(")")[2].split()[2])
            found.setdefault(group, []).append(int(entry.name))
    return found
