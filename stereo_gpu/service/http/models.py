"""What the service says of jobs, rigs and files over HTTP, as docs/service.md has it."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from stereo_gpu.service.records import Kind, State

ID = r"^[0-9a-f]{32}$"
Id = Annotated[str, Field(pattern=ID, examples=["0f8fad5bd9cb469fa16570867628950e"])]
Time = Annotated[str, Field(json_schema_extra={"format": "date-time"}, examples=["2026-11-22T17:40:00.123Z"])]
Href = Annotated[str, Field(examples=["/v1/jobs/0f8fad5bd9cb469fa16570867628950e"])]


class View(BaseModel):
    """What all of them are: closed, so that the document says all there is."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class InputView(View):
    """A picture as it was sent."""

    name: str
    given: str
    bytes: int
    sha256: str
    width: int
    height: int
    href: Href


class StepView(View):
    """A picture of a step that is there."""

    name: str
    href: Href


class JobLinks(View):
    """Where more is to be had of a job."""

    self: Href
    events: Href
    files: Href


class JobView(View):
    """A job."""

    id: Id
    kind: Kind
    state: State
    label: str
    created: Time
    started: Time | None
    ended: Time | None
    stage: str | None = Field(description="that has begun last")
    stages: list[str] = Field(description="of this kind of job, in order")
    fraction: float = Field(ge=0, le=1, description="of the stages that have ended")
    tries: int = Field(ge=0)
    place: int | None = Field(description="how many wait before it, of a queued job")
    seconds: dict[str, float] = Field(description="of each stage")
    warnings: list[str]
    error: str | None = Field(description="why it failed, one line")
    rig: Id | None
    options: dict[str, Any]
    inputs: list[InputView]
    steps: list[StepView]
    summary: dict[str, Any]
    bytes: int = Field(ge=0, description="of its inputs and result on the disk")
    links: JobLinks


class JobPage(View):
    """Some jobs, newest first."""

    items: list[JobView]
    next: Href | None = Field(description="the page after this one")


class RigLinks(View):
    """Where more is to be had of a rig."""

    self: Href
    file: Href


class RigView(View):
    """A rig."""

    id: Id
    name: str
    created: Time
    summary: dict[str, Any] = Field(description="width, height, baseline, unit, focal_px, rms_px, epipolar_rms_px")
    calibration: Id | None = Field(description="the job that made it; null where its file was sent")
    checked: bool = Field(description="whether a pair has been found right with it")
    links: RigLinks


class RigPage(View):
    """Some rigs, newest first."""

    items: list[RigView]
    next: Href | None = Field(description="the page after this one")


class FileView(View):
    """A file of a result."""

    name: str
    bytes: int
    sha256: str
    type: str
    href: Href


class FileList(View):
    """All files of a result."""

    items: list[FileView]


class ProblemView(View):
    """What is wrong with a request (RFC 9457)."""

    type: Literal["about:blank"]
    title: str
    status: int
    detail: str = Field(description="the line that the command line would print")


class Health(View):
    """That the process answers."""

    status: Literal["ok"]


class Readiness(View):
    """Whether jobs are taken and done, and why not."""

    status: Literal["ready", "not ready"]
    reasons: list[str]


def moment(seconds: float) -> str:
    """Seconds since 1970 as RFC 3339, in UTC, to the millisecond."""
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
