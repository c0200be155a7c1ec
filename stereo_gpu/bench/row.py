"""One line of the benchmark: what was timed, how long it took, and what follows from that."""

from __future__ import annotations

from dataclasses import dataclass

from stereo_gpu.bench.timing import Times

OPENCV = "OpenCV"
TOO_LONG = "not run: about "  # begins the note of a case that was left out for the cap on its time


@dataclass(frozen=True, kw_only=True)
class Row:
    """One thing that was timed, at one size on one device.

    Args:
        name: the kernel, `match PROFILE` or the OpenCV function.
        kind: "kernel", "profile" or "peer".
        device: what `--backend` takes, or OPENCV.
        width, height, disparities, window: of the input.
        per: what the work grows with: "cell" or "pixel".
        bytes_moved: what must be moved at least: each input and each output once.
        formula: these bytes in W, H and D.
        operations: additions, multiplications and comparisons that the formula needs; None where not counted.
        wall: time of the whole call, until its result is there; None where it was not run.
        on_device: of that, time of the kernels by the device's own clock; None where there is none.
        transfer: seconds of the call's copies to and from the device, measured apart; None where it has none.
        peer: the OpenCV function that it is held against; empty for none.
        peer_wall: time of that one, timed in turn with this.
        stereobm_wall: time of plain StereoBM, timed in turn with this.
        note: why it was not run, or only once.
    """

    name: str
    kind: str
    device: str
    width: int
    height: int
    disparities: int
    window: int
    per: str = "pixel"
    bytes_moved: int = 0
    formula: str = ""
    operations: float | None = None
    wall: Times | None = None
    on_device: Times | None = None
    transfer: float | None = None
    peer: str = ""
    peer_wall: Times | None = None
    stereobm_wall: Times | None = None
    note: str = ""

    @property
    def size(self) -> tuple[int, int, int]:
        """Width, height and disparities."""
        return self.width, self.height, self.disparities

    @property
    def key(self) -> tuple[str, str, int, int, int, int]:
        """What makes it the same case in two runs."""
        return self.device, self.name, *self.size, self.window

    @property
    def seconds(self) -> float | None:
        """Median of the time on the device for a kernel, of the wall time for the rest."""
        times = self.on_device if self.kind == "kernel" and self.on_device else self.wall
        return times.median if times else None

    @property
    def evaluations_s(self) -> float | None:
        """Disparities evaluated in a second, W x H x D over the time; None for what has no disparities."""
        if self.per != "cell" or not self.seconds:
            return None
        return self.width * self.height * self.disparities / self.seconds

    @property
    def bytes_s(self) -> float | None:
        """Bytes that had to be moved, in a second."""
        return self.bytes_moved / self.seconds if self.seconds and self.bytes_moved else None

    @property
    def to_peer(self) -> float | None:
        """Wall time over that of its peer."""
        return self.wall.median / self.peer_wall.median if self.wall and self.peer_wall else None

    @property
    def to_stereobm(self) -> float | None:
        """Wall time over that of StereoBM."""
        return self.wall.median / self.stereobm_wall.median if self.wall and self.stereobm_wall else None
