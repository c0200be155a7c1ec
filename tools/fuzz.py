"""Feed damaged calibration files to every reader: what crashes, hangs, takes memory or raises the wrong error is kept.

Each reader runs in a child process with a bound on its memory and on the time of one file. A table says how many files
were taken or refused, with the most frequent reasons, and which share of the reader's lines was reached: that the
files get beyond the first check is what makes the rest worth anything. Exit status 1 if a file made a reader fail,
or if a reader's lines were reached by less than COVERED.
"""

import argparse
import logging
import multiprocessing
import random
import re
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import numpy as np
from fuzz_mutate import mutate
from fuzz_seeds import SHARED, Reader, readers

import stereo_gpu as sg
from stereo_gpu.errors import InputError
from stereo_gpu.rig_files.load import load_rig_for

ROOT = Path(__file__).parents[1]
COVERED = 0.9  # of a reader's lines
MEMORY = 512 * 2**20  # bytes that a reader may take beyond what the program takes
SECONDS = 10.0  # of processor time that a file may take, with each line watched
LONGEST = 400  # characters of a message without the names of files
BATCH = 100  # files between two reports of a child
VALUES = re.compile(r"'.*?'|[-+]?[\d.]+(e[-+]?\d+)?|(\S+ and )?\S+\.(json|yml|xml|yaml|mat|txt)\S*")

Lines = set[tuple[str, int]]


@dataclass
class Outcome:
    """What became of a reader's files."""

    taken: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    reached: Lines = field(default_factory=set)
    failures: dict[str, int] = field(default_factory=dict)  # what went wrong, and the number of the first such file
    peak_bytes: int = 0
    slowest: float = 0.0

    @property
    def files(self) -> int:
        """How many files were tried."""
        return self.taken + sum(self.refused.values()) + len(self.failures)


def make_case(reader: Reader, seed: int, number: int) -> dict[str, bytes]:
    """The damaged files of a number; the first numbers are the seeds as they are."""
    if number < len(reader.seeds):
        return reader.seeds[number]
    chance = random.Random(f"{seed} {number}")
    case = dict(chance.choice(reader.seeds))
    name = chance.choice(sorted(case))
    others = [data for files in reader.seeds for data in files.values()]
    case[name] = mutate(chance, case[name], others)
    return case


def read(case: dict[str, bytes], folder: Path, number: int) -> str:
    """Load a case; empty if it was taken, else the reason in general words.

    Raises:
        Exception: the reader failed.
    """
    paths = [folder / name for name in case]
    for path, data in zip(paths, case.values(), strict=True):
        path.write_bytes(data)
    try:
        rig = _load(paths, number % 12)
    except InputError as error:
        message = str(error).replace(f"{folder}/", "")
        if "\n" in message or len(message) > LONGEST:
            raise AssertionError(f"a message of {len(message)} characters or several lines: {message!r:.80}") from None
        return " ".join(VALUES.sub("#", message).split())[:72]
    back = sg.load_rig(*sg.save_rig(rig, folder / "back.json"))
    before, after = (
        np.concatenate([one.R.ravel(), one.T, one.left.distortion, one.right.matrix.ravel()]) for one in (rig, back)
    )
    if not (np.isfinite(before).all() and before.tobytes() == after.tobytes()):
        raise AssertionError(f"a rig was taken that is not finite or not the same when saved: {rig.T}")
    return ""


def _load(paths: list[Path], way: int) -> sg.Rig:
    """Load files in one of twelve ways, so that every option meets every damage."""
    if way == 0 and len(paths) > 1:
        return sg.load_rig(paths[0].parent)
    if way == 1 and len(paths) == 1:
        return load_rig_for(paths[0], np.zeros((480, 640), np.uint8))
    size = None if way % 2 else ((640, 480), (640, 480), (1242, 375))[way % 3]
    return sg.load_rig(*paths, size=size, unit="m" if way == 5 else None, cameras=(0, 1) if way == 7 else None)


def code_lines(reader: Reader) -> Lines:
    """The lines of a reader's functions, but for those that only say how a function is called."""
    found: Lines = set()

    def walk(code: CodeType, file: str) -> None:
        for part in code.co_consts:
            if isinstance(part, CodeType) and part.co_name not in reader.passed_over:
                if part.co_flags & 0x2:  # a function, not a class
                    lines = {line for *_, line in part.co_lines() if line}
                    found.update((file, line) for line in lines - {part.co_firstlineno})
                walk(part, file)

    for module in reader.modules:
        file = str(ROOT / "stereo_gpu" / f"{module}.py")
        walk(compile(Path(file).read_bytes(), file, "exec", dont_inherit=True), file)
    return found


def _watch(reader: Reader, reached: Lines) -> Any:
    """A trace function that keeps the lines of the reader's modules and of those that all readers share."""
    files = {str(ROOT / "stereo_gpu" / f"{module}.py") for module in {*reader.modules, *SHARED}}

    def local(frame: FrameType, event: str, _: object) -> Any:
        if event == "line":
            reached.add((frame.f_code.co_filename, frame.f_lineno))
        return local

    return lambda frame, _event, _: local if frame.f_code.co_filename in files else None


def _child(reader: Reader, seed: int, numbers: range, until: float, current: Any, answers: Connection) -> None:
    """Read the files of `numbers` until the time is over; report after each batch."""
    logging.disable(logging.WARNING)  # of what was rounded, thousands of times
    np.seterr(divide="raise", over="raise", invalid="raise")  # a warning of NumPy's would reach the user's terminal
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as name:
        for batch in range(numbers.start, numbers.stop, BATCH):
            if time.monotonic() > until:
                break
            outcome = Outcome()
            sys.settrace(_watch(reader, outcome.reached))
            for number in range(batch, min(batch + BATCH, numbers.stop)):
                current.value = number
                case = make_case(reader, seed, number)
                signal.setitimer(signal.ITIMER_PROF, SECONDS)  # its signal ends the process, whatever it is doing
                began = time.process_time()
                try:
                    reason = read(case, Path(name), number)
                except BaseException as error:
                    outcome.failures.setdefault(f"{type(error).__name__}: {error!s:.100}", number)
                else:
                    outcome.taken += not reason
                    outcome.refused.update([reason] if reason else [])
                signal.setitimer(signal.ITIMER_PROF, 0)
                outcome.slowest = max(outcome.slowest, time.process_time() - began)
            sys.settrace(None)
            outcome.peak_bytes = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
            answers.send(outcome)
    answers.send(None)


def fuzz(reader: Reader, seconds: float, seed: int, files: int = sys.maxsize) -> Outcome:
    """Try at most `files` files on one reader; a child that dies is noted and the next one goes on behind the file."""
    context = multiprocessing.get_context("fork")
    total, start, until = Outcome(), 0, time.monotonic() + seconds
    while True:
        ours, theirs = context.Pipe(duplex=False)
        current = context.Value("Q", start, lock=False)
        child = context.Process(target=_child, args=(reader, seed, range(start, files), until, current, theirs))
        child.start()
        theirs.close()
        try:
            while (outcome := ours.recv()) is not None:
                total.taken += outcome.taken
                total.refused += outcome.refused
                total.reached |= outcome.reached
                total.failures = outcome.failures | total.failures
                total.peak_bytes = max(total.peak_bytes, outcome.peak_bytes)
                total.slowest = max(total.slowest, outcome.slowest)
        except EOFError:  # it died
            child.join()
            told = "took too long" if child.exitcode == -signal.SIGPROF else f"died with exit status {child.exitcode}"
            total.failures.setdefault(told, current.value)
            start = current.value + 1
        else:
            child.join()
            return total


def report(name: str, reader: Reader, outcome: Outcome, reasons: int) -> float:
    """Print a reader's part of the table; the share of its own lines that was reached."""
    print(
        f"{name:12} {outcome.files:7} {outcome.taken / max(1, outcome.files):7.1%} {len(outcome.refused):8}"
        f" {outcome.peak_bytes / 2**20:8.0f} {outcome.slowest:10.2f} {len(outcome.failures):9}",
        end="",
    )
    share = report_lines(reader, outcome.reached, bool(reasons))
    for reason, count in outcome.refused.most_common(reasons):
        print(f"    {count / outcome.files:6.1%} {reason}")
    return share


def report_lines(reader: Reader, reached: Lines, whole: bool) -> float:
    """Print the share of the lines that was reached, if `whole` with the numbers of those that were not."""
    lines = code_lines(reader)
    share = len(lines & reached) / len(lines)
    print(f" {share:7.1%} of {len(lines)} lines", flush=True)
    missed: dict[str, list[int]] = {}
    for file, line in sorted(lines - reached):
        missed.setdefault(Path(file).relative_to(ROOT).as_posix(), []).append(line)
    for file, numbers in missed.items() if whole else ():
        print(f"    not reached: {file} {', '.join(map(str, numbers))}")
    return share


def main(arguments: list[str] | None = None) -> int:
    """Fuzz the readers that are asked for."""
    known = readers()
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=120, help="in all (%(default)s)")
    parser.add_argument("--files", type=int, default=sys.maxsize, help="at most so many of each reader")
    parser.add_argument("--seed", type=int, default=1, help="of the damage (%(default)s)")
    parser.add_argument("--reader", action="append", choices=sorted(known), help="only this one; may stand repeatedly")
    parser.add_argument("--reasons", type=int, default=6, help="how many of the most frequent to show (%(default)s)")
    parser.add_argument("--keep", type=Path, default=Path("fuzz_finds"), help="folder for what made a reader fail")
    options = parser.parse_args(arguments)
    chosen = options.reader or list(known)
    failed = False
    print("reader         files   taken  reasons  peak MB  slowest s  failures  reached")
    reached: Lines = set()
    for name in chosen:
        reader = known[name]
        outcome = fuzz(reader, options.seconds / len(chosen), options.seed, options.files)
        reached |= outcome.reached
        failed |= report(name, reader, outcome, options.reasons) < COVERED or bool(outcome.failures)
        for told, number in outcome.failures.items():
            folder = options.keep / f"{name.replace(' ', '_')}_{options.seed}_{number}"
            folder.mkdir(parents=True, exist_ok=True)
            for file, data in make_case(reader, options.seed, number).items():
                (folder / file).write_bytes(data)
            print(f"    FAILED, kept in {folder}: {told}")
    if not options.reader:
        print(f"{'all together':78}", end="")
        failed |= report_lines(Reader(SHARED, []), reached, bool(options.reasons)) < COVERED
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
