"""How much of this machine a process may use: of its cores and memory, where several work side by side."""

from __future__ import annotations

import os

PROCESSES = "STEREO_GPU_PROCESSES"  # set for worker processes: how many of them share the machine


def processes() -> int:
    """How many processes share the machine with this one, itself included."""
    told = os.environ.get(PROCESSES, "")
    return max(1, int(told)) if told.isdigit() else 1


def usable_cores() -> int:
    """Cores that this process may use: its share, and one at least."""
    if hasattr(os, "sched_getaffinity"):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    return max(1, cores // processes())
