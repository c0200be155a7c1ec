"""The process that one pair after another is worked on in: jobs in on stdin, answers out on stdout.

Run as a script, with `workers.py` at the other end. It imports nothing of ours at its top: where our package and the
caller's modules are found is told with the first message. A message is a pickle whose large arrays follow it as they
lie in memory, so that they are copied once on either side.
"""

from __future__ import annotations

import contextlib
import logging
import os
import pickle
import signal
import struct
import sys
from typing import Any, BinaryIO

AGAIN_S = 0.01
_COUNT = struct.Struct("<Q")


def send(stream: BinaryIO, message: Any) -> None:
    """Write one message; its arrays go as they are.

    Raises:
        OSError: nobody reads it.
        pickle.PicklingError, TypeError, AttributeError: it holds what cannot be sent.
    """
    buffers: list[pickle.PickleBuffer] = []
    parts = [pickle.dumps(message, protocol=5, buffer_callback=buffers.append)]
    views = [memoryview(parts[0]), *(buffer.raw() for buffer in buffers)]
    stream.write(b"".join(_COUNT.pack(number) for number in (len(views), *(view.nbytes for view in views))))
    for view in views:
        stream.write(view)
    stream.flush()


def receive(stream: BinaryIO) -> Any:
    """Read one message.

    Raises:
        EOFError: the other end is gone.
    """
    (count,) = _COUNT.unpack(_exactly(stream, _COUNT.size))
    sizes = struct.unpack(f"<{count}Q", _exactly(stream, _COUNT.size * count))
    pickled, *buffers = [_exactly(stream, size) for size in sizes]
    return pickle.loads(pickled, buffers=buffers)


def _exactly(stream: BinaryIO, size: int) -> bytearray:
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
    # The other end stops us: a Ctrl-C that the terminal sends to all must not cut a pair off in its middle. SIGTERM
    # ends a job by way of every `finally`, so that no half of a file stays.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _leave)
        sys.unraisablehook = _leave_again
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not come between two answers
    jobs = sys.stdin.buffer
    sys.path[:] = receive(jobs)
    # What is worth knowing is in the result's warnings, and an error in the answer.
    logging.getLogger("stereo_gpu").addHandler(logging.NullHandler())
    task, shared, threads = receive(jobs)
    import cv2

    cv2.setNumThreads(threads)
    send(answers, "ready")
    with contextlib.suppress(EOFError, BrokenPipeError):
        while True:
            _answer(answers, task, receive(jobs), shared)


def _leave(*_: object) -> None:
    sys.exit(1)


def _leave_again(lost: Any) -> None:
    """An end that reached Python within a __del__ is lost there, but for a message: ask for it again instead."""
    if lost.exc_type is SystemExit:
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)
    else:
        sys.__unraisablehook__(lost)


def _answer(answers: BinaryIO, task: Any, job: tuple[Any, ...], shared: dict[str, Any]) -> None:
    """Do a job, and send whether that went well with the result or the error."""
    from stereo_gpu.errors import StageError, StereoError

    try:
        send(answers, (True, task(*job, **shared)))
    except (StereoError, BrokenPipeError) as error:
        send(answers, (False, error))  # fails again where nobody reads
    except Exception as error:
        import traceback

        failure = StageError(f"{type(error).__name__}: {error} (this is a fault of ours: try the pair by itself)")
        failure.add_note(traceback.format_exc())
        send(answers, (False, failure))


if __name__ == "__main__":
    main()
