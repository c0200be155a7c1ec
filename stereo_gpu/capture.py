"""Take pairs of pictures with two cameras, one camera with two lenses, or from video files or folders."""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from array import array
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.files import check_writable
from stereo_gpu.recording.choosers import Chooser, IntervalChooser
from stereo_gpu.recording.feed import Feed
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.pair_folder import PairFolder
from stereo_gpu.recording.pair_writer import PairWriter, Taken
from stereo_gpu.recording.same_settings import compare_looks, compare_settings, look_at
from stereo_gpu.recording.settings import NO_SETTINGS, CameraSettings
from stereo_gpu.recording.source_thread import Stopped
from stereo_gpu.recording.sources import Name, find_openers
from stereo_gpu.recording.stereo_reader import StereoReader
from stereo_gpu.recording.words import counted
from stereo_gpu.types import Doubles

# Half a frame at 30 a second. Two free-running cameras paired by nearest time are never further apart unless one lost
# a picture, and a board that a hand moves by 0.1 m/s, 1 m away, shifts by 1 px at a focal length of 600 px.
MAX_SKEW_MS = 1000 / 60
CHECKED_FRAMES = 5  # moments whose pictures are compared between the cameras
WAIT_S = 0.1  # how often finished pairs are told while none comes

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What a recording gave.

    Args:
        folder: where its pairs are.
        taken: pairs that were written.
        seen: pairs whose skew was within the limit, of which the chooser took its own.
        dropped: pairs whose skew was above it; never written.
        passed_over: pairs for which neither chooser nor disk had time; from cameras only.
        damaged: pairs of which a camera sent a part only.
        unmatched: the left and the right source's pictures that had no partner in time.
        skews_ms: (taken,) time between the grabs of each pair, milliseconds.
        seconds: how long it took.
        ended: why it ended, in words.
        warnings: what differs between the cameras, and what they refused, a sentence each.
    """

    folder: Path
    taken: int
    seen: int
    dropped: int
    passed_over: int
    damaged: int
    unmatched: tuple[int, int]
    skews_ms: Doubles
    seconds: float
    ended: str
    warnings: tuple[str, ...]

    def __str__(self) -> str:
        """One line: how many were taken and dropped, and the skews' median, 95th percentile and largest."""
        parts = [f"{counted(self.taken, 'pair')} taken, {self.dropped} dropped for their skew"]
        if self.taken:
            middle, high, most = np.percentile(self.skews_ms, (50, 95, 100))
            parts[0] += f"; skew {middle:.1f} ms (median), {high:.1f} ms (95 %), {most:.1f} ms (largest)"
        if any(self.unmatched):
            parts.append(f"without a partner: {self.unmatched[0]} left and {self.unmatched[1]} right pictures")
        if self.damaged:
            parts.append(f"damaged on the way: {counted(self.damaged, 'pair')}")
        return "; ".join(parts)


def capture(
    left: Name,
    right: Name | None = None,
    folder: str | os.PathLike[str] = "pairs",
    *,
    chooser: Chooser | None = None,
    interval: float = 2.0,
    count: int | None = 15,
    max_skew_ms: float = MAX_SKEW_MS,
    settings: CameraSettings = NO_SETTINGS,
    stall_s: float = 5.0,
    patience_s: float = 60.0,
    stop: threading.Event | None = None,
    on_pair: Callable[[Taken], None] | None = None,
    on_status: Callable[[str], None] | None = None,
) -> Recording:
    """Take pairs and write them to a folder: left0001.png, right0001.png and so on, and pairs.jsonl.

    Both sources grab before either decodes, and pictures are paired by their times, so that one that drops pictures
    does not shift all that follow. Video files play as fast as they can be read, and lose nothing. Every line of
    pairs.jsonl tells of a pair: its number, files, time stamps, skew, sources, settings and size. A folder that holds
    pairs is gone on with.

    Args:
        left, right: a camera's number or device path, a stream's URL, a video file, or a folder of pictures; two of a
            kind. Without `right`, the left one delivers both views side by side.
        folder: where the pairs go; made if missing.
        chooser: says which pairs are taken; by default one every `interval` seconds.
        interval: seconds between pairs, without `chooser`; 0 takes every pair.
        count: how many pairs; None for as many as come.
        max_skew_ms: a pair whose pictures were grabbed further apart in time is dropped.
        settings: what to ask of the cameras.
        stall_s: a camera or stream that says nothing for so long is opened again.
        patience_s: for so long it is tried.
        stop: set it from another thread or a signal's handler to end the recording; what was taken until then is
            written. It is set, too, when the recording has ended.
        on_pair: told of each pair, in order, once it is on the disk.
        on_status: told with every pair seen what the chooser waits for.

    Raises:
        InputError: an option is wrong, a source cannot be opened or gives no picture, the sizes differ, or the folder
            cannot be written or is full. Pairs already told of are whole and stay.
        CameraError: a camera failed and did not come back; the same.
    """
    _check_options(count, max_skew_ms, stall_s, patience_s)
    chooser = IntervalChooser(interval) if chooser is None else chooser
    check_writable(folder)
    stop = threading.Event() if stop is None else stop
    since = time.monotonic()
    tally = _Tally(on_pair)
    with _quiet_opencv():
        try:
            reader = StereoReader(
                find_openers(left, right, settings), stall_s=stall_s, patience_s=patience_s, stop=stop
            )
        except Stopped:
            return tally.recording(Path(folder), since, "stopped")
        feed = Feed(reader, stop=stop)
        try:
            ended = _record(feed, Path(folder), chooser, count, max_skew_ms, stop, tally, on_status)
        except StereoError as error:
            if not tally.skews_ms:
                raise
            taken = len(tally.skews_ms)
            what = f"{counted(taken, 'pair')} before that {'is' if taken == 1 else 'are'} whole in {folder}"
            raise type(error)(f"{error}; {what}, and a new run goes on after them") from error
        finally:
            feed.close()
    return tally.recording(Path(folder), since, ended, feed)


def _record(
    feed: Feed,
    folder: Path,
    chooser: Chooser,
    count: int | None,
    max_skew_ms: float,
    stop: threading.Event,
    tally: _Tally,
    on_status: Callable[[str], None] | None,
) -> str:
    """Pass every pair of the feed by the chooser and write those it takes; why that ended."""
    frame = None
    while frame is None:
        if feed.over or stop.is_set():
            return feed.reader.ended or "stopped"
        frame = feed.wait(WAIT_S)
    with closing(PairFolder(folder)) as pairs, closing(PairWriter(pairs)) as writer:
        wanted = math.inf if count is None else count
        while True:
            if frame is not None and frame.skew_ms > max_skew_ms:
                tally.dropped += 1
            elif frame is not None:
                tally.seen += 1
                tally.look(frame, feed.reader)
                with _all_written(writer, tally):
                    taken = chooser.choose(frame)
                if taken:
                    tally.written(writer.add(frame, _describe(frame, feed.reader)))
                    wanted -= 1
            if on_status is not None:
                on_status(chooser.status)
            if wanted <= 0 or chooser.done or stop.is_set() or feed.over:
                break
            with _all_written(writer, tally):
                frame = feed.wait(WAIT_S)
            tally.written(writer.finished())
        tally.written(writer.finished(at_most=0))
    if wanted <= 0:
        return "the pair was taken" if count == 1 else f"all {count} pairs were taken"
    return "no more pairs were wanted" if chooser.done else feed.reader.ended or "stopped"


@contextmanager
def _all_written(writer: PairWriter, tally: _Tally) -> Iterator[None]:
    """Whatever fails here, the pairs that were taken before it are written."""
    try:
        yield
    except Exception:
        tally.written(writer.finished(at_most=0))
        raise


class _Tally:
    """What a recording has counted so far."""

    def __init__(self, on_pair: Callable[[Taken], None] | None) -> None:
        self.skews_ms = array("d")
        self.seen = 0
        self.dropped = 0
        self.warnings: list[str] = []
        self._on_pair = on_pair
        self._looks: list[Doubles] = []

    def written(self, pairs: Iterable[Taken]) -> None:
        """Count pairs that are on the disk, and tell of them."""
        for pair in pairs:
            self.skews_ms.append(pair.skew_ms)
            if self._on_pair is not None:
                self._on_pair(pair)

    def look(self, frame: StereoFrame, reader: StereoReader) -> None:
        """Compare the two cameras on the first moments."""
        if len(self._looks) >= CHECKED_FRAMES:
            return
        if not self._looks:
            for name, refused in zip(reader.names, reader.refused, strict=False):
                if refused:
                    self._warn(f"{name} did not take {', '.join(refused)}: set the camera with its own program")
            if reader.live and len(reader.settings) == 2:
                self._warn(*compare_settings(*reader.settings))
        self._looks.append(look_at(frame))
        if len(self._looks) == CHECKED_FRAMES:
            told = set.intersection(*(set(settings) for settings in reader.settings)) if reader.live else set()
            self._warn(*compare_looks(self._looks, told))

    def recording(self, folder: Path, since: float, ended: str, feed: Feed | None = None) -> Recording:
        """All of it."""
        unmatched = (*feed.reader.unmatched, 0)[:2] if feed is not None else (0, 0)
        return Recording(
            folder=folder,
            taken=len(self.skews_ms),
            seen=self.seen,
            dropped=self.dropped,
            passed_over=feed.passed_over if feed is not None else 0,
            damaged=feed.reader.damaged if feed is not None else 0,
            unmatched=(unmatched[0], unmatched[1]),
            skews_ms=np.array(self.skews_ms, np.float64),
            seconds=time.monotonic() - since,
            ended=ended,
            warnings=tuple(self.warnings),
        )

    def _warn(self, *sentences: str) -> None:
        for sentence in sentences:
            logger.warning("%s", sentence)
            self.warnings.append(sentence)


def _describe(frame: StereoFrame, reader: StereoReader) -> dict[str, Any]:
    """What the list of pairs tells of one."""
    return {
        "left_s": round(frame.left_s, 6),
        "right_s": round(frame.right_s, 6),
        "skew_ms": round(frame.skew_ms, 3),
        "written_at": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "frame": frame.number,
        "size": [frame.left.shape[1], frame.left.shape[0]],
        "sources": list(reader.names),
        "settings": list(reader.settings),
    }


def _check_options(count: int | None, max_skew_ms: float, stall_s: float, patience_s: float) -> None:
    if count is not None and count < 1:
        raise InputError(f"count = {count}: take at least 1 pair")
    if not max_skew_ms >= 0:
        raise InputError(f"max_skew_ms = {max_skew_ms:g}: give 0 ms or more")
    if not 0.1 <= stall_s < math.inf:
        raise InputError(f"stall_s = {stall_s:g}: give 0.1 seconds or more")
    if not 0 <= patience_s < math.inf:
        raise InputError(f"patience_s = {patience_s:g}: give 0 seconds or more")


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """Keep OpenCV's own lines off standard error; what matters of them is told in ours."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    # OpenCV reads this when it opens its first stream; a level below 0 says nothing at all.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
