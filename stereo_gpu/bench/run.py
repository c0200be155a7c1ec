"""Time every kernel and profile on every device, and OpenCV's matchers and filters in turn with them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from stereo_gpu.backends import Backend, devices, open_backend
from stereo_gpu.bench.cases import KERNELS, MATCHES, KernelCase, ProfileCase
from stereo_gpu.bench.machine import describe_device, describe_machine
from stereo_gpu.bench.peers import MATCHERS, STAGES, Peer
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.report import device_lines, machine_lines, peer_lines, row_line, size_lines
from stereo_gpu.bench.row import Row
from stereo_gpu.bench.rows import YARDSTICK_SHARE, Peers, time_case, time_opencv
from stereo_gpu.bench.scene import build_bench_scene, check_bench_size
from stereo_gpu.bench.timing import DROPPED, FEWEST_REPEATS, REPEATS, WARM_UP_SHARE
from stereo_gpu.errors import BackendError, InputError

SIZES = ((640, 480, 64), (1280, 960, 128), (2560, 1920, 256))
SMALL = (192, 128, 32)  # the size that everything runs at once, so that no compiler runs while a clock does


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """What to time, and for how long.

    Args:
        sizes: width, height and disparities of each.
        window: side of the window, px.
        backends: devices by name; none for every one that is found.
        only: names of kernels, profiles and OpenCV's matchers; none for all.
        seconds: for each thing at least.
        cap: seconds for each thing at most, as far as a single run allows.
    """

    sizes: tuple[tuple[int, int, int], ...] = SIZES
    window: int = 11
    backends: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    seconds: float = 5.0
    cap: float = 60.0


def run_bench(options: BenchOptions, say: Callable[[str], None]) -> BenchRun:
    """Run the benchmark.

    Each of ours is timed in turn with the OpenCV function that does the same and with StereoBM, on the same input.

    Args:
        options: what to time.
        say: takes each line of the report as it becomes known.

    Raises:
        InputError: a size or a name is wrong.
        BackendError: a device that was named cannot be used, or there is none.
    """
    check_bench_options(options)
    opened = _open(options.backends)
    began, clock = datetime.now(UTC), time.perf_counter()
    machine = describe_machine()
    for line in machine_lines(machine):
        say(line)
    facts = tuple(describe_device(device) for device in opened)
    for line in device_lines(facts):
        say(line)
    rows: list[Row] = []
    small = build_bench_scene(*SMALL, options.window)
    # Small sizes first, so that they can tell how long the large ones will take.
    for size in sorted(options.sizes, key=lambda size: size[0] * size[1] * size[2]):
        scene = build_bench_scene(*size, options.window)
        for line in size_lines(scene.width, scene.height, scene.disparities, scene.window):
            say(line)
        peers = Peers(scene)
        matchers = [peer for peer in MATCHERS if _is_named(peer.name, options.only)]
        for row in time_opencv(matchers, peers, seconds=options.seconds, cap=options.cap):
            say(row_line(row, None))
            rows.append(row)
        for device, known in zip(opened, facts, strict=True):
            say(f"  {device.name}")
            for case in _wanted(options.only):
                row = time_case(case, device, scene, small, peers, rows, seconds=options.seconds, cap=options.cap)
                say(row_line(row, known))
                rows.append(row)
    described = {peer.name: _settings(peer, options.window) for peer in (*MATCHERS, *STAGES)}
    for line in peer_lines(described):
        say(line)
    return BenchRun(
        started=began.isoformat(timespec="seconds"),
        took=round(time.perf_counter() - clock, 1),
        method={
            "seconds": options.seconds,
            "warm_up_seconds": WARM_UP_SHARE * options.seconds,
            "repeats": REPEATS,
            "fewest_repeats": FEWEST_REPEATS,
            "dropped_at_either_end": DROPPED,
            "cap_seconds": options.cap,
            "stereobm_share": YARDSTICK_SHARE,
        },
        machine=machine,
        peers=described,
        devices=facts,
        rows=tuple(rows),
    )


def check_bench_options(options: BenchOptions) -> None:
    """Refuse what cannot be timed, before any work.

    Raises:
        InputError: with what can be.
    """
    for size in options.sizes:
        check_bench_size(*size, options.window)
    if not 0 < options.seconds <= 3600 or not options.seconds <= options.cap <= 86_400:
        raise InputError(
            f"{options.seconds:g} seconds with a cap of {options.cap:g}: give 0 to 3600 seconds, and a cap from"
            " there to 86400"
        )
    known = [*(case.name for case in (*KERNELS, *MATCHES)), *(peer.name for peer in MATCHERS)]
    for name in options.only:
        if not any(_is_named(each, (name,)) for each in known):
            raise InputError(f"{name!r} cannot be timed: choose from {', '.join(known)}")


def _is_named(name: str, only: Sequence[str]) -> bool:
    """Whether a name, or its last word as in `match fast`, is among those that were asked for."""
    return not only or any(each in (name, name.removeprefix("match ")) for each in only)


def _wanted(only: Sequence[str]) -> list[KernelCase | ProfileCase]:
    return [case for case in (*KERNELS, *MATCHES) if _is_named(case.name, only)]


def _open(names: Sequence[str]) -> list[Backend]:
    wanted = names or [status.name for status in devices() if status.available]
    if not wanted:
        raise BackendError("nothing here can compute: see `stereo-gpu doctor`")
    # One device may go by several names, such as opencl and opencl:<part of its name>.
    opened: dict[str, Backend] = {}
    for name in wanted:
        device = open_backend(name)
        opened.setdefault(device.name, device)
    return list(opened.values())


def _settings(peer: Peer, window: int) -> str:
    return peer.settings.replace("{w}", str(window)).replace("{D}", "D")
