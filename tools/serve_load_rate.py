"""What the service makes of a machine beside what `batch` makes of it, on the same pairs, one after the other."""

from __future__ import annotations

import argparse
import shutil
import statistics
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any

from bench_chain import DISPARITIES, FACES, PROGRAM, SMALLEST, make_pairs, run_timed
from serve_load_chaos import service_options
from serve_load_client import Client
from serve_load_server import Server

from stereo_gpu.errors import StereoError

LEAST_SHARE = 0.85  # of the rate of batch
MOST_OVERHEAD_S = 0.015  # a job, of the processor's time
MOST_GROWTH_MB = 30.0  # of the server, and of its largest process, over the second half of the time
ALONE = 40  # jobs sent one after another
QUICK_S = 0.01  # how often is asked for one that is alone
SLOW_S = 1.0  # and for all: a look at both lists costs the server 3 ms
WATCH_S = 1.0  # how often memory is looked at
TENTHS = 10  # so many of these are shown


def measure_rate(options: argparse.Namespace, folder: Path) -> list[str]:
    """Run it; gives the promises that were broken."""
    rig = make_pairs(folder / "pairs", options.pairs)
    rig.save(folder / "rig.json")
    backend = [] if options.backend is None else ["--backend", options.backend]
    batch_rate, batch_cpu = _batch(options, folder, backend)
    with Server(folder / "data", "--spare-gb", "0", *backend) as server:
        broken = _measure(server, folder, options, batch_rate, batch_cpu)
        server.stop()
    return broken


def _measure(
    server: Server, folder: Path, options: argparse.Namespace, batch_rate: float, batch_cpu: float
) -> list[str]:
    client = Client(server.url, server.token)
    id = client.add_rig(folder / "rig.json")
    pairs = [
        tuple((folder / "pairs" / f"{side}{number:04d}.png").read_bytes() for side in ("left", "right"))
        for number in range(options.pairs)
    ]
    asked = service_options(options.unwrap)
    broken = []
    _post_all(server, pairs, id, asked, options.pairs, options.clients)  # the check of the rig, and all caches
    rate, cpu, sizes = _full_load(server, pairs, id, asked, options)
    print(f"service: {rate:.2f} jobs/s, {rate / batch_rate:.2f} of batch's rate")
    print(f"CPU a job: {cpu:.4f} s, batch {batch_cpu:.4f} s, {1000 * (cpu - batch_cpu):+.1f} ms")
    if rate < LEAST_SHARE * batch_rate:
        broken.append(f"its rate is {rate / batch_rate:.2f} of batch's, not {LEAST_SHARE:g}")
    if cpu - batch_cpu > MOST_OVERHEAD_S:
        more = f"{1000 * (cpu - batch_cpu):.1f} ms more than in batch, not {1000 * MOST_OVERHEAD_S:g}"
        broken.append(f"a job costs {more}")
    broken += _tell_memory(sizes)
    _tell_alone(client, pairs, id, asked)
    _half_load(server, pairs, id, asked, rate / 2, min(options.jobs, 200))
    return broken


def _batch(options: argparse.Namespace, folder: Path, backend: list[str]) -> tuple[float, float]:
    """Pairs a second of `batch`, and CPU seconds a pair: what is beyond a run of two pairs, so that no start counts."""
    few = folder / "few"
    few.mkdir()
    for number in range(2):
        for side in ("left", "right"):
            (few / f"{side}{number:04d}.png").symlink_to(folder / "pairs" / f"{side}{number:04d}.png")
    ours = ["--rig", str(folder / "rig.json"), "--profile", "fast", "--disparities", f"{SMALLEST},{DISPARITIES}"]
    ours += ["--faces", str(FACES), "--unwrap", options.unwrap, *backend]
    timings = []
    for name, pairs in (("warm", few), ("start", few), ("all", folder / "pairs")):
        timings.append(run_timed([*PROGRAM, "batch", str(pairs), *ours, "--out", str(folder / name)]))
        shutil.rmtree(folder / name)
    _, start, whole = timings
    more = options.pairs - 2
    rate, cpu = more / (whole.wall - start.wall), (whole.cpu - start.cpu) / more
    print(f"batch: {rate:.2f} pairs/s without its start, {options.pairs / whole.wall:.2f} with it", flush=True)
    return rate, cpu


def _post_all(
    server: Server, pairs: list[tuple[bytes, ...]], rig: str, asked: dict[str, Any], jobs: int, clients: int
) -> list[dict[str, Any]]:
    """Post so many jobs from several clients, and wait for all; gives them as they ended."""

    def post(number: int) -> list[str]:
        client = Client(server.url, server.token)
        return [
            client.post(*pairs[index % len(pairs)], rig, asked, None)["id"] for index in range(number, jobs, clients)
        ]

    with ThreadPoolExecutor(clients) as pool:
        ids = {id for found in pool.map(post, range(clients)) for id in found}
    client = Client(server.url, server.token)
    while any(client.ask("GET", f"/v1/jobs?state={state}&limit=1").json()["items"] for state in ("queued", "running")):
        time.sleep(SLOW_S)
    return [job for job in client.jobs() if job["id"] in ids]


def _full_load(
    server: Server, pairs: list[tuple[bytes, ...]], rig: str, asked: dict[str, Any], options: argparse.Namespace
) -> tuple[float, float, list[tuple[float, float]]]:
    """Jobs a second, CPU seconds a job of server and workers, and their memory at equal times on the way."""
    sizes, over = [], threading.Event()

    def watch() -> None:
        while not over.wait(WATCH_S):
            sizes.append(server.memory())

    watcher = threading.Thread(target=watch)
    began, start = sum(server.cpu()), time.perf_counter()
    watcher.start()
    try:
        jobs = _post_all(server, pairs, rig, asked, options.jobs, options.clients)
    finally:
        taken = time.perf_counter() - start
        over.set()
        watcher.join()
    lost = [job for job in jobs if job["state"] != "done"]
    if lost:
        raise StereoError(f"job {lost[0]['id']} is {lost[0]['state']}: {lost[0]['error']}")
    cpu = (sum(server.cpu()) - began) / len(jobs)
    return len(jobs) / taken, cpu, sizes[:: max(1, len(sizes) // TENTHS)]


def _tell_memory(sizes: list[tuple[float, float]]) -> list[str]:
    broken = []
    for name, column in (("server", 0), ("largest process", 1)):
        values = [size[column] for size in sizes]
        print(f"memory of the {name}, MB, at each tenth of the time: {', '.join(f'{value:.0f}' for value in values)}")
        if values[-1] - values[len(values) // 2] > MOST_GROWTH_MB:
            broken.append(
                f"the {name} grows: {values[len(values) // 2]:.0f} MB at half of the time, then {values[-1]:.0f}"
            )
    return broken


def _tell_alone(client: Client, pairs: list[tuple[bytes, ...]], rig: str, asked: dict[str, Any]) -> None:
    """One job at a time: what passes from the request to the end, beside what the worker took."""
    over, whole = [], []
    for number in range(ALONE):
        start = time.perf_counter()
        id = client.post(*pairs[number % len(pairs)], rig, asked, None)["id"]
        while (job := client.job(id))["state"] in ("queued", "running"):
            time.sleep(QUICK_S)
        whole.append(time.perf_counter() - start)
        over.append(whole[-1] - job["seconds"]["total"])
    print(
        f"one job at a time: {1000 * statistics.median(whole):.0f} ms from request to end,"
        f" {1000 * statistics.median(over):.0f} ms of it outside the worker (asked every {1000 * QUICK_S:g} ms)"
    )


def _half_load(
    server: Server, pairs: list[tuple[bytes, ...]], rig: str, asked: dict[str, Any], rate: float, jobs: int
) -> None:
    """Jobs at a steady rate; from when each was accepted to when it ended, by the service's clock."""
    client = Client(server.url, server.token)
    start, ids = time.perf_counter(), []
    for number in range(jobs):
        time.sleep(max(0.0, start + number / rate - time.perf_counter()))
        ids.append(client.post(*pairs[number % len(pairs)], rig, asked, None)["id"])
    for id in ids[-8:]:
        while client.job(id)["state"] in ("queued", "running"):
            time.sleep(SLOW_S)
    wanted = set(ids)
    taken = sorted(_moment(job["ended"]) - _moment(job["created"]) for job in client.jobs() if job["id"] in wanted)
    p50, p95 = (1000 * taken[min(len(taken) - 1, int(share * len(taken)))] for share in (0.5, 0.95))
    print(f"latency at half load, {rate:.2f} jobs/s, {len(taken)} jobs: p50 {p50:.0f} ms, p95 {p95:.0f} ms")


def _moment(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()
