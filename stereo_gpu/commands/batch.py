"""Make textured models of many raw pairs of one rig.

A pair that fails, fails alone; a run that was stopped goes on where it was when it is started again.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_gpu.commands.arguments import (
    add_backend,
    add_engine,
    add_matching,
    add_model,
    add_rig,
    add_texture_format,
    numbers,
    read_mesh_options,
)
from stereo_gpu.progress import BAR_WIDTH, CLEAR_LINE

if TYPE_CHECKING:
    from stereo_gpu.batch import Done
    from stereo_gpu.batching.pair_list import ListedPair
    from stereo_gpu.rig import Rig

RECENT = 64  # pairs over which the rate is taken
REDRAW_S = 0.1
TELL_S = 30.0  # how often a line is printed where no bar can be drawn, and at every tenth of the work
_STOPS = (signal.SIGINT, signal.SIGTERM)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument(
        "pairs",
        type=Path,
        metavar="FOLDER-or-MANIFEST",
        help="folder with left* and right* pictures, with folders left and right, or with a folder a pair; or a CSV"
        " file (left,right[,name[,mask]]) or JSON lines with these keys, as `capture` writes them",
    )
    add_rig(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for the results, a folder a pair")
    parser.add_argument(
        "--files",
        choices=("model", "all"),
        default="model",
        help="of each pair: model.glb and result.json, or all that `reconstruct` writes (%(default)s)",
    )
    parser.add_argument("--again", action="store_true", help="do once more what is done already")
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="pairs at once, each in its own process; by default one a core, on a GPU 8 at most",
    )
    add_engine(parser)
    parser.add_argument(
        "--limit", type=float, metavar="S", help="seconds after which a pair is given up; by default none"
    )
    parser.add_argument(
        "--check",
        choices=("first", "every", "never"),
        default="first",
        help="pairs that the rig is checked against in full; with `first` the rows of the others' maps are, and in full"
        " only where these are not plainly right (%(default)s)",
    )
    parser.add_argument("--ignore-check", action="store_true", help="go on where the rig does not fit a pair")
    add_matching(parser, "precise")
    parser.add_argument("--depth", type=numbers(float, 2), metavar="NEAR,FAR", help="wanted depths, in the rig's unit")
    add_model(parser)
    add_texture_format(parser)
    add_backend(parser)


def run(options: argparse.Namespace) -> None:
    """Reconstruct every pair, and tell how far it is, what failed and how fast it was."""
    from stereo_gpu.batch import reconstruct_batch
    from stereo_gpu.batching.pair_list import FAILED_NAME, list_pairs
    from stereo_gpu.errors import StageError

    # A service stops its programs by SIGTERM: that ends the work as Ctrl-C does, which some callers have ignored.
    for stop in _STOPS:
        if signal.getsignal(stop) != signal.SIG_IGN:
            signal.signal(stop, _interrupt)
    pairs = list_pairs(options.pairs)
    done = reconstruct_batch(
        pairs,
        _read_rig(options.rig, pairs),
        options.out,
        files=options.files,
        again=options.again,
        workers=options.workers,
        check=options.check,
        limit_s=options.limit,
        profile=options.profile,
        disparities=options.disparities,
        backend=options.backend,
        window=options.window,
        reference=options.reference,
        depth=options.depth,
        mesh=read_mesh_options(options),
        tile=options.tile,
        ignore_check=options.ignore_check,
        texture_format=options.texture_format,
        engine=options.engine,
        address=options.address,
    )
    with _Tally(len(pairs)) as tally:
        try:
            for pair in done:
                tally.add(pair)
        except KeyboardInterrupt:
            done.close()
            tally.clear()
            print(f"{tally.summary()}; the same command goes on from here", flush=True)
            raise
    print(f"{options.out}: {tally.summary()}")
    if tally.failed:
        raise StageError(f"{tally.failed} of {len(pairs)} pairs failed: {options.out / FAILED_NAME} lists them")


class _Tally:
    """Counts what is done, and shows it: a bar that is redrawn on a terminal, plain lines elsewhere."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._drawn = sys.stderr.isatty()
        self._start = self._told = time.monotonic()
        self._recent: deque[float] = deque([self._start], RECENT + 1)
        self.made = self.skipped = self.failed = self.warned = 0

    def __enter__(self) -> _Tally:
        if self._drawn:
            self._draw()
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def add(self, done: Done) -> None:
        """Count a pair, say so if it failed, and show how far the work is."""
        now = time.monotonic()
        before = len(self)
        self._recent.append(now)
        if done.error is not None:
            self.failed += 1
            self.clear()
            print(f"stereo-gpu: {done.pair.name} failed: {done.error}", file=sys.stderr, flush=True)
        elif done.skipped:
            self.skipped += 1
        else:
            self.made += 1
            self.warned += bool(done.warnings)
        last = len(self) == self._total
        if self._drawn and (last or now - self._told >= REDRAW_S):
            self._draw()
            self._told = now
        elif not self._drawn and (
            last or now - self._told >= TELL_S or 10 * len(self) // self._total > 10 * before // self._total
        ):
            print(f"stereo-gpu: {self._words()}", file=sys.stderr, flush=True)
            self._told = now

    def _draw(self) -> None:
        full = BAR_WIDTH * len(self) // self._total
        bar = "#" * full + "." * (BAR_WIDTH - full)
        print(f"{CLEAR_LINE}[{bar}] {self._words()}", end="", file=sys.stderr, flush=True)

    def __len__(self) -> int:
        return self.made + self.skipped + self.failed

    def _words(self) -> str:
        """How far the work is, how fast, and how long it will take."""
        taken = self._recent[-1] - self._recent[0]
        rate = (len(self._recent) - 1) / taken if taken > 0 else 0.0
        left = f", {_time((self._total - len(self)) / rate)} left" if rate > 0 and len(self) < self._total else ""
        failed = f", {self.failed} failed" if self.failed else ""
        speed = f", {_rate(rate)}{left}" if rate > 0 else ""
        return f"{len(self)} of {self._total} pairs{failed}{speed}"

    def clear(self) -> None:
        """Leave the line of the bar empty."""
        if self._drawn:
            print(CLEAR_LINE, end="", file=sys.stderr, flush=True)

    def summary(self) -> str:
        """What became of all pairs."""
        taken = time.monotonic() - self._start
        done = self.made + self.failed
        said = [f"{self.made} made" + (f" ({self.warned} with warnings in their result.json)" if self.warned else "")]
        said += [f"{self.skipped} skipped, done before"] if self.skipped else []
        said += [f"{self.failed} failed"] if self.failed else []
        rest = self._total - len(self)
        said += [f"{rest} not done"] if rest else []
        speed = f", {_rate(done / taken)}" if done else ""
        return f"{', '.join(said)}, of {self._total} pairs in {_time(taken)}{speed}"


def _read_rig(path: Path, pairs: list[ListedPair]) -> Rig:
    """The rig; the first picture that can be read tells the size where the file does not."""
    from stereo_gpu.errors import PictureError
    from stereo_gpu.images import read_image
    from stereo_gpu.rig_files.load import load_rig, load_rig_for

    for pair in pairs:
        try:
            picture = read_image(pair.left)
        except PictureError:
            continue
        return load_rig_for(path, picture)
    return load_rig(path)


def _interrupt(*_: object) -> None:
    # The end is near: a second one, or a third, would only cut off what cleans up.
    for stop in _STOPS:
        signal.signal(stop, signal.SIG_IGN)
    raise KeyboardInterrupt


def _time(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.1f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes / 60:.1f} h"


def _rate(pairs_a_second: float) -> str:
    if pairs_a_second >= 1 / 3:
        return f"{pairs_a_second:.1f} pairs/s"
    return f"{60 * pairs_a_second:.1f} pairs/min"
