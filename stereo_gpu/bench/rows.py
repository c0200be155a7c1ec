"""Time one thing at one size, in turn with OpenCV's functions, and make a row of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from stereo_gpu.backends import Backend
from stereo_gpu.backends.contract import host_memory
from stereo_gpu.bench.cases import KernelCase, ProfileCase, options_of
from stereo_gpu.bench.launches import catch_launches, compulsory
from stereo_gpu.bench.peers import STEREO_BM, Peer
from stereo_gpu.bench.row import OPENCV, TOO_LONG, Row
from stereo_gpu.bench.scene import BenchScene
from stereo_gpu.bench.timing import FEWEST_REPEATS, Measured, Work, measure
from stereo_gpu.device_match import check_match_memory
from stereo_gpu.errors import StereoError
from stereo_gpu.match import match

YARDSTICK_SHARE = 0.2  # of the seconds, for StereoBM where it is not the peer itself
MATCH_BYTES = 11  # a pixel of `sg.match`: two grey pictures in; values, validity and confidence out
PEER_BYTES = 4  # a pixel of OpenCV's matchers: two grey pictures in, 16 bits out
TRANSFER_TRIES = 5


class Peers:
    """OpenCV's functions on one scene, each prepared when first asked for."""

    def __init__(self, scene: BenchScene) -> None:
        self.scene = scene
        self._ready: dict[str, Callable[[], object]] = {}

    def work(self, peer: Peer, share: float = 1.0) -> Work:
        """One of them, to be timed for a share of the seconds."""
        if peer.name not in self._ready:
            self._ready[peer.name] = peer.make(self.scene)
        ready = self._ready[peer.name]

        def run() -> None:
            ready()

        return Work(run, share)

    def obstacle(self, peer: Peer) -> str:
        """Why it cannot be run here; empty if it can."""
        needed = peer.volume_bytes * self.scene.width * self.scene.height * self.scene.disparities
        free = host_memory()
        return f"{peer.name} needs {needed / 2**30:.1f} GiB, {free / 2**30:.1f} are free" if needed > free else ""


def time_opencv(wanted: Sequence[Peer], peers: Peers, *, seconds: float, cap: float) -> list[Row]:
    """Time OpenCV's matchers, in turn with each other."""
    if not wanted:
        return []
    scene = peers.scene
    timed = [peer for peer in wanted if not peers.obstacle(peer)]
    works = {peer.name: peers.work(peer) for peer in timed}
    works.setdefault(STEREO_BM.name, peers.work(STEREO_BM, YARDSTICK_SHARE))
    measured = dict(zip(works, measure(list(works.values()), seconds=seconds, cap=cap), strict=True))
    rows = []
    for peer in wanted:
        row = Row(
            name=peer.name,
            kind="peer",
            device=OPENCV,
            width=scene.width,
            height=scene.height,
            disparities=scene.disparities,
            window=scene.window,
            per="cell",
            bytes_moved=PEER_BYTES * scene.width * scene.height,
            formula=f"{PEER_BYTES} WH",
            note=peers.obstacle(peer),
        )
        if peer.name in works:
            each, yardstick = measured[peer.name], measured[STEREO_BM.name]
            row = replace(row, wall=each.wall, stereobm_wall=yardstick.wall, note=_once(each, cap))
        rows.append(row)
    return rows


def time_case(
    case: KernelCase | ProfileCase,
    device: Backend,
    scene: BenchScene,
    small: BenchScene,
    peers: Peers,
    earlier: Sequence[Row],
    *,
    seconds: float,
    cap: float,
) -> Row:
    """Time one kernel or profile on one device; whatever keeps it from running goes into the row.

    Args:
        case: what to time.
        device: where.
        scene: its input.
        small: a small one that it runs on first, so that no compiler runs while a clock does.
        peers: OpenCV's functions on the same scene.
        earlier: rows of smaller sizes, which tell how long a run will take.
        seconds: to time it at least.
        cap: to time it at most; what takes longer than that for a single run is not run.
    """
    row = Row(
        name=case.name,
        kind="kernel" if isinstance(case, KernelCase) else "profile",
        device=device.name,
        width=scene.width,
        height=scene.height,
        disparities=scene.disparities,
        window=scene.window,
        per=case.per if isinstance(case, KernelCase) else "cell",
        peer=case.peer.name if case.peer else "",
    )
    expected, smaller = _expect(row, earlier)
    after = case.after if isinstance(case, KernelCase) else ""
    if after:
        before, other = _expect(replace(row, name=after), earlier)
        expected, smaller = expected + before, smaller or other
    if expected > cap:
        what = f"a run, with {after} before it," if after else "a run"
        return replace(row, note=f"{TOO_LONG}{expected:,.0f} s {what} going by {smaller}; --cap is {cap:g} s")
    try:
        _prepare(case, device, small)[0]()
        run, known = _prepare(case, device, scene)
        row = replace(row, **known)
        return _timed(row, Work(run), case.peer, peers, seconds, cap)
    except StereoError as error:
        return replace(row, note=f"not run: {error}")


def _timed(row: Row, ours: Work, peer: Peer | None, peers: Peers, seconds: float, cap: float) -> Row:
    works, note = [ours], ""
    if peer and (note := peers.obstacle(peer)):
        peer = None
    if peer:
        works.append(peers.work(peer))
    if peer is not STEREO_BM:
        works.append(peers.work(STEREO_BM, YARDSTICK_SHARE))
    found = measure(works, seconds=seconds, cap=cap)
    return replace(
        row,
        wall=found[0].wall,
        on_device=found[0].device,
        peer_wall=found[1].wall if peer else None,
        stereobm_wall=found[-1].wall,
        note="; ".join(part for part in (_once(found[0], cap), note) if part),
    )


def _once(found: Measured, cap: float) -> str:
    if found.wall.repeats >= FEWEST_REPEATS:
        return ""
    return f"measured once: over {cap / FEWEST_REPEATS:.3g} s a run"


def _expect(row: Row, earlier: Sequence[Row]) -> tuple[float, str]:
    """Seconds that a run will take, and the smaller size that says so; 0 where none does."""
    work = row.width * row.height * (row.disparities if row.per == "cell" else 1)
    for smaller in reversed(earlier):
        if (smaller.name, smaller.device) == (row.name, row.device) and smaller.wall:
            done = smaller.width * smaller.height * (smaller.disparities if row.per == "cell" else 1)
            return smaller.wall.median * work / done, "{} x {} x {}".format(*smaller.size)
    return 0.0, ""


def _prepare(
    case: KernelCase | ProfileCase, device: Backend, scene: BenchScene
) -> tuple[Callable[[], float | None], dict[str, Any]]:
    """What is timed, and what is known of it: bytes, operations, transfers."""
    if isinstance(case, ProfileCase):
        return _prepare_match(case, device, scene)
    launches = catch_launches(device, case.kernel, lambda target: case.stage(target, scene), case.launches)
    shape = (scene.height, scene.width, scene.disparities)
    moved, formula = compulsory(case.kernel, launches, shape)
    units = scene.width * scene.height * (scene.disparities if case.per == "cell" else 1)
    known: dict[str, Any] = {
        "bytes_moved": moved,
        "formula": formula,
        "operations": case.operations(scene.window) * units if case.operations else None,
    }

    def run() -> float | None:
        with device.device_times() as times:
            for arguments in launches:
                device.launch(case.kernel, **arguments)
        return _total(times)

    return run, known


def _prepare_match(
    case: ProfileCase, device: Backend, scene: BenchScene
) -> tuple[Callable[[], float | None], dict[str, Any]]:
    options = options_of(case.profile, scene)
    check_match_memory(device, scene.width, scene.height, scene.disparities, options)
    # Smooth paths have no window, and would say so at every run.
    window = None if options.smooth_paths else scene.window

    def run() -> float | None:
        with device.device_times() as times:
            match(
                scene.left,
                scene.right,
                disparities=(0, scene.disparities),
                window=window,
                profile=case.profile,
                backend=device.name,
            )
        return _total(times)

    known: dict[str, Any] = {
        "bytes_moved": MATCH_BYTES * scene.width * scene.height,
        "formula": f"{MATCH_BYTES} WH",
        "transfer": _transfer(device, scene),
    }
    return run, known


def _total(times: Sequence[tuple[str, float]]) -> float | None:
    """Seconds of all launches; None where the device told none, so that no time of 0 is taken for a fast one."""
    return sum(seconds for _, seconds in times) or None


def _transfer(device: Backend, scene: BenchScene) -> float:
    """Seconds of the copies that `sg.match` makes: two pictures and two masks up, three maps down."""
    shape = (scene.height, scene.width)
    maps = [device.zeros(shape, dtype) for dtype in (np.float32, np.uint8, np.float32)]
    everywhere = np.ones(shape, np.uint8)
    taken = []
    for _ in range(TRANSFER_TRIES):
        start = time.perf_counter()
        held = [device.upload(array) for array in (scene.left, scene.right, everywhere, everywhere)]
        for array in maps:
            device.download(array)
        device.finish()
        taken.append(time.perf_counter() - start)
        del held
    return float(np.median(taken))
