"""The server that tools/serve_fuzz mistreats: a process of its own, with smaller limits and shorter waits."""

import logging
import subprocess
import sys
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

from stereo_gpu.service.server import listen, serve
from stereo_gpu.service.service import Service
from stereo_gpu.service.settings import Settings


@contextmanager
def server(home: Path, log: Path) -> Any:
    """The service in a process of its own, as a person would start it but for smaller limits and shorter waits."""
    with log.open("wb") as held:
        process = subprocess.Popen(
            [sys.executable, str(Path(__file__).resolve()), str(home / "data")],
            cwd=home,
            stdout=subprocess.PIPE,
            stderr=held,
            env={"PATH": "/usr/bin:/bin", "HOME": str(home), "TMPDIR": str(home)},
        )
        try:
            assert process.stdout is not None
            token, other, port = process.stdout.readline().decode().split()
            yield process, token, other, int(port)
        finally:
            process.terminate()
            process.wait(60)


def serve_here(data: Path) -> None:
    """Run the server; prints two clients' tokens and the port."""
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(levelname)s %(name)s %(message)s")
    settings = Settings(
        data=data,
        port=0,
        file_mb=2,
        request_mb=5,
        megapixels=4.0,
        queue_limit=300,
        job_seconds=60.0,
        idle_seconds=3.0,
        upload_seconds=12.0,
        spare_gb=0.2,
    )
    listener = listen(settings)
    service = Service.open(settings)
    print(service.new_token, service.store.add_client("other"), listener.getsockname()[1], flush=True)
    serve(service, settings, listener)


class Memory:
    """Resident memory of a server and of its workers, MB."""

    def __init__(self, pid: int) -> None:
        self._process = psutil.Process(pid)
        self.server: list[float] = []
        self.workers: list[float] = []

    def look(self) -> None:
        """Note it."""
        self.server.append(self._process.memory_info().rss / 2**20)
        largest = 0.0
        for child in self._process.children(recursive=True):
            with suppress(psutil.Error):
                largest = max(largest, child.memory_info().rss / 2**20)
        self.workers.append(largest)


if __name__ == "__main__":
    serve_here(Path(sys.argv[1]))
