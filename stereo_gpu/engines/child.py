"""A process with a group of its own, and the pipes to it: started, signalled, and buried with all that it started."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO

from stereo_gpu.errors import WorkerError

_SCRIPT = Path(__file__).with_name("worker.py")
_PIPE_BYTES = 1 << 20  # the most that Linux gives anybody: fewer turns for a result of 10 MB


class Child:
    """The process of one worker, as long as it lives; worker.py says what goes through the pipes.

    Args:
        environment: its variables.

    Attributes:
        jobs, answers: its stdin and stdout.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(_SCRIPT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            # Its own group, so that Ctrl-C reaches this process alone, and all that it starts ends with it.
            process_group=0 if hasattr(os, "killpg") else None,
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self.pid = self._process.pid
        self.jobs, self.answers = self._process.stdin, self._process.stdout
        _widen(self.jobs)
        _widen(self.answers)

    @property
    def alive(self) -> bool:
        """Whether it runs; it is not waited for, which would leave its number, and so its group's, to others."""
        if self._process.returncode is not None:
            return False
        if not hasattr(os, "waitid"):
            return self._process.poll() is None
        try:
            return os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
        except ChildProcessError:
            return False

    def signal(self, *, kill: bool) -> None:
        """Kill it and all that it started, or ask them to end."""
        # Once it has been waited for, its number may be another's.
        if self._process.returncode is not None:
            return
        with suppress(OSError):  # it is gone already
            if hasattr(os, "killpg"):
                os.killpg(self.pid, signal.SIGKILL if kill else signal.SIGTERM)
            else:
                self._process.kill()

    def dismiss(self) -> None:
        """Say that there are no more jobs, while it has none: then it ends."""
        with suppress(OSError):
            self.jobs.close()

    def bury(self) -> int:
        """Make sure that it is gone, and all that it started; returns its exit status."""
        self.signal(kill=True)
        status = self._process.wait()
        for stream in (self.jobs, self.answers):
            with suppress(OSError):  # what could not be written any more
                stream.close()
        return status


def tell_end(status: int, when: str) -> WorkerError:
    """What is said of a job whose process ended by itself, or by another's hand; `when` is "" or begins by a space."""
    if status == -9:
        return WorkerError(
            f"its process was killed{when}, as where memory runs out: use fewer workers or smaller pictures"
        )
    how = f"signal {_signal_name(-status)}" if status < 0 else f"exit status {status}"
    return WorkerError(f"its process ended by {how}{when}: try the pair by itself, or another backend")


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # a real-time one
        return str(number)


def _widen(stream: IO[bytes]) -> None:
    """Make room in a pipe, where there may be some: Linux grants a user who is not root 64 MB of it in all."""
    try:
        import fcntl

        fcntl.fcntl(stream.fileno(), fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    except (ImportError, AttributeError, OSError):
        return
