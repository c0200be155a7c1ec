"""What the service remembers of jobs and rigs; what passes between the table, the dispatcher and the routes."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any


class State(StrEnum):
    """Where a job is; the last three are ends."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Whether nothing more happens to it by itself."""
        return self in (State.DONE, State.FAILED, State.CANCELLED)


class Kind(StrEnum):
    """What a job makes."""

    RECONSTRUCTION = "reconstruction"
    CALIBRATION = "calibration"


@dataclass(frozen=True, kw_only=True)
class InputFile:
    """A picture that a client sent, as it lies in the job's folder inputs/.

    Args:
        name: there, made by the server: left.png, right.png, mask.png; left000.png and so on for boards.
        given: the client's name for it, cut to what is printable; shown, never used as a path.
        sha256: of its bytes.
        size: bytes.
        width, height: px, by its header.
    """

    name: str
    given: str
    sha256: str
    size: int
    width: int
    height: int

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.width, self.height


@dataclass(frozen=True, kw_only=True)
class Job:
    """A job as it stands in the table.

    Args:
        id: 32 hexadecimal digits, which cannot be guessed.
        client: whose it is.
        kind: what it makes.
        state: where it is; it waits until a worker has it.
        order: its place in the table; later jobs have larger ones.
        created, started, ended: seconds since 1970; None where it has not come to that. `started` is of the last try.
        tries: begun by a worker so far; those that a stop of the service gave back do not count.
        stage, fraction: that has begun last, and of how many, by the last heartbeat; live ones are in `live.Live`.
        error: why it failed, one line; None where it did not.
        warnings: what a person should know of its result.
        seconds: of each stage, and "total" of the last try.
        summary: of its result: triangles, coverage, unit and so on, as `work.py` gives it.
        rig: the id of its rig; of a calibration the one that it made, once it has.
        label: what the client calls it; may be empty.
        options: as the client gave them, checked.
        inputs: the pictures.
        pixels: of one picture.
        bytes: of its inputs and result on the disk.
        cancel_asked: whether somebody wants it no more.
    """

    id: str
    client: str
    kind: Kind
    state: State = State.QUEUED
    order: int = 0
    created: float
    started: float | None = None
    ended: float | None = None
    tries: int = 0
    stage: str | None = None
    fraction: float = 0.0
    error: str | None = None
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    rig: str | None = None
    label: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    inputs: tuple[InputFile, ...] = ()
    pixels: int = 0
    bytes: int = 0
    cancel_asked: bool = False


@dataclass(frozen=True, kw_only=True)
class RigRecord:
    """A rig as it stands in the table; its file is rigs/ID/rig.json.

    Args:
        id: 32 hexadecimal digits.
        client: whose it is.
        name: what the client calls it.
        created: seconds since 1970.
        order: its place in the table.
        summary: width, height, baseline, unit, focal_px, rms_px (or null), epipolar_rms_px (or null).
        calibration: the id of the job that made it; None where its file was sent.
        checked: whether a pair has been checked in full against it and was found right.
    """

    id: str
    client: str
    name: str
    created: float
    order: int = 0
    summary: dict[str, Any] = field(default_factory=dict)
    calibration: str | None = None
    checked: bool = False

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height that it was calibrated for, px."""
        return self.summary["width"], self.summary["height"]


@dataclass(frozen=True, kw_only=True)
class Lease:
    """The right to work on a job for a while.

    Args:
        job: as it stands in the table.
        number: of the lease, from 1; the folder that its try writes is named by it.
        until: seconds since 1970, when it runs out unless it is renewed.
    """

    job: Job
    number: int
    until: float
