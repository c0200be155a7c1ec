"""Pairs packed as PNG by several threads at once and written in the order in which they were taken."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.pair_folder import PairFolder
from stereo_gpu.types import Picture

BYTES_WAITING = 256 * 2**20  # of pictures that are not yet written; more, and whoever brings them waits
MOST_WAITING = 64
FEWEST_WAITING = 2
MOST_THREADS = 4


@dataclass(frozen=True, kw_only=True)
class Taken:
    """One pair that was written.

    Args:
        number: of the pair in its folder, from 1.
        left, right: the files.
        skew_ms: time between the two cameras' grabs, milliseconds.
        time_s: when both were there, seconds on the sources' clock.
    """

    number: int
    left: Path
    right: Path
    skew_ms: float
    time_s: float


class PairWriter:
    """Writes pairs to a folder; packing takes several threads, since one falls behind two cameras of 60 a second.

    Pairs are revealed in the order in which they came, so that those in the folder are the first ones whatever
    happens. What waits is bounded: `add` waits for room.
    """

    def __init__(self, folder: PairFolder) -> None:
        self._folder = folder
        self._pool = ThreadPoolExecutor(
            max(2, min(MOST_THREADS, os.cpu_count() or 2)), thread_name_prefix="stereo-gpu writer"
        )
        self._waiting: deque[tuple[int, StereoFrame, dict[str, Any], Future[None]]] = deque()

    def add(self, frame: StereoFrame, record: dict[str, Any]) -> Iterator[Taken]:
        """Have a pair written with this record; gives the pairs that were finished meanwhile.

        Raises:
            InputError: one of those before it cannot be written.
        """
        number = self._folder.next_number()
        job = self._pool.submit(self._pack, number, frame)
        self._waiting.append((number, frame, record, job))
        most = BYTES_WAITING // (frame.left.nbytes + frame.right.nbytes)
        return self.finished(at_most=max(FEWEST_WAITING, min(MOST_WAITING, most)))

    def finished(self, *, at_most: int | None = None) -> Iterator[Taken]:
        """Pairs whose turn it is; waits until no more than `at_most` are left, if that is given.

        Raises:
            InputError: one cannot be written.
        """
        while self._waiting:
            number, frame, record, job = self._waiting[0]
            if not job.done() and (at_most is None or len(self._waiting) <= at_most):
                return
            job.result()
            self._folder.reveal(number, record)
            self._waiting.popleft()
            left, right = (self._folder.path / name for name in self._folder.names(number))
            yield Taken(number=number, left=left, right=right, skew_ms=frame.skew_ms, time_s=frame.time_s)

    def close(self) -> None:
        """Drop what is not finished, and leave nothing of it."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        while self._waiting:
            self._folder.forget(self._waiting.popleft()[0])

    def _pack(self, number: int, frame: StereoFrame) -> None:
        self._folder.write_hidden(number, _png(frame.left), _png(frame.right))


def _png(picture: Picture) -> bytes:
    stored = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    # OpenCV's usual parameters: the higher levels take two to five times as long to save a tenth.
    _, data = cv2.imencode(".png", stored)
    packed: bytes = data.tobytes()
    return packed
