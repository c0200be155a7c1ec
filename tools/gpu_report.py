"""Print what compilers make of the kernels on GPUs and bounds on their speed, and measure where there is a GPU.

Exits with 1 where a kernel spills registers, calls what the compiler does not know, or is a hot one whose registers and
shared memory leave a GPU less than half full.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from gpu_chips import CHIPS, bound
from gpu_compile import (
    ARGUMENTS,
    DISPARITIES,
    HEIGHT,
    KERNELS,
    WIDTH,
    WINDOW,
    Compiled,
    compile_for_amd,
    compile_for_cuda,
)

from stereo_gpu.backends import devices
from stereo_gpu.backends.share import usable_cores
from stereo_gpu.bench import BenchOptions, run_bench
from stereo_gpu.errors import StereoError
from stereo_gpu.kernels.costs import cost
from stereo_gpu.kernels.geometry import geometry

HOT = ("ncc_wta", "aggregate", "ncc_volume", "wta", "match_cost", "lowest", "evidence", "median")
FULL_ENOUGH = 0.5
# What hides its waiting by itself needs less: `aggregate` asks for memory four steps ahead, and with 28 % of an H100
# filled it is 3.4 times as fast there as the form that waited and filled half.
FULL_ENOUGH_OF = {"aggregate": 0.2}
KEPT = Path("gpu_report.json")


def main() -> int:
    """Print the report and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cuda", action="store_true", help="the Warp kernels on NVIDIA's architectures alone")
    parser.add_argument("--amd", action="store_true", help="the OpenCL kernels on AMD's architectures alone")
    options = parser.parse_args()
    found: list[Compiled] = []
    for wanted, title, compile_one in (
        (options.cuda or not options.amd, "CUDA: Warp's kernels", compile_for_cuda),
        (options.amd or not options.cuda, "AMD: the OpenCL kernels", compile_for_amd),
    ):
        if wanted:
            half = compile_all(compile_one)
            print_lines(compiled_lines(title, half))
            found += half
    print_lines(bound_lines())
    print_lines(measured_lines())
    wrong = list(faults(found))
    print_lines(wrong)
    return 1 if wrong else 0


def compile_all(compile_one: Callable[[str], list[Compiled]]) -> list[Compiled]:
    """Compile every kernel, as many at a time as there are cores; the order is the kernels'."""
    # Warp and its threads must not be forked.
    with ProcessPoolExecutor(usable_cores(), mp_context=get_context("spawn")) as pool:
        return [one for several in pool.map(compile_one, KERNELS) for one in several]


def compiled_lines(title: str, found: Sequence[Compiled]) -> Iterable[str]:
    """A table with a row a kernel and a column an architecture."""
    columns = list(dict.fromkeys(one.architecture for one in found))
    yield f"{title}: registers / bytes spilled / bytes of shared memory / occupancy"
    yield ""
    yield "| kernel | " + " | ".join(columns) + " |"
    yield "| --- |" + " ---: |" * len(columns)
    for kernel in dict.fromkeys(one.kernel for one in found):
        cells = (
            f"{one.registers} / {one.spilled} / {one.shared} / {one.occupancy:.0%}" + (" calls!" if one.calls else "")
            for one in found
            if one.kernel == kernel
        )
        yield f"| {kernel} | " + " | ".join(cells) + " |"
    yield ""


def bound_lines() -> Iterable[str]:
    """A table of what the hot kernels take, and how many cells or pixels a second each chip could do at most."""
    yield f"Bounds at {WIDTH} x {HEIGHT} x {DISPARITIES}, window {WINDOW}: giga cells (GDE) or pixels a second"
    yield ""
    yield "| kernel | per | bytes | words | numbers | whole numbers | " + " | ".join(c.name for c in CHIPS) + " |"
    yield "| --- | --- |" + " ---: |" * (4 + len(CHIPS))
    for kernel in HOT:
        cells: list[str] = []
        for chip in CHIPS:
            rows = geometry(kernel, chip.language, "gpu", ARGUMENTS, chip.units).scalars.get("rows", HEIGHT)
            work = cost(kernel, chip.language, DISPARITIES, WINDOW, rows)
            rate, why = bound(chip, moved=work.bytes, words=work.words, floats=work.floats, integers=work.integers)
            if not cells:
                counts = (work.bytes, work.words, work.floats, work.integers)
                cells = [work.per, *(f"{count:.3g}" for count in counts)]
            cells.append(f"{rate / 1e9:.3g} ({why})")
        yield f"| {kernel} | " + " | ".join(cells) + " |"
    yield ""
    yield "Bytes, words of shared memory and operations for each cell or pixel are those of the first chip's form."
    yield from (f"{chip.name}: {chip.source}." for chip in CHIPS)
    yield ""


def measured_lines() -> Iterable[str]:
    """What a GPU really does, where there is one; the run is kept in a file."""
    gpus = tuple(status.name for status in devices() if status.kind == "gpu" and status.available)
    if not gpus:
        yield "No GPU is here: nothing was measured."
        return
    size = ((WIDTH, HEIGHT, DISPARITIES),)
    try:
        run = run_bench(BenchOptions(sizes=size, window=WINDOW, backends=gpus, only=HOT, seconds=2.0), print)
    except StereoError as error:
        yield f"The GPU could not be measured: {error}"
        return
    run.save(KEPT)
    yield ""
    yield "| kernel | device | ms | giga cells (GDE) or pixels a second |"
    yield "| --- | --- | ---: | ---: |"
    for row in run.rows:
        if row.seconds:
            work = WIDTH * HEIGHT * (DISPARITIES if row.per == "cell" else 1)
            yield f"| {row.name} | {row.device} | {row.seconds * 1e3:.3f} | {work / row.seconds / 1e9:.3g} |"
    yield ""
    yield f"The run is in {KEPT}; docs/gpu.md says where to send it."


def faults(found: Sequence[Compiled]) -> Iterable[str]:
    """A line for each kernel that is not as it should be."""
    for one in found:
        where = f"{one.kernel} on {one.architecture}"
        if one.spilled:
            yield f"{where} spills {one.spilled} bytes of registers: give it fewer values to hold at once"
        if one.calls:
            yield f"{where} makes {one.calls} calls: its figures say nothing of what they take"
        enough = FULL_ENOUGH_OF.get(one.kernel, FULL_ENOUGH)
        if one.kernel in HOT and one.occupancy < enough:
            yield f"{where} fills {one.occupancy:.0%} of the GPU, under {enough:.0%}: spare registers or memory"


def print_lines(lines: Iterable[str]) -> None:
    """Print lines as they become known."""
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
