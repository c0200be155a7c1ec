"""From what a worker answered to how its job ends: the result takes its place first, then comes the row."""

from __future__ import annotations

from stereo_gpu.errors import CancelledError, StereoError
from stereo_gpu.files import write_whole
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.jobs.outcome import Outcome
from stereo_gpu.service.records import Job, Lease, RigRecord, State
from stereo_gpu.service.store import Ending


def end_well(folders: Folders, lease: Lease, outcome: Outcome, seconds: float) -> Ending:
    """Put a sealed result in its place, and say how the job ended.

    Args:
        seconds: that the try took its worker.

    Raises:
        StereoError: the result is not whole, or the disk does not take it.
        OSError: the same.
    """
    job = lease.job
    folders.publish(job.id, lease.number)
    return Ending(
        id=job.id,
        number=lease.number,
        state=State.DONE,
        warnings=outcome.warnings,
        seconds={**outcome.seconds, "total": seconds},
        summary=outcome.summary,
        rig=None if outcome.rig is None else _keep_rig(folders, job, outcome.rig),
        rig_is_right=outcome.checked,
        bytes=folders.bytes(job.id),  # pictures of the steps count, too
    )


def find_outcome(folders: Folders, job: Job) -> Outcome | None:
    """The outcome of a job whose whole result is in its place already; None where it is not.

    So it is where the service died after a result took its place and before the table knew.
    """
    return None if folders.manifest(job.id) is None else Outcome.read(folders.result(job.id), job.kind)


def end_badly(lease: Lease, error: StereoError, seconds: float) -> Ending:
    """A job that failed, or that somebody wanted no more."""
    cancelled = isinstance(error, CancelledError)
    return Ending(
        id=lease.job.id,
        number=lease.number,
        state=State.CANCELLED if cancelled else State.FAILED,
        error=None if cancelled else " ".join(str(error).split()) or type(error).__name__,
        seconds={"total": seconds},
    )


def _keep_rig(folders: Folders, job: Job, summary: dict[str, object]) -> RigRecord:
    """The rig that a calibration found; it has the id of its job, so that there is one however often this is done."""
    content = (folders.result(job.id) / "rig.json").read_bytes()
    folders.keep_rig(job.id, lambda path: write_whole(path, content))
    return RigRecord(
        id=job.id,
        client=job.client,
        name=job.label or "calibrated",
        created=job.created,
        summary=summary,
        calibration=job.id,
    )
