"""Run the benchmark and write docs/performance.md, docs/performance.json and their pictures from it.

With --load FILE nothing is timed: the page is written anew from a run that `stereo-gpu bench --json FILE` kept.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from stereo_gpu.bench import BenchOptions, run_bench
from stereo_gpu.bench.machine import DeviceFacts
from stereo_gpu.bench.plot import check_plotting, write_plots
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.report import COLUMNS, machine_lines, number, operations_words, row_cells
from stereo_gpu.bench.row import OPENCV, Row
from stereo_gpu.errors import StereoError
from stereo_gpu.files import write_whole

ROOT = Path(__file__).parents[1]
MATCHERS = ("ncc_wta", "match fast", "match paper", "match precise")
PICTURES = ("peers", "speed", "roofline")

INTRODUCTION = """# Performance

`tools/performance` runs the benchmark and writes this page; the run itself is in
[performance.json](performance.json). Do not edit the page: its words stand in `tools/performance.py`.
"""

CALM_SECONDS = 5.0  # for each case; with fewer, or with a load over 1 a core, a run is a quick one
RATIOS = """## Ratios

Wall time over that of the OpenCV function that does the same, timed in turn in the same run on the same input: under
1 is faster than OpenCV. OpenCV has all its threads, and was called as [listed below](#what-opencv-was-called-with).
A kernel works on arrays that are on the device; `match PROFILE` is the whole call of `sg.match`, arrays of the host
in and out.

![Ratios to OpenCV](images/performance_peers.png)
"""

AFTER_RATIOS = """StereoBM sums absolute differences of 8-bit values; `ncc_wta` gives the zero-mean normalized
correlation, the sub-pixel peak, how sure it is, and the other view's winners. `match precise` is held against
`StereoSGBM` with 8 paths, and walks 16 (8 for each of two slopes). A kernel that is not listed has no counterpart in
OpenCV.
"""

READING = """## How to read it

- **GDE/s**: giga disparity evaluations a second, W x H x D over the time; of a kernel the time on the device, of a
  whole call the wall time.
- **device ms**: by the device's own clock (OpenCL and CUDA events; Warp on the CPU has no events, its launches end when
  they return). **wall ms**: until the result is there. **copies ms**: to and from the device, measured apart.
- **spread**: range of the samples that were kept, over the median.
- **GB/s**: each input and output of the kernel once, as column **bytes** counts them, over the time on the device.
  **of copy**: over what a copy of a large array reaches. Over 100 % means that caches hold the data; a small share,
  that something else bounds the kernel, such as its arithmetic.
- **x StereoBM**: wall time over that of plain StereoBM, to compare runs with.

The roofline counts, as column **operations** does, the additions, multiplications and comparisons of each kernel's
formula, with running sums for windows. On the CPU its roofs are what NumPy reaches with all cores: a copy in one
thread a core, and a float32 matrix product with fused multiply-adds. Our kernels do not fuse (see
[kernels.md](kernels.md#why-the-devices-agree)), so the flat roof is what the processor can do, not what they could.
"""

RUN_IT = """## Run it yourself

```sh
stereo-gpu bench                                        # every device, three sizes: the better part of an hour
stereo-gpu bench --seconds 0.5 --cap 15                 # the same in minutes, with wider spreads
stereo-gpu bench --size 1280,960,128 --backend opencl   # one size, one device; both may be given more than once
stereo-gpu bench --only ncc_wta fast "SGBM HH"          # some kernels, profiles or matchers
stereo-gpu bench --json new.json --plot plots           # keep it; draw it (pip install 'stereo-gpu[plot]')
stereo-gpu bench --compare docs/performance.json        # what got slower; exit status 1 past the limit
stereo-gpu bench --load new.json --compare old.json     # two runs that are there already
tools/performance --seconds 0.5 --cap 15                # write this page
```

`--compare` holds each kernel's and profile's time over that of StereoBM against the older run's, not the times
themselves: the same machine is faster on one day than on another, and StereoBM with it. `--limit 1.15`, the default,
lets a case become 15 % slower. On a busy machine that is not much; run again before you believe it. A case
that ran in the older run and fails now counts as slower too; one that you did not ask for, or that `--cap` left out,
does not.

`--plot DIR` writes `roofline.png`, `speed.png`, `peers.png`, and `bench.html`, one page with everything that opens
offline.

No GPU was at hand for the figures here. If you have one, run `stereo-gpu bench --json FILE` and open an issue with the
file attached.
"""

REST = """## Where the time of a reconstruction goes

`result.json` and the report give the seconds of every stage. The first run on a machine also compiles the kernels.

## Memory

| profile | volumes held on the device |
| --- | --- |
| `fast` | none; the fused kernel keeps scratch that grows with strips x disparities (and, in Warp, width) |
| `paper` | W x H x D x 4 bytes |
| `precise` | W x H x D x 3 bytes |

All need about 90 bytes a pixel besides, `precise` 112. A match that does not fit is refused before memory is
taken, and the benchmark says so in its row.
"""


def markdown(run: BenchRun) -> str:
    """The whole page."""
    parts = [INTRODUCTION, *quick(run), RATIOS]
    parts += ["\n".join(ratio_table(run, facts)) + "\n" for facts in run.devices]
    parts += [AFTER_RATIOS]
    if missing := "\n".join(not_run(run)):
        parts += [f"What was not run:\n\n{missing}\n"]
    parts += ["\n".join(machine(run)) + "\n", "\n".join(speeds(run)) + "\n"]
    parts += ["\n".join(kernels(run)) + "\n", READING, "\n".join(method(run)) + "\n", "\n".join(settings(run)) + "\n"]
    parts += [RUN_IT, REST]
    return "\n".join(parts)


def quick(run: BenchRun) -> Iterator[str]:
    """A sentence that warns of noisy figures, where they are."""
    seconds, load, cores = run.method["seconds"], run.machine.get("load_average"), run.machine["cores"]
    why = [f"{seconds:g} s a case where {CALM_SECONDS:g} s are usual"] if seconds < CALM_SECONDS else []
    if load is not None and load > cores:
        why.append(f"a load of {load:.1f} on {cores} cores before it began")
    if why:
        yield f"**A quick run: {', and '.join(why)}, so single figures may be far off.**\n"


def ratio_table(run: BenchRun, facts: DeviceFacts) -> Iterator[str]:
    """Ratios of a device, a column a size."""
    rows = [row for row in run.rows if row.device == facts.name and row.peer]
    yield f"| `{facts.name}` | over OpenCV's | {' | '.join(size_words(size) for size in run.sizes)} |"
    yield f"| --- | --- |{' ---: |' * len(run.sizes)}"
    for name in dict.fromkeys(row.name for row in rows):
        by_size = {row.size: row for row in rows if row.name == name}
        peer = next(iter(by_size.values())).peer
        cells = (ratio_words(by_size.get(size)) for size in run.sizes)
        yield f"| `{name}` | {peer} | {' | '.join(cells)} |"


def ratio_words(row: Row | None) -> str:
    """A ratio, or why there is none."""
    if row is None:
        return "-"
    if row.wall is None or row.to_peer is None:
        return "not run" if row.wall is None else "-"
    return number(row.to_peer) + (" (once)" if row.wall.repeats == 1 else "")


def not_run(run: BenchRun) -> Iterator[str]:
    """Why cases were left out."""
    for row in run.rows:
        if row.wall is None:
            yield f"- `{row.name}` on `{row.device}`, {size_words(row.size)}: {row.note.removeprefix('not run: ')}."


def machine(run: BenchRun) -> Iterator[str]:
    """What it ran on."""
    yield "## The machine"
    yield ""
    for line in machine_lines(run.machine):
        yield f"- {line}"
    for facts in run.devices:
        yield f"- `{facts.name}`: {facts.device}; driver: {facts.driver}; compiler: {facts.compiler}."
        speeds = f"{facts.copy_bytes_s / 1e9:.0f} GB/s, computes {facts.operations_s / 1e9:,.0f} Gop/s"
        yield f"  Copies {speeds}: {facts.roofs}."
    yield f"- Started {run.started}, took {run.took / 60:.0f} minutes."


def speeds(run: BenchRun) -> Iterator[str]:
    """How every matcher compares with StereoBM, the fastest first."""
    yield "## Speed of the matchers"
    yield ""
    yield "Times the speed of StereoBM, timed in turn with it, and in brackets GDE/s at that moment. On a busy machine"
    yield "moments differ, so compare the first figure."
    yield ""
    yield "![Speeds of the matchers](images/performance_speed.png)"
    yield ""
    yield f"| | device | {' | '.join(size_words(size) for size in run.sizes)} |"
    yield f"| --- | --- |{' ---: |' * len(run.sizes)}"
    rows = [row for row in run.rows if row.device == OPENCV or row.name in MATCHERS]
    best: dict[tuple[str, str], float] = {}
    for row in rows:
        best[row.name, row.device] = max(best.get((row.name, row.device), 0.0), 1 / (row.to_stereobm or math.inf))
    for name, device in sorted(best, key=lambda key: -best[key]):
        by_size = {row.size: row for row in rows if (row.name, row.device) == (name, device)}
        yield f"| {name} | {device} | {' | '.join(speed_words(by_size.get(size)) for size in run.sizes)} |"


def speed_words(row: Row | None) -> str:
    """As 1.64 (2.40)."""
    if row is None or not row.to_stereobm or not row.evaluations_s:
        return "-"
    return f"{number(1 / row.to_stereobm)} ({number(row.evaluations_s / 1e9)})"


def kernels(run: BenchRun) -> Iterator[str]:
    """Everything that was timed at the middle size."""
    size = run.sizes[len(run.sizes) // 2]
    yield f"## Every kernel and profile, {size_words(size)}, window {run.window}"
    yield ""
    yield "The other sizes are in [performance.json](performance.json)."
    yield ""
    yield "![Roofline](images/performance_roofline.png)"
    for facts in run.devices:
        yield ""
        names = " | ".join(name for name, _ in COLUMNS)
        yield f"| `{facts.name}` | {names} | bytes | operations |"
        yield "| --- |" + " ---: |" * len(COLUMNS) + " --- | --- |"
        for row in run.rows:
            if row.device == facts.name and row.size == size:
                yield kernel_line(run, row)


def kernel_line(run: BenchRun, row: Row) -> str:
    """One line of such a table."""
    if row.wall is None:
        return f"| `{row.name}` | not run |{' |' * (len(COLUMNS) + 1)}"
    cells = (*row_cells(row, run.facts(row.device)), row.formula, operations_words(row))
    return f"| `{row.name}` | {' | '.join(cells)} |"


def method(run: BenchRun) -> Iterator[str]:
    """How it was timed."""
    how = run.method
    yield "## Method of this run"
    yield ""
    yield (
        "- The pair is random texture on a slope, 8 bits, with disparities from 0.1 D to 0.8 D. Each kernel gets the"
        "\n  arguments with which its own stage launches it."
    )
    yield (
        "- Ours, its peer and StereoBM take turns: the one that has had the smallest part of its time goes next, so"
        "\n  that whatever else the machine does falls on all of them."
    )
    yield (
        f"- {how['warm_up_seconds']:g} s to warm up, then at least {how['seconds']:g} s and {how['repeats']:g} repeats"
        f" each (StereoBM, where it is not the peer,\n  {how['stereobm_share']:.0%} of the seconds). The upper and"
        f" lower {how['dropped_at_either_end']:.0%} are dropped; what is shown is the median."
    )
    yield (
        f"- A case takes at most {how['cap_seconds']:g} s, as long as {how['fewest_repeats']:g} repeats fit; a slower"
        " one is measured once, and not at all if a\n  smaller size says that one run would take longer."
    )
    yield "- Everything runs once on a small pair first, so that no compiler runs while a clock does."


def settings(run: BenchRun) -> Iterator[str]:
    """What OpenCV's functions were called with."""
    yield "## What OpenCV was called with"
    yield ""
    yield "| | |"
    yield "| --- | --- |"
    for name, words in run.peers.items():
        yield f"| {name} | {words.replace('*', chr(92) + '*')} |"


def size_words(size: tuple[int, int, int]) -> str:
    """As 1280 x 960 x 128."""
    return "{} x {} x {}".format(*size)


def main() -> int:
    """Write the page; the exit status is 1 where that fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=5.0, help="to time each thing at least (%(default)s)")
    parser.add_argument("--cap", type=float, default=60.0, help="seconds to time each thing at most (%(default)s)")
    parser.add_argument("--backend", action="append", default=[], help="a device; by default every one")
    parser.add_argument("--load", type=Path, help="a run that was kept, in place of a new one")
    parser.add_argument("--docs", type=Path, default=ROOT / "docs", help="folder to write to (docs)")
    options = parser.parse_args()
    try:
        check_plotting()
        if options.load:
            run = BenchRun.load(options.load)
        else:
            wanted = BenchOptions(seconds=options.seconds, cap=options.cap, backends=tuple(options.backend))
            run = run_bench(wanted, partial(print, flush=True))
        with tempfile.TemporaryDirectory() as folder:
            write_plots(run, Path(folder))
            for name in PICTURES:
                picture = (Path(folder) / f"{name}.png").read_bytes()
                write_whole(options.docs / "images" / f"performance_{name}.png", picture)
        run.save(options.docs / "performance.json")
        print(f"wrote {write_whole(options.docs / 'performance.md', markdown(run))}")
    except StereoError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
