"""The process that one job after another is done in: jobs in on stdin, stages and answers out on stdout.

Run as a script, with `process.py` at the other end. It imports nothing of ours at its top: where our package and the
caller's modules are found is told with the first message. A message is a pickle whose large arrays follow it as they
lie in memory, so that they are copied once on either side. The messages, in order:

    in   sys.path of the parent; then (task, prepare, arguments of all jobs, whether it tells, threads)
    out  None once it is ready, or the line that says why it will never be
    in   the arguments of a job
    out  (TOLD, stage) at the beginning of each stage; then (True, result) or (False, error)
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

TOLD = "stage"
AGAIN_S = 0.01
PARENT_S = 0.5  # how often it is seen whether the parent is there
ORPHAN_GRACE_S = 5.0  # for an orphan to leave nothing half written
_COUNT = struct.Struct("<Q")


def send(stream: IO[bytes], message: Any) -> None:
    """Write one message; its arrays go as they are.

    Raises:
        OSError: nobody reads it.
        pickle.PicklingError, TypeError, AttributeError: it holds what cannot be sent; nothing was.
    """
    buffers: list[pickle.PickleBuffer] = []
    parts = [pickle.dumps(message, protocol=5, buffer_callback=buffers.append)]
    views = [memoryview(parts[0]), *(buffer.raw() for buffer in buffers)]
    stream.write(b"".join(_COUNT.pack(number) for number in (len(views), *(view.nbytes for view in views))))
    for view in views:
        stream.write(view)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read one message.

    Raises:
        EOFError: the other end is gone.
    """
    return load(receive_parts(stream))


def receive_parts(stream: IO[bytes]) -> list[bytearray]:
    """Read one message and leave it as it came, so that one that cannot be understood is no loss of the next."""
    (count,) = _COUNT.unpack(_exactly(stream, _COUNT.size))
    sizes = struct.unpack(f"<{count}Q", _exactly(stream, _COUNT.size * count))
    return [_exactly(stream, size) for size in sizes]


def load(parts: list[bytearray]) -> Any:
    """What a message says."""
    pickled, *buffers = parts
    return pickle.loads(pickled, buffers=buffers)


def _exactly(stream: IO[bytes], size: int) -> bytearray:
    data = bytearray(size)
    view, done = memoryview(data), 0
    while done < size:
        read = stream.readinto(view[done:])  # type: ignore[attr-defined]  # every buffered stream has it
        if not read:
            raise EOFError("the process at the other end is gone")
        done += read
    return data


def main() -> None:
    """Answer jobs until there are no more."""
    # The other end stops us: a Ctrl-C that the terminal sends to all must not cut a job off in its middle.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _leave)
        sys.unraisablehook = _leave_again
    if hasattr(os, "killpg"):
        threading.Thread(target=_end_as_orphan, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not come between two answers
    jobs = os.fdopen(os.dup(0), "rb")
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)  # nor must what a task starts, or a debugger in it, take a job for its input
    with contextlib.suppress(EOFError, BrokenPipeError):  # nobody is at the other end any more
        _serve(jobs, answers)


def _serve(jobs: IO[bytes], answers: IO[bytes]) -> None:
    """Get ready, and do one job after another until nobody sends any."""
    sys.path[:] = receive(jobs)
    # What is worth knowing is in the result's warnings, and an error in the answer.
    logging.getLogger("stereo_gpu").addHandler(logging.NullHandler())
    setup = receive_parts(jobs)
    try:
        task, arguments, tells = _set_up(*load(setup))
    except Exception as error:
        from stereo_gpu.engines.call import in_one_line

        send(answers, in_one_line(error))
        return
    # From now on SIGTERM ends a job by way of every `finally`, so that no half of a file stays. Until now there was
    # none, and an exception amid an import may reach a library in C++ that cannot bear it, and says so on stderr.
    signal.signal(signal.SIGTERM, _leave)
    send(answers, None)
    while True:
        _answer(answers, task, receive_parts(jobs), arguments, tells)


def _set_up(
    task: Callable[..., Any], prepare: Callable[..., None] | None, arguments: dict[str, Any], tells: bool, threads: int
) -> tuple[Callable[..., Any], dict[str, Any], bool]:
    import cv2

    cv2.setNumThreads(threads)
    if prepare is not None:
        prepare(**arguments)
    return task, arguments, tells


def _answer(
    answers: IO[bytes], task: Callable[..., Any], parts: list[bytearray], arguments: dict[str, Any], tells: bool
) -> None:
    """Do a job, and send its stages and whether it went well with the result or the error."""
    from stereo_gpu.engines.call import call, failure

    telling, over = threading.Lock(), threading.Event()  # a task may have threads, some of which outlive it

    def tell(stage: str) -> None:
        with telling:
            if not over.is_set():
                send(answers, (TOLD, stage))

    try:
        job = load(parts)
    except Exception as error:  # it names what this process cannot import
        message = (False, failure(error))
    else:
        message = call(task, job, {**arguments, "tell": tell} if tells else arguments)
    with telling:
        over.set()
    try:
        send(answers, message)
    except OSError:
        raise
    except Exception as error:  # a result that cannot be sent; nothing of it was
        send(answers, (False, failure(error)))


def _leave(*_: object) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one would cut off what cleans up after the first
    sys.exit(1)


def _leave_again(lost: Any) -> None:
    """An end that reached Python within a __del__ is lost there, but for a message: ask for it again instead."""
    if lost.exc_type is SystemExit:
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
    else:
        sys.__unraisablehook__(lost)


def _end_as_orphan(parent: int) -> None:
    """End when the parent is gone, whatever ended it: nobody limits the job any more, and nobody takes its answer."""
    while os.getppid() == parent:
        time.sleep(PARENT_S)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(ORPHAN_GRACE_S)
    os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    main()
