"""The command line: `stereo-gpu`. What it understands; every error is one line."""

from __future__ import annotations

import argparse
import io
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import NoReturn

from stereo_gpu.commands import (
    batch,
    bench,
    board,
    calibrate,
    capture,
    check,
    convert,
    demo,
    devices,
    doctor,
    match,
    reconstruct,
    rectify,
    render,
    serve,
)
from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.progress import CLEAR_LINE

COMMANDS = (
    demo,
    board,
    capture,
    calibrate,
    check,
    convert,
    rectify,
    match,
    reconstruct,
    batch,
    serve,
    render,
    devices,
    doctor,
    bench,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand; returns the exit status: 0, 2 for wrong input, 1 for any other failure."""
    try:
        options = _parser().parse_args(arguments)
    except SystemExit as done:  # help, version, or an argument that is wrong
        return int(done.code or 0)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Files may have names that the terminal's encoding cannot show.
        sys.stdout.reconfigure(errors="backslashreplace")
    with _messages(options.debug):
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    try:
        options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return _fail("interrupted; nothing was left half written", 130)
    except BrokenPipeError:
        # Whoever read our output has had enough, as `stereo-gpu devices | head -1` does; what is still buffered
        # must not fail again when Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except StereoError as error:
        if options.debug:
            raise
        return _fail(str(error), 2 if isinstance(error, InputError) else 1)
    except Exception as error:
        if options.debug:
            raise
        return _fail(f"{type(error).__name__}: {error} (this is a fault of ours: run again with --debug)", 1)
    return 0


class _Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line too."""

    def error(self, message: str) -> NoReturn:
        if message.endswith("expected one argument"):
            message += " (a value that begins with a minus needs an equals sign before it, as --disparities=-8,64)"
        self.exit(_fail(f"{message}; see {self.prog} --help", 2))


class _Version(argparse.Action):
    """Prints the version; it is looked up only then, which takes a tenth of the time that --help has."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print it and exit."""
        from importlib.metadata import version

        print(f"stereo-gpu {version('stereo-gpu')}")
        parser.exit()


class _OneLine(logging.Formatter):
    """Messages as one line each, over a progress bar where one is drawn."""

    def format(self, record: logging.LogRecord) -> str:
        clear = CLEAR_LINE if sys.stderr.isatty() else ""
        return f"{clear}stereo-gpu: {record.levelname.lower()}: {record.getMessage()}"


@contextmanager
def _messages(debug: bool) -> Iterator[None]:
    """Show what the library logs: warnings, or everything."""
    handler = logging.StreamHandler()
    handler.setFormatter(_OneLine())
    own = logging.getLogger("stereo_gpu")
    before = own.level
    own.addHandler(handler)
    own.setLevel(logging.DEBUG if debug else logging.WARNING)
    try:
        yield
    finally:
        own.removeHandler(handler)
        own.setLevel(before)


def _fail(message: str, status: int) -> int:
    print("stereo-gpu: error: " + " ".join(message.split()), file=sys.stderr)
    return status


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="stereo-gpu", description="Two cameras in, a textured metric 3-D model out.")
    parser.add_argument("--version", action=_Version, nargs=0, help="show the program's version and exit")
    subparsers = parser.add_subparsers(required=True, metavar="COMMAND")

    for command in COMMANDS:
        # The first line of a command's module is its help.
        text = (command.__doc__ or "").partition("\n")[0].rstrip(".")
        added = subparsers.add_parser(command.__name__.rpartition(".")[2], help=text, description=text)
        added.add_argument("--debug", action="store_true", help="show a traceback and all messages")
        command.add_options(added)
        added.set_defaults(run=command.run)
    return parser
