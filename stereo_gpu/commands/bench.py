"""Time every kernel and profile, and OpenCV's functions in turn with them."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereo_gpu.commands.arguments import numbers
from stereo_gpu.errors import StereoError


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes."""
    parser.add_argument(
        "--size",
        type=numbers(int, 3),
        action="append",
        metavar="W,H,D",
        help="width, height and disparities; may be given more than once (640,480,64 1280,960,128 2560,1920,256)",
    )
    parser.add_argument("--window", type=int, default=11, help="side of the window, px (%(default)s)")
    parser.add_argument(
        "--backend", action="append", help="where to compute, as `devices` names it; more than once; default: all"
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="kernels, profiles or OpenCV's matchers")
    parser.add_argument("--seconds", type=float, default=5.0, help="to time each thing at least (%(default)s)")
    parser.add_argument("--cap", type=float, default=60.0, help="seconds to time each thing at most (%(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the run to this file")
    parser.add_argument("--load", type=Path, metavar="FILE", help="take such a file instead of timing anything")
    parser.add_argument("--compare", type=Path, metavar="OLD.json", help="tell what got slower; exit 1 past the limit")
    parser.add_argument(
        "--limit", type=float, default=1.15, help="how many times slower a case may have become (%(default)s)"
    )
    parser.add_argument("--plot", type=Path, metavar="DIR", help="folder for a roofline, bar charts and a page")


def run(options: argparse.Namespace) -> None:
    """Print times beside those of OpenCV, keep them, compare them with older ones, and draw them."""
    from functools import partial

    from stereo_gpu.bench import SIZES, BenchOptions, check_bench_options, run_bench
    from stereo_gpu.bench.compare import check_limit, compare, comparison_lines
    from stereo_gpu.bench.record import BenchRun
    from stereo_gpu.bench.report import report_lines
    from stereo_gpu.files import check_writable, check_writable_file

    wanted = BenchOptions(
        sizes=tuple(options.size or SIZES),
        window=options.window,
        backends=tuple(options.backend or ()),
        only=tuple(options.only),
        seconds=options.seconds,
        cap=options.cap,
    )
    # Nothing may turn out to be wrong after half an hour.
    check_bench_options(wanted)
    check_limit(options.limit)
    old = BenchRun.load(options.compare) if options.compare else None
    if options.json:
        check_writable_file(options.json)
    if options.plot:
        from stereo_gpu.bench.plot import check_plotting, write_plots

        check_plotting()
        check_writable(options.plot)
    say = partial(print, flush=True)
    if options.load:
        run = BenchRun.load(options.load)
        for line in report_lines(run):
            say(line)
    else:
        run = run_bench(wanted, say)
    if options.json:
        run.save(options.json)
    if options.plot:
        for path in write_plots(run, options.plot):
            say(f"wrote {path}")
    if old:
        found = compare(old, run, options.limit)
        for line in comparison_lines(found):
            say(line)
        complaints = []
        if found.slower:
            names = ", ".join(dict.fromkeys(change.row.name for change in found.slower))
            complaints.append(
                f"{len(found.slower)} of {len(found.changes)} cases are over {options.limit:g} times slower than in"
                f" {options.compare}: {names}; run again on a quiet machine to be sure"
            )
        if found.stopped:
            reasons = "; ".join(dict.fromkeys(f"{row.name} ({row.note or 'no reason given'})" for row in found.stopped))
            complaints.append(f"{len(found.stopped)} cases that ran in {options.compare} run no more: {reasons}")
        if complaints:
            raise StereoError("; ".join(complaints))
