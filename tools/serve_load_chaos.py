"""Jobs while everything is killed: nothing is lost, nothing is done twice, nothing is half."""

from __future__ import annotations

import argparse
import hashlib
import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bench_chain import DISPARITIES, FACES, SMALLEST, make_pairs
from serve_load_client import Client
from serve_load_server import Server

from stereo_gpu.config import MeshOptions
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.rig import Rig
from stereo_gpu.service.data.audit import audit
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.store import Store

NAMES = ("anna", "bert", "cleo", "dora")  # clients with tokens of their own, besides the owner
AT_ONCE = 8  # jobs that a client has under way
SERVER_KILLS = 3
TRIES = 8  # a job may lose: here workers die every few seconds, and three in a row are bound to hit one job of 1,000
OFTEN_S = 0.5  # how often a client asks


@dataclass
class Seen:
    """What clients have seen of the jobs; `ended` and sha256 of each by its key."""

    jobs: dict[str, tuple[Client, str, dict[str, Any]]] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)
    done: int = 0
    changing: threading.Lock = field(default_factory=threading.Lock)


def service_options(unwrap: str) -> dict[str, Any]:
    """Of every job, as JSON; `mesh_options` are the same for the library."""
    return {
        "profile": "fast",
        "disparities": [SMALLEST, DISPARITIES],
        "mesh": {"faces": FACES, "unwrap": unwrap},
        "files": "model",
    }


def load_in_chaos(options: argparse.Namespace, folder: Path) -> list[str]:
    """Run it; gives the promises that were broken."""
    rig = make_pairs(folder / "pairs", options.pairs)
    rig.save(folder / "rig.json")
    expected = _library_models(folder, rig, options)
    print(f"{options.pairs} pairs, and their models by the library", flush=True)
    backend = [] if options.backend is None else ["--backend", options.backend]
    with Server(folder / "data", "--tries", str(TRIES), "--spare-gb", "0", *backend) as server:
        return _run(server, folder, expected, options)


def _run(server: Server, folder: Path, expected: list[str], options: argparse.Namespace) -> list[str]:
    seen, over = Seen(), threading.Event()
    tokens = [server.token, *(server.new_token(name) for name in NAMES)]
    rigs = [Client(server.url, token).add_rig(folder / "rig.json") for token in tokens]
    start = time.perf_counter()
    killer = threading.Thread(target=_kill, args=(server, seen, over, options))
    killer.start()
    with ThreadPoolExecutor(options.clients) as pool:
        running = [
            pool.submit(
                _be_client,
                number,
                Client(server.url, tokens[number % 5]),
                rigs[number % 5],
                folder,
                expected,
                seen,
                options,
            )
            for number in range(options.clients)
        ]
        for each in running:
            if each.exception() is not None:
                seen.broken.append(f"a client gave up: {each.exception()}")
    over.set()
    killer.join()
    taken = time.perf_counter() - start
    seen.broken += _look_again(seen, expected, options.jobs)
    sent = sum(client.tries for client in {id(client): client for client, _, _ in seen.jobs.values()}.values())
    status = server.stop()
    if status != 0:
        seen.broken.append(f"the server ended with status {status}")
    twice = [id for id, times in server.endings().items() if times > 1]
    seen.broken += [f"job {id} ended more than once" for id in twice]
    seen.broken += _check_table(folder / "data", options.jobs)
    tries = [job["tries"] for _, _, job in seen.jobs.values()]
    print(f"{seen.done} of {options.jobs} jobs done in {taken:.0f} s by {options.clients} clients, {sent} requests")
    print(f"jobs that lost a try: {sum(each > 1 for each in tries)}; most tries of one: {max(tries, default=0)}")
    return seen.broken


def _library_models(folder: Path, rig: Rig, options: argparse.Namespace) -> list[str]:
    """The sha256 of model.glb of each pair."""
    mesh = MeshOptions(faces=FACES, unwrap=options.unwrap)
    found = []
    for number in range(options.pairs):
        left, right = (folder / "pairs" / f"{side}{number:04d}.png" for side in ("left", "right"))
        result = reconstruct(
            left, right, rig, profile="fast", disparities=(SMALLEST, DISPARITIES), mesh=mesh, backend=options.backend
        )
        result.save(folder / "library", files="model")
        found.append(hashlib.sha256((folder / "library" / "model.glb").read_bytes()).hexdigest())
    return found


def _be_client(
    number: int, client: Client, rig: str, folder: Path, expected: list[str], seen: Seen, options: argparse.Namespace
) -> None:
    """Post this client's share of the jobs, a few at a time, and see each to its end."""
    asked = service_options(options.unwrap)
    waiting: list[tuple[str, str, int]] = []
    for index in range(number, options.jobs, options.clients):
        pair, key = index % options.pairs, f"job-{index}"
        pictures = [(folder / "pairs" / f"{side}{pair:04d}.png").read_bytes() for side in ("left", "right")]
        job = client.post(*pictures, rig, asked, key)
        if index % 10 == 0:  # as a program that never got the answer
            again = client.post(*pictures, rig, asked, key)
            if again["id"] != job["id"]:
                seen.broken.append(f"{key} is job {job['id']} and job {again['id']}")
        waiting.append((key, job["id"], pair))
        if len(waiting) >= AT_ONCE:
            _see_to_its_end(client, *waiting.pop(0), expected, seen)
    for each in waiting:
        _see_to_its_end(client, *each, expected, seen)


def _see_to_its_end(client: Client, key: str, id: str, pair: int, expected: list[str], seen: Seen) -> None:
    while (job := client.job(id))["state"] in ("queued", "running"):
        time.sleep(OFTEN_S)
    wrong = []
    if job["state"] == "done":
        content, told = client.model(id)
        sha256 = hashlib.sha256(content).hexdigest()
        if sha256 != expected[pair] or told != sha256:
            wrong.append(f"{key} ({id}): model.glb differs from the library's of pair {pair}")
    else:
        wrong.append(f"{key} ({id}) is {job['state']}: {job['error']}")
    with seen.changing:
        seen.jobs[key] = (client, id, job)
        seen.done += job["state"] == "done"
        seen.broken += wrong
        if seen.done % 100 == 0:
            print(f"{seen.done} done", flush=True)


def _kill(server: Server, seen: Seen, over: threading.Event, options: argparse.Namespace) -> None:
    """Kill workers at random, and the server after each quarter of the jobs."""
    choice = random.Random(options.seed)
    workers = servers = 0
    while not over.wait(choice.uniform(0.2, 2 * options.kill_every - 0.2)):
        if servers < SERVER_KILLS and seen.done >= (servers + 1) * options.jobs // (SERVER_KILLS + 1):
            server.kill()
            servers += 1
            try:
                server.start()
            except Exception as error:
                seen.broken.append(f"the server does not come back: {error}")
                return
        else:
            workers += server.kill_one(choice)
    print(f"killed: {workers} workers, the server {servers} times", flush=True)
    if servers < SERVER_KILLS and options.jobs >= 100:
        seen.broken.append(f"the server was killed {servers} times only: give more jobs")


def _look_again(seen: Seen, expected: list[str], jobs: int) -> list[str]:
    """Every job must still be what it was when it ended."""
    broken = []
    if len(seen.jobs) != jobs:
        broken.append(f"{len(seen.jobs)} jobs were seen to their end, of {jobs}")
    for key, (client, id, before) in seen.jobs.items():
        now = client.job(id)
        if (now["state"], now["ended"], now["tries"]) != (before["state"], before["ended"], before["tries"]):
            broken.append(f"{key} ({id}) ended again: {before['state']} {before['ended']}, then {now['ended']}")
    return broken


def _check_table(data: Path, jobs: int) -> list[str]:
    """What is wrong with the table and the folders of a service that has ended."""
    folders = Folders(data)
    store = Store(folders.database, create=False)
    try:
        broken = [f"the table: {line}" for line in audit(store, folders)]
        counts = {str(state): count for state, count in store.counts().items() if count}
    finally:
        store.close()
    if counts != {"done": jobs}:
        broken.append(f"the table has {counts}, of {jobs} jobs")
    broken += [f"left over: {path}" for path in (*data.glob("uploads/*"), *data.glob("jobs/*/try-*"))]
    return broken
