"""A store to test with: a clock that is turned by hand, clients, a rig, and jobs by the dozen."""

import random

from stereo_gpu.service.records import InputFile, Job, Kind, RigRecord
from stereo_gpu.service.store import Store

NO_LIMITS = {"queue_limit": 10**6, "client_limit": 10**6}
PICTURE = InputFile(name="left.png", given="a b.png", sha256="ab" * 32, size=3, width=4, height=5)
_ids = random.Random(7)


class Clock:
    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


def new_id():
    return f"{_ids.getrandbits(128):032x}"


def open_store(folder, *clients, clock=None):
    """A store with these clients, each of which has a rig whose id is told by `rig_of`."""
    store = Store(folder / "service.sqlite3", clock or Clock())
    for client in clients:
        store.add_client(client)
        store.add_rig(RigRecord(id=rig_of(client), client=client, name="rig", created=1000.0))
    return store


def rig_of(client):
    return f"{int.from_bytes(client.encode(), 'big'):032x}"


def new_job(client="ann", **given):
    default = {"id": new_id(), "kind": Kind.RECONSTRUCTION, "created": 1000.0, "rig": rig_of(client)}
    return Job(client=client, **{**default, "inputs": (PICTURE,), **given})


def put(store, client="ann", count=1, **given):
    """The ids of new jobs in the queue."""
    jobs = [new_job(client, **given) for _ in range(count)]
    for job in jobs:
        store.enqueue(job, key=None, fingerprint="", **NO_LIMITS)
    return [job.id for job in jobs]
