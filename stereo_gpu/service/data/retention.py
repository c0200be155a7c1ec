"""How long ended jobs are kept: by age, then by the room that they take."""

from __future__ import annotations

import time
from collections.abc import Callable

from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.records import Job
from stereo_gpu.service.refusals import Conflict, NotFound
from stereo_gpu.service.settings import Settings
from stereo_gpu.service.store import Store

DAY_S = 86_400.0
YOUNG_S = 3_600.0  # what is younger may be under way: an upload, a job that is not yet in the table, a view
GIGABYTE = 1 << 30
AT_ONCE = 100  # jobs looked at in one step


def sweep(store: Store, folders: Folders, settings: Settings, *, clock: Callable[[], float] = time.time) -> int:
    """Remove jobs that ended more than `keep_days` ago, then the oldest ones beyond `keep_gb`, and what nobody knows.

    Args:
        store, folders: of the service.
        settings: keep_days, keep_gb, upload_seconds.
        clock: seconds since 1970.

    Returns:
        How many jobs were removed; those that somebody restarted meanwhile stay.

    Raises:
        StoreError: the table or the folder cannot be written.
    """
    now = clock()
    gone = _remove(store, folders, lambda: store.ended_before(now - settings.keep_days * DAY_S, limit=AT_ONCE))
    most = settings.keep_gb * GIGABYTE

    def beyond() -> list[Job]:
        over, jobs = store.ended_bytes() - most, []
        for job in store.oldest_ended(limit=AT_ONCE) if over > 0 else ():
            if over <= 0:
                break
            jobs.append(job)
            over -= job.bytes
        return jobs

    gone += _remove(store, folders, beyond)
    folders.sweep(store.known(), now - max(YOUNG_S, 2 * settings.upload_seconds), busy=store.leased())
    return gone


def _remove(store: Store, folders: Folders, choose: Callable[[], list[Job]]) -> int:
    """Remove what `choose` names until that is nothing; how many that were."""
    gone = 0
    while jobs := choose():
        before = gone
        for job in jobs:
            try:
                # The row first: a folder without one is swept, a row without its folder would be a broken promise.
                store.delete(job.client, job.id)
            except (Conflict, NotFound):
                continue
            gone += 1
            folders.remove_job(job.id)
        if gone == before:
            break
    return gone
