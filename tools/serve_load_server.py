"""A service in a process of its own, for the tools that load it: started, asked, killed and started again."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import httpx
import psutil

from stereo_gpu.errors import StereoError

PROGRAM = [sys.executable, "-c", "import sys; from stereo_gpu.cli import main; sys.exit(main())"]
START_S = 120.0
STOP_S = 60.0


class Server:
    """`stereo-gpu serve` on a data folder.

    Attributes:
        url: where it answers.
        token: of its first client.
        log: the file of its JSON lines, of all its starts.
    """

    def __init__(self, data: Path, *options: str) -> None:
        self.data, self.log = data, data.parent / "serve.log"
        self.url = ""
        self._options = options
        self._port = 0
        self._process: subprocess.Popen[str] | None = None
        self.start()
        self.token = (data / "token").read_text().strip()

    def start(self) -> None:
        """Start it and wait until it is ready; on the port that it had before."""
        command = [*PROGRAM, "serve", "--data", str(self.data), "--port", str(self._port), "--json-logs"]
        with self.log.open("a") as log:
            self._process = subprocess.Popen(
                [*command, *self._options], stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True
            )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.startswith("open "):
            raise StereoError(f"the server does not start: {self.log.read_text()[-500:]}")
        self.url = line.split()[1].partition("/#")[0]
        self._port = int(self.url.rpartition(":")[2])
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            try:
                if httpx.get(f"{self.url}/readyz").status_code == 200:
                    return
            except httpx.HTTPError:
                pass
            time.sleep(0.1)
        self.kill()
        raise StereoError(f"the server is not ready after {START_S:g} s")

    def kill(self) -> None:
        """SIGKILL, and nothing else."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None and self._process.poll() is None:
            self.kill()

    def stop(self) -> int:
        """SIGTERM; its exit status."""
        assert self._process is not None
        self._process.send_signal(signal.SIGTERM)
        return self._process.wait(STOP_S)

    def children(self) -> list[psutil.Process]:
        """All processes that it has started."""
        assert self._process is not None
        try:
            return psutil.Process(self._process.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return []

    def kill_one(self, choice: random.Random) -> bool:
        """SIGKILL one of its processes at random; whether there was one."""
        found = self.children()
        if not found:
            return False
        try:
            os.kill(choice.choice(found).pid, signal.SIGKILL)
        except ProcessLookupError:
            return False
        return True

    def memory(self) -> tuple[float, float]:
        """Resident MB of the server, and of its largest process."""
        assert self._process is not None
        sizes = []
        for process in self.children():
            try:
                sizes.append(process.memory_info().rss / 1e6)
            except psutil.NoSuchProcess:
                continue
        return psutil.Process(self._process.pid).memory_info().rss / 1e6, max(sizes, default=0.0)

    def cpu(self) -> tuple[float, float]:
        """Seconds of the processor that the server itself, and its processes, have had so far."""
        assert self._process is not None
        own = psutil.Process(self._process.pid).cpu_times()
        theirs = 0.0
        for process in self.children():
            try:
                used = process.cpu_times()
            except psutil.NoSuchProcess:
                continue
            theirs += used.user + used.system
        return own.user + own.system, theirs

    def new_token(self, name: str) -> str:
        """A token for another client."""
        made = subprocess.run(
            [*PROGRAM, "serve", "--data", str(self.data), "--new-token", name], capture_output=True, text=True
        )
        if made.returncode:
            raise StereoError(made.stderr)
        return made.stdout.strip()

    def endings(self) -> dict[str, int]:
        """How often the log tells of each job that it ended."""
        told: dict[str, int] = {}
        for line in self.log.read_text().splitlines():
            try:
                entry: dict[str, Any] = json.loads(line)
            except ValueError:  # the last line of a server that was killed
                continue
            if "job" in entry and entry["message"].partition(":")[0] in ("done", "failed", "cancelled"):
                told[entry["job"]] = told.get(entry["job"], 0) + 1
        return told
