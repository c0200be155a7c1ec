"""Whether the table and the folder of a service say the same; after a restored backup they may not."""

from __future__ import annotations

from collections.abc import Iterator

from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.records import Job, State
from stereo_gpu.service.store import Store

AT_ONCE = 1000  # jobs read in one step: the service may be running


def audit(store: Store, folders: Folders) -> list[str]:
    """What is wrong with a service's data, a line each; nothing where all is well.

    Contents are not read: a file counts as whole where it has the size that was noted when it was written. What is
    there without a row is no fault: it is swept.

    Raises:
        StoreError: the table cannot be read.
    """
    found = store.check()
    for job in _every_job(store):
        faults = _faults(folders, job)
        if faults and store.any_job(job.id) == job:  # it did not end or go meanwhile
            found += faults
    for rig in store.every_rig():
        if not folders.rig(rig.id).is_file() and store.rig(rig.client, rig.id) is not None:
            found.append(f"rig {rig.id}: {folders.rig(rig.id)} is missing")
    return found


def _every_job(store: Store) -> Iterator[Job]:
    after = 0
    while jobs := store.every_job(after=after, limit=AT_ONCE):
        yield from jobs
        after = jobs[-1].order


def _faults(folders: Folders, job: Job) -> list[str]:
    faults = []
    for picture in job.inputs:
        path = folders.inputs(job.id) / picture.name
        if not path.is_file() or path.stat().st_size != picture.size:
            faults.append(f"job {job.id} is {job.state}: {path} is missing or cut off")
    if job.state is State.DONE and folders.manifest(job.id) is None:
        faults.append(f"job {job.id} is {job.state}: {folders.result(job.id)} is missing or not whole")
    return faults
