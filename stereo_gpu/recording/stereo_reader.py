"""Two sources read in step: both grab before either decodes, and pictures are paired by their times.

Grabbing is quick and decides when a picture was taken; decoding takes many times as long. So both grab at once, in a
thread each; only when the two times belong together are both decoded. Where one source dropped pictures, or runs
faster, the other passes over its own, not decoded, until its time is the nearest again.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Sequence
from statistics import median

from stereo_gpu.errors import InputError
from stereo_gpu.recording.frames import StereoFrame
from stereo_gpu.recording.source_thread import FIRST_LIMIT_S, SourceThread
from stereo_gpu.recording.sources import Opener
from stereo_gpu.types import Picture

STEPS_KEPT = 15  # times between pictures, whose median is the source's period
STEPS_NEEDED = 5  # before that the source's own word counts
FRESH_SHARE = 0.3  # of a period: a grab that took as long had to wait for its picture
GAP = 1.8  # periods: a grab that took longer missed a picture
OPENING_PAIRS, SETTLING_PAIRS = 4, 2  # passed over until both are in step, after opening and after a gap
MOST_DAMAGED = 30  # pictures in turn that cannot be decoded: no longer a moment's trouble on the cable
SETTINGS_EVERY_S = 1.0  # an automatic exposure goes on changing


class StereoReader:
    """Reads pairs from one source for each view, or from one that delivers both side by side.

    Args:
        openers: of the left and right source, or of the only one.
        stall_s, patience_s, stop: as `SourceThread` takes them.

    Attributes:
        names: of the sources, for each view.
        live: whether they go on by themselves.
        warm_up_s: how long their exposure is still settling.
        settings: what each source runs with, as it told within the last second.
        refused: which of the wanted settings each source did not take.
        unmatched: pictures of each source that had no partner.
        damaged: pairs of a live source that could not be decoded.
        ended: why there is no further pair; empty before the end.

    Raises:
        InputError: a source cannot be opened.
        CameraError: a source hangs.
        Stopped: the recording ends.
    """

    def __init__(self, openers: Sequence[Opener], *, stall_s: float, patience_s: float, stop: threading.Event) -> None:
        self._threads: list[SourceThread] = []
        try:
            for opener in openers:
                self._threads.append(SourceThread(opener, stall_s=stall_s, patience_s=patience_s, stop=stop))
            self._read_settings()
        except TimeoutError as error:
            self.close()
            side = "left" if not self._threads else "right"
            raise InputError(
                f"the {side} source does not open within {FIRST_LIMIT_S:g} s: unplug the camera and plug it in again,"
                " or copy the file to this computer's own disk"
            ) from error
        except BaseException:
            self.close()
            raise
        count = len(self._threads)
        self.names = tuple(self._threads[side % count].name for side in (0, 1))
        self.live = self._threads[0].live
        self.warm_up_s = max(thread.source.warm_up_s for thread in self._threads)
        self.unmatched = [0] * count
        self.damaged = 0
        self.ended = ""
        self._steps: list[deque[float]] = [deque(maxlen=STEPS_KEPT) for _ in self._threads]
        self._times = [math.nan] * count  # of the pictures that were grabbed last
        # While the second source was opened, the first one's pictures piled up.
        self._piled_up, self._settling = (True, OPENING_PAIRS) if self.live else (False, 0)
        self._number = 0
        self._damaged_in_turn = 0
        self.refused = tuple(thread.source.refused for thread in self._threads)

    def step(self) -> bool:
        """Grab the next pair that belongs together; False at the end.

        Raises:
            InputError: a source has never given a picture.
            CameraError: a source has failed and did not come back.
            Stopped: the recording ends.
        """
        while True:
            if not self._step():
                return False
            if self._settling == 0:
                self._number += 1
                return True
            self._settling -= 1
            if self._number:
                self.unmatched = [count + 1 for count in self.unmatched]

    def decode(self) -> StereoFrame | None:
        """The pair that was grabbed last, decoded in both threads at once; None if a camera sent a damaged picture.

        Raises:
            InputError: a file's picture cannot be decoded, or nothing that a camera sends, or both differ in size.
            CameraError: a source hangs.
            Stopped: the recording ends.
        """
        answers = [thread.retrieve() for thread in self._threads]
        try:
            pictures: list[Picture] = [
                thread.result(answer) for thread, answer in zip(self._threads, answers, strict=True)
            ]
        except InputError:
            self.damaged += 1
            self._damaged_in_turn += 1
            if not self.live or self._damaged_in_turn >= MOST_DAMAGED:
                raise
            return None
        self._damaged_in_turn = 0
        if time.monotonic() - self._told_s > SETTINGS_EVERY_S:
            self._read_settings()
        if len(pictures) == 1:
            pictures = self._halves(pictures[0])
        sizes = [f"{picture.shape[1]} x {picture.shape[0]}" for picture in pictures]
        if sizes[0] != sizes[1]:
            raise InputError(
                f"{self.names[0]} gives {sizes[0]}, {self.names[1]} gives {sizes[1]}: set both cameras to one size"
            )
        left_s, right_s = self._times[0], self._times[-1]
        return StereoFrame(number=self._number, left=pictures[0], right=pictures[1], left_s=left_s, right_s=right_s)

    @property
    def time_s(self) -> float:
        """When the pair that was grabbed last was complete, on the sources' clock."""
        return max(self._times)

    def period_s(self, side: int) -> float:
        """Seconds between two pictures of a source: as they came, or as it says itself while few have come."""
        steps = self._steps[side]
        return median(steps) if len(steps) >= STEPS_NEEDED else self._threads[side].source.period_s

    def close(self) -> None:
        """Let the sources go."""
        for thread in self._threads:
            thread.close()

    def _step(self) -> bool:
        """Have both sources grab until their times belong together; False at the end of one."""
        if not self._grab(range(len(self._threads))):
            return False
        # Where pictures have piled up the times are those of reading, not worth comparing.
        while len(self._times) == 2 and not self._piled_up:
            older = int(self._times[1] < self._times[0])
            if abs(self._times[1] - self._times[0]) <= self.period_s(older) / 2:
                break
            self.unmatched[older] += self._settling == 0
            if not self._grab([older]):
                return False
        return True

    def _grab(self, sides: Sequence[int]) -> bool:
        """Have these sources grab at once; False at the end of one."""
        for side in sides:
            if self._piled_up:
                self._threads[side].start_drain(FRESH_SHARE * self.period_s(side))
            else:
                self._threads[side].start_grab()
        self._piled_up = False
        for side in sides:
            grab = self._threads[side].finish_grab()
            if grab.time_s is None:
                self.ended = self._threads[side].source.ended or f"{self._threads[side].name} ended"
                return False
            if self._number:
                self.unmatched[side] += grab.passed_over
            late = not self._threads[side].source.stamped and grab.waited_s > GAP * self.period_s(side)
            if grab.anew or (late and not self._settling):
                # Meanwhile the other's pictures piled up, and its next grabs would give them the time of now.
                self._piled_up, self._settling = True, SETTLING_PAIRS
            elif self._settling == 0 and math.isfinite(self._times[side]):
                self._steps[side].append(grab.time_s - self._times[side])
            self._times[side] = grab.time_s
        return True

    def _read_settings(self) -> None:
        self.settings: tuple[dict[str, float], ...] = tuple(thread.settings() for thread in self._threads)
        self._told_s = time.monotonic()

    def _halves(self, both: Picture) -> list[Picture]:
        width = both.shape[1]
        if width % 2:
            raise InputError(
                f"{self.names[0]} gives pictures {width} px wide: two views side by side take an even number of px"
            )
        return [both[:, : width // 2], both[:, width // 2 :]]
