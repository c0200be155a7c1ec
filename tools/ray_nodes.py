"""Kill workers and a whole node of a Ray cluster amid a batch, and see that nothing is lost; time what Ray costs.

Three Ray nodes run on this machine: a head that does no jobs, and two of one core each. The same pairs are done by two
local processes, by the two nodes undisturbed, and by the two nodes while a worker's process is killed every so often,
then an actor, then a node with every process of it at once, after which a new node joins. Every model must be there
and equal, byte for byte, what the library makes of the pair here. Then jobs that do nothing are timed on both engines.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import random
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
from bench_chain import DISPARITIES, FACES, SIZE, SMALLEST, make_pairs
from empty_jobs import STAGES, nothing, tell_stages

from stereo_gpu.batch import reconstruct_batch
from stereo_gpu.batching.pair_list import ListedPair, list_pairs
from stereo_gpu.bench.machine import describe_machine
from stereo_gpu.config import MeshOptions
from stereo_gpu.engines.choose import open_executor
from stereo_gpu.engines.executor import Work
from stereo_gpu.engines.ray_connection import connect, release
from stereo_gpu.errors import StereoError
from stereo_gpu.rig import Rig

OPTIONS: dict[str, Any] = {
    "profile": "fast",
    "disparities": (SMALLEST, DISPARITIES),
    "mesh": MeshOptions(faces=FACES, unwrap="view"),
}
EVERY = 25  # pairs after which a worker's process is killed
STORE = 100 << 20  # bytes, of each node's object store
UP_S = 60.0
EMPTY_JOBS = 2000


class Node:
    """A Ray node: its processes, all of which `kill` ends at once, as where a machine fails."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        command = [str(Path(sys.executable).with_name("ray")), "start", "--block", *arguments]
        command += ["--object-store-memory", str(STORE), "--disable-usage-stats"]
        with (folder / f"{secrets.token_hex(4)}.log").open("w") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log, stdin=subprocess.DEVNULL)

    def processes(self, named: str = "") -> list[psutil.Process]:
        """Those whose command line holds `named`."""
        found = []
        with contextlib.suppress(psutil.Error):
            root = psutil.Process(self._process.pid)
            for process in (root, *root.children(recursive=True)):
                with contextlib.suppress(psutil.Error):
                    if named in " ".join(process.cmdline()):
                        found.append(process)
        return found

    def kill(self) -> None:
        """End every process of it by SIGKILL."""
        for process in self.processes():
            with contextlib.suppress(psutil.Error):
                process.kill()
        self._process.wait()


def main() -> int:
    """Run it all; exit status 1 where a pair was lost or differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=200, help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="which worker is killed each time (%(default)s)")
    options = parser.parse_args()
    try:
        with tempfile.TemporaryDirectory(prefix="nodes", dir="/tmp") as folder:  # the names of Ray's sockets are long
            return _run(Path(folder), options.pairs, random.Random(options.seed))
    except StereoError as error:
        print(error, file=sys.stderr)
        return 1


def _run(folder: Path, count: int, chance: random.Random) -> int:
    rig = make_pairs(folder / "pairs", count)
    pairs = list_pairs(folder / "pairs")
    print(f"{SIZE[0]} x {SIZE[1]} x {DISPARITIES}, fast, about {FACES} triangles; {describe_machine()['processor']};")
    print(f"{len(os.sched_getaffinity(0))} cores, load average before it began: {os.getloadavg()[0]:.1f}\n")
    print("| batch | pairs | pairs/s | kills | failed | wrong |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    _batch("warm", pairs[:4], rig, folder, workers=2)  # so that no compiler runs while a clock does
    expected = _batch("two local processes", pairs, rig, folder, workers=2)
    os.environ.update(RAY_TMPDIR=str(folder), RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=secrets.token_urlsafe(32))
    (folder / "ray").mkdir()
    with _cluster(folder) as (address, start_node):
        nodes = [start_node(), start_node()]
        distant = {"engine": "ray", "address": address, "workers": 2}
        calm = _batch("two Ray nodes", pairs, rig, folder, expected, **distant)
        lost: list[str] = []
        harm = _harm(nodes, start_node, chance, count, lost)
        hurt = _batch("the same, killed again and again", pairs, rig, folder, expected, harm, lost, **distant)
        print(f"\nkilled: {', '.join(lost)}\n")
        _overhead(address)
    return 0 if expected == calm == hurt and len(expected) == count else 1


def _batch(
    name: str,
    pairs: list[ListedPair],
    rig: Rig,
    folder: Path,
    expected: dict[str, str] | None = None,
    harm: Callable[[int], None] | None = None,
    lost: list[str] | None = None,
    **where: Any,
) -> dict[str, str]:
    """Make all models, and print a line of the table; returns the sha256 of each."""
    out, failed, first = folder / "out", 0, 0.0
    for done, outcome in enumerate(reconstruct_batch(pairs, rig, out, **OPTIONS, **where), 1):
        if done == 1:
            first = time.perf_counter()
        if outcome.error is not None:
            failed += 1
            print(f"{outcome.pair.name} failed: {outcome.error}", file=sys.stderr)
        if harm is not None:
            harm(done)
    rate = (len(pairs) - 1) / (time.perf_counter() - first)
    made = {model.parent.name: hashlib.sha256(model.read_bytes()).hexdigest() for model in out.glob("*/model.glb")}
    shutil.rmtree(out)
    wrong = sum(made.get(pair, "") != digest for pair, digest in (made if expected is None else expected).items())
    if name != "warm":
        print(f"| {name} | {len(made)} | {rate:.2f} | {len(lost or ())} | {failed} | {wrong} |", flush=True)
    return made


def _harm(
    nodes: list[Node], start_node: Callable[[], Node], chance: random.Random, count: int, lost: list[str]
) -> Callable[[int], None]:
    """What is done to the nodes once so many pairs are done."""

    def harm(done: int) -> None:
        if done == count // 2:
            nodes.pop(0).kill()
            lost.append(f"a node after {done} pairs")
        elif done == 3 * count // 4:
            nodes.append(start_node())
        elif done == count // 4:
            (actor, *_) = [process for node in nodes for process in node.processes("ray::RayActor")]
            actor.kill()
            lost.append(f"an actor after {done}")
        elif done % EVERY == 0 and done < count:
            workers = [process for node in nodes for process in node.processes("engines/worker.py")]
            if workers:
                os.kill(chance.choice(workers).pid, signal.SIGKILL)
                lost.append(f"a worker after {done}")

    return harm


@contextlib.contextmanager
def _cluster(folder: Path) -> Iterator[tuple[str, Callable[[], Node]]]:
    """A head that does no jobs: its address, and what starts a node beside it."""
    with socket.socket() as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    common = ["--num-gpus", "0", "--num-cpus"]
    head = Node(folder, "--head", "--port", str(port), "--include-dashboard", "false", *common, "0")
    started = [head]
    address = f"{socket.gethostbyname(socket.gethostname())}:{port}"
    deadline = time.monotonic() + UP_S
    while True:
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", port), 1.0).close()
            break
        if time.monotonic() > deadline:
            raise StereoError(f"Ray did not start in {UP_S:g} s")
        time.sleep(0.1)

    connect(address, 0)  # while the head is the only node here: this process must not hang on one that is killed

    def start_node() -> Node:
        known = len(_alive())
        node = Node(folder, "--address", address, *common, "1")
        started.append(node)
        late = time.monotonic() + UP_S
        while len(_alive()) <= known and time.monotonic() < late:
            time.sleep(0.1)
        return node

    try:
        yield address, start_node
    finally:
        release()
        for node in reversed(started):
            node.kill()


def _alive() -> list[str]:
    """The nodes that do jobs and are there, as far as the head knows."""
    import ray

    return [node["NodeID"] for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]


def _overhead(address: str) -> None:
    """Time jobs that do nothing: what an engine takes for itself."""
    print(f"| engine | empty job, ms | CPU ms of the caller | one that tells {STAGES} stages, ms | CPU ms |")
    print("| --- | ---: | ---: | ---: | ---: |")
    for engine, where in (("local", {}), ("ray", {"address": address})):
        figures = []
        for task, tells in ((nothing, False), (tell_stages, True)):
            executor = open_executor(engine, Work(task=task, tells=tells), workers=1, **where)
            try:
                first = executor.submit((0,)).answer.result()
                if first.error is not None:
                    raise first.error
                start, cpu = time.perf_counter(), time.process_time()
                told: Callable[[str], None] | None = (lambda stage: None) if tells else None
                jobs = [executor.submit((number,), tell=told) for number in range(EMPTY_JOBS)]
                assert [job.answer.result().result for job in jobs] == list(range(EMPTY_JOBS))
                figures += [time.perf_counter() - start, time.process_time() - cpu]
            finally:
                executor.close()
        print(f"| {engine} | " + " | ".join(f"{1000 * seconds / EMPTY_JOBS:.2f}" for seconds in figures) + " |")


if __name__ == "__main__":
    sys.exit(main())
