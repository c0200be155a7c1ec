"""Time whole chains, raw pairs to textured GLBs: `stereo-gpu batch`, and what a user would write instead.

The pairs are the built-in scene, 640 x 480, textured anew by different seeds, each of them under another light and with
its own sensor noise, rendered once to a temporary folder. Every chain starts in a fresh process and is timed whole,
start included: wall time, and the processor's time of all its processes. Then come single reconstructions from a cold
start, and `--help`.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from stereo_gpu.backends import open_backend
from stereo_gpu.backends.share import usable_cores
from stereo_gpu.bench.machine import describe_machine
from stereo_gpu.errors import StereoError
from stereo_gpu.images import write_png
from stereo_gpu.read_model import read_glb
from stereo_gpu.rig import Rig
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_render import render_pair

SIZE = (640, 480)
SMALLEST, DISPARITIES, FACES = 40, 64, 20_000
SCENES = 4  # rendered, which takes some seconds each; the rest are variations of these
NOISE = 0.7  # grey levels that each variation adds to the sensor's own
PROGRAM = [sys.executable, "-c", "import sys; from stereo_gpu.cli import main; sys.exit(main())"]
OPTIONS = ["--profile", "fast", "--disparities", f"{SMALLEST},{DISPARITIES}", "--faces", str(FACES)]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long a program took.

    Args:
        wall: seconds from its start to its end.
        cpu: seconds of the processor, of it and all that it started and waited for.
        peak: largest memory of one of its processes, bytes.
        said: its standard output.
    """

    wall: float
    cpu: float
    peak: int
    said: str


def main() -> int:
    """Make the pairs, time every chain, print the figures; exit status 1 where a chain fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=200, help="for our chains (%(default)s)")
    parser.add_argument("--user-pairs", type=int, default=40, help="for the user's, the first of them (%(default)s)")
    parser.add_argument("--starts", type=int, default=5, help="cold starts of which the median counts (%(default)s)")
    parser.add_argument("--backend", help="of our chains; by default the best device")
    parser.add_argument("--workers", type=int, help="of our chains; by default one a core")
    options = parser.parse_args()
    try:
        device = open_backend(options.backend)
        with tempfile.TemporaryDirectory() as folder:
            _report(options, device.name, device.device, Path(folder))
    except StereoError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def _report(options: argparse.Namespace, backend: str, device: str, folder: Path) -> None:
    rig = make_pairs(folder / "pairs", options.pairs)
    rig.save(folder / "rig.json")
    write_for_opencv(rig, folder / "rig.yml")
    few = folder / "few"
    few.mkdir()
    for number in range(min(options.user_pairs, options.pairs)):
        for side in ("left", "right"):
            (few / f"{side}{number:04d}.png").symlink_to(folder / "pairs" / f"{side}{number:04d}.png")
    cores, machine = usable_cores(), describe_machine()
    print(f"{SIZE[0]} x {SIZE[1]} x {DISPARITIES}, about {FACES} triangles; {cores} cores, {machine['processor']};")
    print(f"{device}; OpenCV {machine['opencv']}")
    print(f"pairs: {min(options.pairs, SCENES)} rendered scenes, and these again under other light, with more noise")
    print(f"load average before it began: {os.getloadavg()[0]:.1f}\n")
    print("| chain | pairs | pairs/s | CPU s a pair | largest process, MB | triangles |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    ours = ["--rig", str(folder / "rig.json"), "--backend", backend, *OPTIONS]
    rates = {}
    # A small batch first, so that no compiler runs while a clock does.
    run_timed([*PROGRAM, "batch", str(few), *ours, "--unwrap", "charts", "--out", str(folder / "warm")])
    for unwrap in ("view", "charts"):
        out = folder / unwrap
        more = [] if options.workers is None else ["--workers", str(options.workers)]
        timing = run_timed(
            [*PROGRAM, "batch", str(folder / "pairs"), *ours, "--unwrap", unwrap, "--out", str(out), *more]
        )
        models = sorted(out.glob("*/model.glb"))
        if len(models) != options.pairs:
            raise StereoError(f"{len(models)} models of {options.pairs} pairs: {timing.said}")
        triangles = statistics.median(len(read_glb(model).faces) for model in models[:: max(1, len(models) // 9)])
        rates[unwrap] = _row(f"`stereo-gpu batch --unwrap {unwrap}`", options.pairs, timing, triangles)
        shutil.rmtree(out)
    script = [sys.executable, str(Path(__file__).with_name("user_chain.py")), str(few), str(folder / "rig.yml")]
    for name, processes in (("one process", 1), (f"a pool of {cores}", cores)):
        out = folder / f"user{processes}"
        out.mkdir(exist_ok=True)
        timing = run_timed([*script, str(out), str(processes)])
        rates[name] = _row(f"user's, {name}", len(list(out.glob("*.glb"))), timing, float(timing.said))
        shutil.rmtree(out)
        if cores == 1:
            break
    print()
    theirs = [name for name in rates if name not in ("view", "charts")]
    for mine in ("view", "charts"):
        ratios = ", ".join(f"{rates[mine] / rates[name]:.1f} times the user's in {name}" for name in theirs)
        print(f"- `--unwrap {mine}`: {rates[mine]:.1f} pairs/s, {ratios}.")
    _starts(options.starts, folder, ours)


def _row(name: str, pairs: int, timing: Timing, triangles: float) -> float:
    """Print a line of the table; returns the rate."""
    rate = pairs / timing.wall
    print(
        f"| {name} | {pairs} | {rate:.2f} | {timing.cpu / pairs:.3f} | {timing.peak / 1e6:.0f} | {triangles:.0f} |",
        flush=True,
    )
    return rate


def _starts(count: int, folder: Path, ours: list[str]) -> None:
    """Time single reconstructions, each in a fresh process, and --help."""
    print()
    print(f"| cold start, median of {count} | wall s | CPU s |")
    print("| --- | ---: | ---: |")
    one = [*PROGRAM, "reconstruct", *(str(folder / "pairs" / f"{side}0000.png") for side in ("left", "right")), *ours]
    for unwrap in ("view", "charts"):
        timings = []
        for number in range(count):
            out = folder / f"one{number}"
            timings.append(run_timed([*one, "--unwrap", unwrap, "--out", str(out)]))
            shutil.rmtree(out)
        _start(f"`stereo-gpu reconstruct --unwrap {unwrap}`, all files", timings)
    _start("`stereo-gpu --help`", [run_timed([*PROGRAM, "--help"]) for _ in range(count)])


def _start(name: str, timings: list[Timing]) -> None:
    wall, cpu = (statistics.median(getattr(timing, what) for timing in timings) for what in ("wall", "cpu"))
    print(f"| {name} | {wall:.2f} | {cpu:.2f} |", flush=True)


def run_timed(command: list[str]) -> Timing:
    """Run a program to its end and time all of it.

    Raises:
        StereoError: it failed; the message is what it said.
    """
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as complaints:
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=output, stderr=complaints)
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        complaints.seek(0)
        said, told = output.read().decode(), complaints.read().decode()
    if process.returncode:
        raise StereoError(f"{' '.join(command[3:6])} failed: {said}{told}")
    return Timing(wall=wall, cpu=used.ru_utime + used.ru_stime, peak=used.ru_maxrss * 1024, said=said)


def make_pairs(folder: Path, count: int) -> Rig:
    """Write so many different pairs, left0000.png, right0000.png and so on; returns their rig."""
    folder.mkdir()
    random = np.random.default_rng(0)
    scenes = [build_scene(SIZE, seed) for seed in range(min(count, SCENES))]
    rendered = [render_pair(scene) for scene in scenes]
    for number in range(count):
        first = number < SCENES
        gain = 1.0 if first else random.uniform(0.75, 1.05)
        for side, view in zip(("left", "right"), rendered[number % SCENES], strict=True):
            grain = 0.0 if first else random.normal(0, NOISE, view.shape)
            write_png(folder / f"{side}{number:04d}.png", np.clip(view * gain + grain + 0.5, 0, 255).astype(np.uint8))
    return scenes[0].rig


def write_for_opencv(rig: Rig, path: Path) -> None:
    """The rig as OpenCV's users keep it."""
    stored = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (
        ("K1", rig.left.matrix),
        ("D1", rig.left.distortion),
        ("K2", rig.right.matrix),
        ("D2", rig.right.distortion),
        ("R", rig.R),
        ("T", rig.T.reshape(3, 1)),
        ("size", np.array(rig.left.size, np.float64)),
    ):
        stored.write(name, np.array(value))
    stored.release()


if __name__ == "__main__":
    sys.exit(main())
