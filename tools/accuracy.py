"""Measure how wrong every profile and OpenCV's matchers are, and write the tables of docs/accuracy.md.

What stands between marks in that page comes from here; the words around them are written by hand.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2

from stereo_gpu.backends import open_backend
from stereo_gpu.bench.plot import check_plotting
from stereo_gpu.errors import StereoError
from stereo_gpu.evaluation.accuracy import (
    BoardResult,
    PairResults,
    board_files,
    calibrate_boards,
    found_range,
    measure_boards,
    measure_pair,
)
from stereo_gpu.evaluation.accuracy_tables import (
    board_tables,
    confidence_table,
    cost_table,
    light_table,
    pair_table,
    range_table,
)
from stereo_gpu.evaluation.cost import BENCH_SIZE, bench_pair, measure_costs
from stereo_gpu.evaluation.matchers import AUTO, Matcher, opencv_matchers, our_matchers
from stereo_gpu.evaluation.mesh_tables import mesh_section
from stereo_gpu.evaluation.pairs import PAIRS, load_pair
from stereo_gpu.evaluation.sections import put_section
from stereo_gpu.evaluation.trade_plot import draw_trade
from stereo_gpu.files import write_whole

ROOT = Path(__file__).parents[1]
SECTIONS = ("pairs", "light", "boards", "range", "confidence", "meshes", "cost")
TIMED = ("tsukuba", "teddy", "motorcycle")
ALOE = ("aloe", "aloe, other exposure", "aloe, other light")
SECONDS, CAP = 0.8, 4.0  # to time each matcher on each input, at least and at most
PICTURE = "accuracy_time.png"


def main() -> int:
    """Write the page; the exit status is 1 where that fails."""
    options = read_options()
    try:
        if "cost" in options.sections:
            check_plotting()
        matchers = our_matchers(options.backend) + opencv_matchers()
        pairs = measure_pairs(options, matchers)
        boards = measure_all_boards(options, matchers) if {"boards", "range"} & options.sections else []
        made = {name: list(lines) for name, lines in sections(options, matchers, pairs, boards)}
        for lines in made.values():
            print("\n".join(lines), end="\n\n")
        if set(pairs) == set(wanted_pairs(options.sections)):
            write_page(options.docs / "accuracy.md", made)
        else:
            print("the page stays as it is: these are some of its pairs only")
    except StereoError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def read_options() -> argparse.Namespace:
    """The command line; `sections` are those to make."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(os.environ.get("STEREO_GPU_DATA", ROOT.parent / "shared" / "data")),
        help="folder of real pictures; by default STEREO_GPU_DATA",
    )
    parser.add_argument("--backend", help="where to compute, as `stereo-gpu devices` names it")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=SECTIONS, help="sections of the page to make")
    parser.add_argument("--no-timing", action="store_true", help="leave out what is timed, section cost")
    parser.add_argument("--pairs", nargs="+", choices=PAIRS, help="some pairs only; prints and leaves the page alone")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs", help="folder to write to (docs)")
    options = parser.parse_args()
    options.sections = set(options.only) - ({"cost"} if options.no_timing else set())
    return options


def wanted_pairs(wanted: set[str]) -> list[str]:
    """The pairs that these sections are about."""
    everything = {"range", "confidence"} & wanted
    some = (TIMED if {"pairs", "cost"} & wanted else ()) + (ALOE if "light" in wanted else ())
    return [name for name in PAIRS if everything or name in some]


def measure_pairs(options: argparse.Namespace, matchers: list[Matcher]) -> dict[str, PairResults]:
    """Every matcher on every pair that is wanted."""
    measured = {}
    for name in wanted_pairs(options.sections):
        if not options.pairs or name in options.pairs:
            print(f"measuring {name}", file=sys.stderr, flush=True)
            measured[name] = measure_pair(load_pair(options.data, name), matchers)
    return measured


def measure_all_boards(options: argparse.Namespace, matchers: list[Matcher]) -> list[BoardResult]:
    """Every matcher on every picture of the board."""
    files = board_files(options.data)
    print(f"measuring {len(files)} boards", file=sys.stderr, flush=True)
    return list(measure_boards(files, calibrate_boards(files), matchers, options.backend))


def sections(
    options: argparse.Namespace, matchers: list[Matcher], pairs: dict[str, PairResults], boards: list[BoardResult]
) -> Iterator[tuple[str, Iterable[str]]]:
    """Name and lines of each section that is wanted and can be made."""
    where = f"On {open_backend(options.backend).device}; OpenCV {cv2.__version__}."
    timed = {name: pairs[name] for name in TIMED if name in pairs}
    if "pairs" in options.sections:
        yield "pairs", [where, *(line for each in timed.values() for line in ("", *pair_table(each)))]
    if "light" in options.sections and set(ALOE) <= set(pairs):
        yield "light", light_table(pairs[ALOE[0]], [pairs[name] for name in ALOE[1:]])
    if "boards" in options.sections:
        yield "boards", board_tables(boards)
    if "range" in options.sections:
        found = [found_range(name, each.pair.truth, each.results[AUTO].found.search) for name, each in pairs.items()]
        yield "range", range_table(found, [board.range for board in boards])
    if "confidence" in options.sections:
        yield "confidence", confidence_table(list(pairs.values()))
    if "meshes" in options.sections and not options.pairs:
        print("measuring meshes", file=sys.stderr, flush=True)
        yield "meshes", [where, *mesh_section(options.data, options.backend)]
    if "cost" in options.sections:
        inputs = {"{} x {} x {}".format(*BENCH_SIZE): bench_pair()}
        inputs |= {name: (each.pair.left, each.pair.right, each.pair.search) for name, each in timed.items()}
        costs = {}
        for name, given in inputs.items():
            print(f"timing {name}", file=sys.stderr, flush=True)
            costs[name] = measure_costs(*given, matchers, seconds=SECONDS, cap=CAP)
        load = f"{where} {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}."
        yield "cost", [load, "", *cost_table(costs, timed), "", f"![Accuracy against time](images/{PICTURE})"]
        if timed:
            write_whole(options.docs / "images" / PICTURE, draw_trade(costs, timed, matchers))


def write_page(file: Path, made: dict[str, list[str]]) -> None:
    """Put the sections into the page."""
    page = file.read_text("utf-8")
    for name, lines in made.items():
        page = put_section(page, name, lines)
    print(f"wrote {write_whole(file, page)}: {', '.join(made)}")


if __name__ == "__main__":
    sys.exit(main())
