"""A process that uses a store without a pause until it is killed; it prints what it was told, once it was told.

Run as `store_writer.py FILE NAME FIRST`: puts jobs into the queue with the keys NAME-FIRST, NAME-(FIRST + 1) and so on,
takes jobs, keeps them, and ends, gives back or cancels them; at times it takes everybody's leases away.
"""

import os
import random
import secrets
import sys
import time

from stereo_gpu.service.records import Job, Kind, State
from stereo_gpu.service.refusals import Conflict
from stereo_gpu.service.store import Ending, Store


def main(path, name, first):
    store = Store(path, create=False)
    owner, chance, number = f"{name}-{os.getpid()}", random.Random(first), int(first)

    def say(*words):
        os.write(1, (" ".join(map(str, words)) + "\n").encode())  # one write: a line is whole or not there

    while True:
        client = f"client{number % 3}"
        job = Job(id=secrets.token_hex(16), client=client, kind=Kind.CALIBRATION, created=time.time())
        kept, _ = store.enqueue(job, key=f"{name}-{number}", fingerprint="f", queue_limit=10**6, client_limit=10**6)
        say("queued", number, kept.id)
        number += 1
        leases = store.lease(owner, 2, 3600)
        for lease in leases:
            say("leased", lease.job.id, lease.number)
        store.begin(leases[: chance.randrange(3)])
        store.beat(owner, {lease.job.id: ("match", 0.5) for lease in leases}, 3600)
        for lease in leases:
            way = chance.random()
            if way < 0.1:
                store.give_back(owner, [lease.job.id], charge=way < 0.05)
            elif way < 0.2:
                try:
                    store.ask_cancel(lease.job.client, lease.job.id)
                except Conflict:
                    continue
        if chance.random() < 0.2:
            store.reclaim(lambda _: False, 1000)
        ids = store.finish([Ending(id=lease.job.id, number=lease.number, state=State.DONE) for lease in leases])
        for id in ids:
            say("ended", id)


if __name__ == "__main__":
    main(*sys.argv[1:])
