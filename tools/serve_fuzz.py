"""Send the service thousands of broken, false, slow and hostile requests, and see that it neither falls nor leaks.

A server of its own runs in a process with a folder of its own. Each case is one connection. Exit status 1 if an answer
was a fault (5xx but 503 and 507), no answer came where one must, an error was no problem document of one line or told
of the server's folders; if the server died, a fault stands in its log, an upload was left behind, a file appeared
outside of the data folder, a job did not end, an honest pair is not reconstructed afterwards, or memory grew beyond
bounds. `--case N` sends one case alone and prints what was answered.
"""

import argparse
import json
import re
import socket
import struct
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from serve_fuzz_cases import Case, Cases, World, world_of
from serve_fuzz_server import Memory, server

from stereo_gpu.images import write_png
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_render import render_pair

SIZE = (320, 240)
FAST = {"profile": "fast", "disparities": [22, 40]}
TIMEOUT_S = 40.0  # for an answer; the server cuts off at less
ON_PURPOSE = (503, 507)
SERVER_MB = 400  # more than this a server that keeps nothing in memory does not need
WORKER_MB = 900
GROWTH_MB = 60  # of the server from a fifth of the cases to their end
STATUS = re.compile(rb"HTTP/1\.1 (\d{3}) ")
ENDED = ("done", "failed", "cancelled")


@dataclass
class Outcome:
    """What became of the cases."""

    answers: Counter[tuple[str, str]] = field(default_factory=Counter)  # by kind and status
    failures: list[str] = field(default_factory=list)


def speak(address: tuple[str, int], case: Case) -> bytes | None:
    """Say what the case says; gives all that was answered, or None where nothing was read on purpose."""
    with socket.create_connection(address, timeout=TIMEOUT_S) as connection:
        try:
            for piece in case.pieces:
                connection.sendall(piece)
                time.sleep(case.pause_s)
            if case.end == "half":
                connection.shutdown(socket.SHUT_WR)
        except OSError:  # it was cut off, perhaps with an answer
            pass
        if case.end == "reset":
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        if case.end in ("close", "reset"):
            return None
        answer = bytearray()
        with suppress(ConnectionError):
            while piece := connection.recv(1 << 16):
                answer += piece
        return bytes(answer)


def judge(case: Case, answer: bytes | None, secrets: tuple[bytes, ...]) -> tuple[str, str]:
    """The status of the last answer, and what is wrong with it; empty if nothing is."""
    if answer is None:
        return "left", ""
    found = list(STATUS.finditer(answer))
    found = [one for one in found if int(one[1]) >= 200]
    if not found:
        return "none", "" if case.silence else "no answer"
    for secret in (*secrets, b"Traceback", b"sqlite"):
        if secret in answer:
            return found[-1][1].decode(), f"the answer tells {secret!r}"
    for one, after in zip(found, [*found[1:], None], strict=True):
        status = int(one[1])
        if status >= 500 and status not in ON_PURPOSE:
            return str(status), f"{answer[one.start() :][:2000]!r}"
        wrong = _document(answer[one.start() : after.start() if after else None]) if status >= 400 else ""
        if wrong:
            return str(status), wrong
    return found[-1][1].decode(), ""


def _document(answer: bytes) -> str:
    """What is wrong with an error's answer as a problem document."""
    head, _, body = answer.partition(b"\r\n\r\n")
    if b"content-length: 0" in head.lower() or not body:
        return ""  # to HEAD
    if b"content-type: application/problem+json" not in head.lower():
        return f"no problem document: {answer[:300]!r}"
    try:
        document = json.loads(body)
        line = document["detail"]
    except (ValueError, KeyError, TypeError) as error:
        return f"a problem document that is none, {error}: {body[:300]!r}"
    if not isinstance(line, str) or "\n" in line or not 5 < len(line) < 600:
        return f"no line: {line!r:.300}"
    return ""


def attack(
    address: tuple[str, int],
    cases: Cases,
    count: int,
    secrets: tuple[bytes, ...],
    *,
    at_once: int = 16,
    told: Any = None,
) -> Outcome:
    """Send cases 0 to count - 1, some at once."""
    outcome = Outcome()

    def one(number: int) -> tuple[int, Case, str, str]:
        case = cases.make(number)
        try:
            status, wrong = judge(case, speak(address, case), secrets)
        except (OSError, TimeoutError) as error:
            status, wrong = "none", f"{type(error).__name__}: {error}"
        return number, case, status, wrong

    with ThreadPoolExecutor(at_once) as pool:
        for done, (number, case, status, wrong) in enumerate(pool.map(one, range(count)), 1):
            outcome.answers[case.kind, status] += 1
            if wrong:
                outcome.failures.append(f"case {number} ({case.kind}): {wrong}")
            if told is not None:
                told(done)
    return outcome


def settle(client: httpx.Client, seconds: float = 300) -> Counter[str]:
    """Wait until every job has ended; gives how many did in each way.

    Raises:
        AssertionError: some did not, or one failed for a reason that is no line.
    """
    until = time.monotonic() + seconds
    while any(
        client.get("/v1/jobs", params={"state": state, "limit": 1}).json()["items"] for state in ("queued", "running")
    ):
        assert time.monotonic() < until, f"some jobs have not ended after {seconds:g} s"
        time.sleep(0.1)
    ends: Counter[str] = Counter()
    page = "/v1/jobs?limit=200"
    while page:
        answer = client.get(page).json()
        for job in answer["items"]:
            assert job["state"] in ENDED
            assert (job["state"] == "failed") == (job["error"] is not None), job
            assert "\n" not in (job["error"] or ""), job["error"]
            assert all(
                re.fullmatch(r"(left|right|mask)(\d{3})?\.(png|jpg|webp|tif|bmp|pnm)", one["name"])
                for one in job["inputs"]
            )
            ends[job["state"]] += 1
        page = answer["next"]
    return ends


def prepare(client: httpx.Client, other: str, folder: Path) -> World:
    """Make what the cases refer to: a rig, a job that is done, an outline."""
    scene = build_scene(SIZE)
    left, right = (
        write_png(folder / f"{number}.png", one).read_bytes() for number, one in enumerate(render_pair(scene))
    )
    rig_file = scene.rig.save(folder / "rig.json") or folder / "rig.json"
    rig_bytes = Path(rig_file).read_bytes()
    rig = _ok(client.post("/v1/rigs", files={"file": rig_bytes}))["id"]
    files = {"left": left, "right": right}
    job = reconstruct_one(client, rig, files)
    outline = client.post("/v1/outlines", files=files, data={"rig": rig})
    name = outline.json()["id"] if outline.status_code == 201 else "0" * 32
    return world_of(client.headers["authorization"].split()[1], other, rig, job, name, left, right, [rig_bytes])


def reconstruct_one(client: httpx.Client, rig: str, files: dict[str, bytes]) -> str:
    """Have an honest pair reconstructed; gives its id.

    Raises:
        AssertionError: it was not.
    """
    data = {"rig": rig, "options": json.dumps(FAST)}
    for _ in range(100):
        answer = client.post("/v1/jobs", files=files, data=data)
        if answer.status_code != 429:
            break
        time.sleep(0.5)
    job = _ok(answer)["id"]
    until = time.monotonic() + 300
    while (view := _ok(client.get(f"/v1/jobs/{job}")))["state"] not in ENDED:
        assert time.monotonic() < until, view
        time.sleep(0.05)
    assert view["state"] == "done", view
    model = client.get(f"/v1/jobs/{job}/files/model.glb")
    assert model.status_code == 200
    assert model.content.startswith(b"glTF")
    return str(job)


def _ok(answer: httpx.Response) -> Any:
    assert answer.is_success, f"{answer.status_code}: {answer.text}"
    return answer.json()


def listing(folder: Path) -> set[Path]:
    """All that is in a folder."""
    return set(folder.rglob("*"))


def run(count: int, seed: int, only: int | None) -> list[str]:
    """Start a server, attack it, and look at what is left; gives what went wrong."""
    with tempfile.TemporaryDirectory() as kept, tempfile.TemporaryDirectory() as around:
        home, log = Path(around), Path(kept) / "log"
        with server(home, log) as (process, token, other, port):
            base = f"http://127.0.0.1:{port}"
            with httpx.Client(base_url=base, headers={"Authorization": f"Bearer {token}"}, timeout=60) as client:
                world = prepare(client, other, Path(kept))
                cases = Cases(world, seed)
                if only is not None:
                    case = cases.make(only)
                    print(case.kind, case.end, [piece[:600] for piece in case.pieces[:3]])
                    print(speak(("127.0.0.1", port), case))
                    return []
                before = {path for path in listing(home) if home / "data" not in path.parents}
                memory = Memory(process.pid)
                began = time.monotonic()

                def told(done: int) -> None:
                    if done % 50 == 0:
                        memory.look()
                    if done % 500 == 0:
                        print(
                            f"{done} cases, {time.monotonic() - began:.0f} s, server {memory.server[-1]:.0f} MB",
                            flush=True,
                        )

                memory.look()
                outcome = attack(("127.0.0.1", port), cases, count, (str(home).encode(), token.encode()), told=told)
                failures = outcome.failures
                table(outcome)
                try:
                    print("jobs:", dict(settle(client)))
                    reconstruct_one(client, world.rig, {"left": world.pictures["png"], "right": world.right})
                except (AssertionError, httpx.HTTPError) as error:
                    failures.append(f"afterwards: {error!r:.500}")
                memory.look()
                if process.poll() is not None:
                    failures.append(f"the server ended with status {process.returncode}")
                time.sleep(0.5)
                failures += [f"left behind: {path}" for path in listing(home / "data" / "uploads")]
                outside = {path for path in listing(home) if home / "data" not in path.parents} - before
                failures += [f"outside of the data folder: {path}" for path in outside if not _is_scratch(path, home)]
        said = log.read_text(errors="replace")
        failures += [
            f"in the log: {said[at.start() :][:2000]}" for at in re.finditer(r"Traceback|\n(ERROR|CRITICAL)", said)
        ][:5]
        if process.returncode:
            failures.append(f"after SIGTERM it ended with status {process.returncode}")
        fifth = memory.server[len(memory.server) // 5]
        print(
            f"server {memory.server[0]:.0f} MB at first, {fifth:.0f} after a fifth, {max(memory.server):.0f} at most,"
            f" {memory.server[-1]:.0f} at the end; largest worker {max(memory.workers):.0f} MB at most"
        )
        if max(memory.server) > SERVER_MB or max(memory.workers) > WORKER_MB or memory.server[-1] - fifth > GROWTH_MB:
            failures.append("memory grew beyond bounds")
        return failures


def _is_scratch(path: Path, home: Path) -> bool:
    """Caches of compiled kernels and the workers' temporary folders, which are not from any request."""
    return path.relative_to(home).parts[0] in (".cache", ".nv") or path.name.startswith(("tmp", "pocl"))


def table(outcome: Outcome) -> None:
    """Print how often each kind was answered how."""
    statuses = sorted({status for _, status in outcome.answers})
    print("kind".ljust(12), *(status.rjust(5) for status in statuses))
    for kind in sorted({kind for kind, _ in outcome.answers}):
        print(kind.ljust(12), *(str(outcome.answers[kind, status] or "").rjust(5) for status in statuses))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5000, help="cases (%(default)s)")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--case", type=int, help="send this one alone")
    options = parser.parse_args()
    wrong = run(options.count, options.seed, options.case)
    for line in wrong[:40]:
        print(line)
    print(f"{len(wrong)} failures" if wrong else "nothing went wrong")
    sys.exit(bool(wrong))
