"""Take pairs of pictures with two cameras."""

from __future__ import annotations

import argparse
import shlex
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from stereo_gpu.commands.arguments import read_board
from stereo_gpu.commands.recording_terminal import Lines, stopping_on_signals
from stereo_gpu.errors import InputError

if TYPE_CHECKING:
    from stereo_gpu.capture import Recording
    from stereo_gpu.recording.board_watch import BoardChooser
    from stereo_gpu.recording.choosers import Chooser

USUAL_INTERVAL_S = 2.0
USUAL_COUNT = 15


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument("left", help="camera's number or device path, stream's URL, video file, or folder of pictures")
    parser.add_argument("right", nargs="?", help="the same of the right camera; not with --side-by-side")
    parser.add_argument("--side-by-side", action="store_true", help="the one source delivers both views side by side")
    parser.add_argument("--out", type=Path, required=True, help="folder for left0001.png, right0001.png, ...")

    mode = parser.add_mutually_exclusive_group()
    mode.add_argument(
        "--interval", type=float, metavar="S", help=f"seconds between pairs ({USUAL_INTERVAL_S:g}); the usual mode"
    )
    mode.add_argument("--every", action="store_true", help="take every pair")
    mode.add_argument("--on-key", action="store_true", help="take a pair when Enter or space is pressed; q ends")
    mode.add_argument("--board", metavar="10x7", help="watch for a board of so many squares, and take what is missing")
    parser.add_argument("--square", type=float, metavar="MM", help="with --board: side of a square, mm")
    parser.add_argument("--marker", type=float, metavar="MM", help="with --board: side of a ChArUco board's marker, mm")
    parser.add_argument("--dictionary", metavar="5x5_250", help="with --marker: the markers' dictionary")
    page = parser.add_mutually_exclusive_group()
    page.add_argument("--page", metavar="[ADDRESS:]PORT", help="with --board: where its page is; by default local")
    page.add_argument("--no-page", action="store_true", help="with --board: serve no page")
    parser.add_argument(
        "--count", type=int, help=f"how many pairs ({USUAL_COUNT}; with --every, --on-key and --board no limit)"
    )
    parser.add_argument(
        "--max-skew", type=float, metavar="MS", help="drop pairs whose pictures are further apart in time (16.7)"
    )

    camera = parser.add_argument_group("both cameras, where their drivers allow it")
    camera.add_argument("--size", type=_size, metavar="1280x720", help="of the picture as the camera delivers it")
    camera.add_argument("--fps", type=float, help="pictures a second; of folders, the rate at which they were taken")
    camera.add_argument("--exposure", type=float, help="in the driver's units; turns automatic exposure off")
    camera.add_argument("--gain", type=float, help="in the driver's units")
    camera.add_argument("--focus", type=float, help="in the driver's units; turns automatic focus off")
    camera.add_argument("--white-balance", type=float, metavar="K", help="kelvin; turns automatic white balance off")
    camera.add_argument("--lock", action="store_true", help="turn all three automatics off, and keep what they found")
    camera.add_argument("--fourcc", metavar="MJPG", help="pixel format; two cameras on one USB hub may need MJPG")
    camera.add_argument(
        "--patience", type=float, default=60.0, metavar="S", help="wait so long for a camera to return (%(default)g)"
    )


def run(options: argparse.Namespace) -> None:
    """Take pairs of pictures."""
    from stereo_gpu.capture import MAX_SKEW_MS, capture
    from stereo_gpu.recording.board_watch import BoardChooser
    from stereo_gpu.recording.settings import CameraSettings

    _check(options)
    open_ended = options.every or options.on_key or options.board is not None
    count = options.count if options.count is not None or open_ended else USUAL_COUNT
    settings = CameraSettings(
        size=options.size,
        fps=options.fps,
        exposure=options.exposure,
        gain=options.gain,
        focus=options.focus,
        white_balance=options.white_balance,
        lock=options.lock,
        fourcc=options.fourcc,
    )
    with ExitStack() as stack:
        chooser, status = _chooser(options, stack)
        # What is on the way is written, and the terminal is set back, before a signal has its effect.
        stop = stack.enter_context(stopping_on_signals())
        lines = Lines(count, each=not options.every, status=status, stop=stop)
        stack.callback(lines.close)
        recording = capture(
            options.left,
            options.right,
            options.out,
            chooser=chooser,
            interval=0.0 if options.every else options.interval if options.interval is not None else USUAL_INTERVAL_S,
            count=count,
            max_skew_ms=MAX_SKEW_MS if options.max_skew is None else options.max_skew,
            settings=settings,
            patience_s=options.patience,
            stop=stop,
            on_pair=lines.pair,
            on_status=lines.status,
        )
    if recording.dropped and not recording.seen and not stop.signals:
        raise InputError(
            f"no pair was taken: the skews of all {recording.dropped} were above the limit; set both cameras to one"
            " --fps, or raise --max-skew if nothing moves before them"
        )
    if any(recording.unmatched) and not recording.seen and not stop.signals:
        raise InputError(
            f"no pair was taken: by their times, no pictures of {options.left} and {options.right} belong together;"
            " give two recordings of the same moments"
        )
    _sum_up(recording, options)
    if isinstance(chooser, BoardChooser):
        _say_what_is_missing(chooser)
        if chooser.done:
            print(f"go on with: {_calibrate_command(options)}")
    if stop.signals and (count is not None or signal.SIGTERM in stop.signals):
        # Where no count was asked for, Ctrl-C is the way to end.
        raise KeyboardInterrupt


def _check(options: argparse.Namespace) -> None:
    """Refuse options that do not go together."""
    if options.side_by_side == (options.right is not None):
        raise InputError(
            f"--side-by-side is for one source, {options.left} and {options.right} are two: leave one out"
            if options.side_by_side
            else f"{options.left} is one source: name the right camera too, or say --side-by-side"
        )
    for name, owner in (("square", "board"), ("marker", "board"), ("dictionary", "board"), ("page", "board")):
        if getattr(options, name) is not None and getattr(options, owner) is None:
            raise InputError(f"--{name} {getattr(options, name)}: it is for --{owner}, which is not given")


def _chooser(options: argparse.Namespace, stack: ExitStack) -> tuple[Chooser | None, bool]:
    """Who chooses the pairs, None for the interval; and whether its status is to be shown in a line."""
    if options.on_key:
        from stereo_gpu.recording.choosers import KeyChooser
        from stereo_gpu.recording.keys import Keys

        return KeyChooser(stack.enter_context(Keys())), True
    if options.board is None:
        return None, True
    from stereo_gpu.recording.board_watch import BoardChooser
    from stereo_gpu.recording.live_page import LivePage
    from stereo_gpu.recording.page_server import parse_address
    from stereo_gpu.recording.sources import is_folder
    from stereo_gpu.recording.terminal_map import TerminalMap

    board = read_board(options)
    terminal = stack.enter_context(TerminalMap(sys.stderr))
    shows = [terminal.show]
    if not options.no_page:
        host, port = parse_address(options.page) if options.page is not None else (None, None)
        page = stack.enter_context(LivePage(board, **({} if host is None else {"host": host}), port=port))
        for line in page.directions:
            print(line, file=sys.stderr, flush=True)
        shows.append(page.show)
    # In a folder every picture may show another pose, so that nothing ever holds still.
    still = not is_folder(options.left)
    chooser = BoardChooser(board, still=still, shows=shows)
    _count_in(chooser, options.out)
    return chooser, False


def _count_in(chooser: BoardChooser, folder: Path) -> None:
    """Let the pairs of an earlier run into the same folder count."""
    from stereo_gpu.images import read_image
    from stereo_gpu.recording.words import counted

    known = 0
    for left in sorted(folder.glob("left*.png")):
        right = left.with_name(f"right{left.name.removeprefix('left')}")
        if right.is_file():
            known += chooser.count_in(read_image(left), read_image(right))
    if known:
        verbs = ("is", "counts") if known == 1 else ("are", "count")
        told = f"{counted(known, 'pair')} with the board {verbs[0]} in {folder} and {verbs[1]}"
        print(f"stereo-gpu: {told}", file=sys.stderr, flush=True)


def _sum_up(recording: Recording, options: argparse.Namespace) -> None:
    print(f"{recording.folder}: {recording}")
    print(f"ended: {recording.ended}")
    if options.every and recording.passed_over:
        print(
            f"lost: {recording.passed_over} pairs, since the disk or the processor was too slow; lower --fps or --size"
        )
    if recording.dropped > recording.taken:
        print(
            "most pairs were dropped: set both cameras to one --fps, or raise --max-skew if nothing moves before them"
        )


def _say_what_is_missing(chooser: BoardChooser) -> None:
    from stereo_gpu.boards.pair_coverage import FEWEST_PAIRS, by_picture

    if chooser.coverage is None:
        return
    if chooser.coverage.pairs < FEWEST_PAIRS:
        print(f"missing: {FEWEST_PAIRS - chooser.coverage.pairs} of at least {FEWEST_PAIRS} pairs")
    for where, lacks in by_picture(chooser.coverage.missing()):
        print(f"missing in {where}: {'; '.join(lacks)}")
    if not chooser.done:
        print("a new run into the same folder goes on from here")


def _calibrate_command(options: argparse.Namespace) -> str:
    """The command that makes a rig of these pairs, ready to be typed."""
    board = ["--board", options.board, "--square", "MM" if options.square is None else f"{options.square:g}"]
    if options.marker is not None:
        board += ["--marker", f"{options.marker:g}"]
    if options.dictionary is not None:
        board += ["--dictionary", options.dictionary]
    return shlex.join(["stereo-gpu", "calibrate", str(options.out), *board, "--out", "rig.json"])


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and len(text) < 12):
        raise argparse.ArgumentTypeError(f"{text!r:.40}: give width x height in px, such as 1280x720")
    return int(width), int(height)
