"""One child process for xatlas: asked a question, it answers in time or is killed."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

from stereo_gpu.unwrapping.worker import Arrays, read_frame, write_frame

_WORKER = Path(__file__).with_name("worker.py")


@dataclass(frozen=True)
class Question:
    """What a child is asked: see unwrapping/worker.py for the verbs."""

    verb: str
    arrays: Arrays


class NoAnswerError(Exception):
    """A child gave no answer; the message says why."""


class LateError(NoAnswerError):
    """The time for all questions is over."""


class NoStartError(NoAnswerError):
    """No child can be started, so none need be tried again."""


class Child:
    """One process. It serves one thread at a time."""

    def __init__(self) -> None:
        self._complaints = tempfile.TemporaryFile()  # noqa: SIM115  # lives as long as the child
        # As a script, not with -m, which would import the whole package first; -P keeps our types.py from passing
        # for Python's. A process of its own, not multiprocessing, since that runs the caller's main module again.
        command = [sys.executable, "-P", str(_WORKER)]
        try:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._complaints,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},  # it needs none, and each takes time to start
            )
        except OSError as error:
            self._complaints.close()
            raise NoStartError(f"the process for xatlas cannot be started: {error.strerror or error}") from None
        self._ready = False

    @property
    def alive(self) -> bool:
        """Whether it runs still."""
        return self.process.poll() is None

    def ask(self, question: Question, seconds: float) -> Arrays:
        """Put a question and wait for the answer; a child that takes longer than `seconds` is killed.

        Raises:
            NoAnswerError: it was, or it ended by itself, or it has an error to tell.
        """
        late = threading.Event()

        def kill() -> None:
            late.set()
            self.process.kill()

        timer = threading.Timer(max(seconds, 0), kill)
        timer.start()
        try:
            answer = self.exchange(question, seconds)
        finally:
            timer.cancel()
            timer.join()  # or it might kill the child during the next question
        if late.is_set():
            raise NoAnswerError(f"xatlas took more than {seconds:.3g} s")
        if answer is None:
            failed = NoAnswerError if self._ready else NoStartError
            raise failed(f"xatlas ended with status {self.process.wait()}: {self._last_words()}")
        header, arrays = answer
        if header["error"] is not None:
            raise NoAnswerError(f"xatlas failed: {header['error']}")
        return arrays

    def exchange(self, question: Question, seconds: float) -> tuple[dict[str, str | None], Arrays] | None:
        """Send a question and wait for its answer as long as it takes; None, and no process, if there is none."""
        assert self.process.stdin and self.process.stdout
        try:
            if not self._ready:
                self._ready = read_frame(self.process.stdout) is not None
            if self._ready:
                write_frame(self.process.stdin, {"verb": question.verb, "seconds": seconds}, question.arrays)
                answer = read_frame(self.process.stdout)
                if answer is not None:
                    return answer
        except (OSError, ValueError):  # no one is at the other end, or its words make no sense
            self.process.kill()
        self.process.wait()  # still under the timer: an end of its stdout need not be its own
        return None

    def end(self) -> None:
        """Kill it, leave no zombie, and close what belongs to it."""
        self.process.kill()
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout, self._complaints):
            if stream is not None:
                with contextlib.suppress(OSError):  # what was not sent is written as the file closes
                    stream.close()

    def leave_to_parent(self) -> None:
        """In a fork of the process that it belongs to: hold none of its pipes open, and do not wait for it."""
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.raw.close()  # type: ignore[attr-defined]  # unlike the stream's own, it sends nothing
        self.process.returncode = 0

    def _last_words(self) -> str:
        self._complaints.seek(0)
        said = self._complaints.read().decode(errors="replace").strip().splitlines()
        return said[-1] if said else "it said nothing"
