import os
import random
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

from stereo_gpu.service.records import State
from stereo_gpu.service.store import Ending, Store

WRITER = Path(__file__).with_name("store_writer.py")
ROUNDS = 8
CLIENTS = ("client0", "client1", "client2")


def start(path, name, first):
    return subprocess.Popen([sys.executable, str(WRITER), str(path), name, str(first)], stdout=subprocess.PIPE)


def lines_until_killed(writer, count):
    """The first `count` lines, then the rest of what it was told before SIGKILL reached it."""
    lines = [writer.stdout.readline() for _ in range(count)]
    os.kill(writer.pid, signal.SIGKILL)
    lines += writer.stdout.readlines()
    writer.stdout.close()
    assert writer.wait() == -signal.SIGKILL, "it ended by itself"
    return [line.decode().split() for line in lines]


def test_killed_writers_lose_and_double_nothing(tmp_path):
    """Two processes at a time that put, take and end jobs are killed at random moments, eight times."""
    path = tmp_path / "service.sqlite3"
    with_clients = Store(path)
    for client in CLIENTS:
        with_clients.add_client(client)
    with_clients.close()
    chance = random.Random(3)
    queued, leased, ended = {}, Counter(), Counter()
    first = {"a": 0, "b": 0}
    for _ in range(ROUNDS):
        writers = {name: start(path, name, number) for name, number in first.items()}
        try:
            told = {name: lines_until_killed(writer, chance.randrange(1, 100)) for name, writer in writers.items()}
        finally:
            for writer in writers.values():
                writer.kill()
                writer.wait()
        for name, lines in told.items():
            for what, *rest in lines:
                if what == "queued":
                    # What was not told is asked for again with the same key: it may be there already, or not.
                    first[name] = int(rest[0]) + 1
                    assert queued.setdefault((name, int(rest[0])), rest[1]) == rest[1]
                elif what == "leased":
                    leased[tuple(rest)] += 1
                else:
                    ended[rest[0]] += 1
        store = Store(path)  # checks the file
        assert store.check() == []
        for job in set(queued.values()):
            assert store.any_job(job) is not None, "lost"
        for job in ended:
            assert store.any_job(job).state in (State.DONE, State.CANCELLED)
        gone = store.reclaim(lambda owner: False, 1000)
        assert all(job.state in (State.QUEUED, State.CANCELLED) for job in gone)
        store.close()
    assert len(queued) > 50 and max(leased.values()) == max(ended.values()) == 1

    store = Store(path)
    while leases := store.lease("last", 64, 60):
        endings = [Ending(id=lease.job.id, number=lease.number, state=State.DONE) for lease in leases]
        for job in store.finish(endings):
            ended[job] += 1
            assert ended[job] == 1
    counts = store.counts()
    assert counts[State.QUEUED] == counts[State.RUNNING] == counts[State.FAILED] == 0
    # At most one request of each writer a round was under way and is not known of.
    assert len(queued) <= sum(counts.values()) <= len(queued) + 2
    assert store.check() == []
    store.close()
