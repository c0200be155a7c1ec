"""What a worker is told of a job: plain values and names of files, so that it can be sent to any node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from stereo_gpu.pipeline import STAGES
from stereo_gpu.service.records import Kind, Lease
from stereo_gpu.service.store import Store

STEP = "step:"  # how a worker's word begins that says of which step there is a picture now
STEPS = ("rectified", "masked", "disparity", "mesh", "textured")  # in the order in which they appear

_STAGES = {
    Kind.RECONSTRUCTION: (*STAGES, "save"),
    Kind.CALIBRATION: ("find", "fit", "report"),
}


@dataclass(frozen=True, kw_only=True)
class WorkOrder:
    """One try of a job.

    Args:
        job: its id.
        number: of the try, from 1.
        kind: what it makes.
        options: as the client gave them, checked.
        inputs: names of the pictures in the job's folder inputs/.
        rig: the id of its rig; None for a calibration.
        check: how the rig is checked, as `reconstruct` says.
    """

    job: str
    number: int
    kind: Kind
    options: Mapping[str, Any]
    inputs: tuple[str, ...]
    rig: str | None
    check: str = "full"


def order_of(lease: Lease, store: Store) -> WorkOrder | None:
    """What a worker is told of a leased job; None where its rig is gone.

    With the check "first" a rig is checked in full until a pair of it was right, and by the rows of maps from then on.
    """
    job = lease.job
    check = str(job.options.get("check", "first"))
    if job.rig is not None and check == "first":
        rig = store.rig(job.client, job.rig)
        if rig is None:
            return None
        check = "rows" if rig.checked else "full"
    return WorkOrder(
        job=job.id,
        number=lease.number,
        kind=job.kind,
        options=job.options,
        inputs=tuple(picture.name for picture in job.inputs),
        rig=job.rig,
        check=check,
    )


def stages_of(kind: Kind) -> tuple[str, ...]:
    """The stages that a job of this kind goes through, in their order."""
    return _STAGES[kind]
