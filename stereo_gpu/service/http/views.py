"""Jobs and rigs of the table as what is said of them."""

from __future__ import annotations

from collections.abc import Sequence
from urllib.parse import quote, urlencode

from stereo_gpu.service.http.models import InputView, JobLinks, JobView, RigLinks, RigView, StepView, moment
from stereo_gpu.service.jobs.order import STEPS, stages_of
from stereo_gpu.service.records import Job, RigRecord, State
from stereo_gpu.service.service import Service


def view_job(service: Service, job: Job) -> JobView:
    """A job, with what is known of it while it runs."""
    return view_jobs(service, [job])[0]


def view_jobs(service: Service, jobs: Sequence[Job]) -> list[JobView]:
    """Several; of those that wait the places are asked for at once."""
    waiting = [job for job in jobs if job.state is State.QUEUED]
    places = service.store.places(waiting) if waiting else {}
    return [_view(service, job, places.get(job.id)) for job in jobs]


def _view(service: Service, job: Job, place: int | None) -> JobView:
    live = service.live.progress(job.id) if job.state is State.RUNNING else None
    here = f"/v1/jobs/{job.id}"
    stages = stages_of(job.kind)
    stage = live.stage if live else job.stage
    return JobView(
        id=job.id,
        kind=job.kind,
        state=job.state,
        label=job.label,
        created=moment(job.created),
        started=None if job.started is None else moment(job.started),
        ended=None if job.ended is None else moment(job.ended),
        stage=stage,
        stages=list(stages),
        fraction=live.fraction if live else _fraction(job, stages),
        tries=job.tries,
        place=place,
        seconds=live.seconds if live else job.seconds,
        warnings=list(job.warnings),
        error=job.error,
        rig=job.rig,
        options=job.options,
        inputs=[
            InputView(
                name=each.name,
                given=each.given,
                bytes=each.size,
                sha256=each.sha256,
                width=each.width,
                height=each.height,
                href=f"{here}/inputs/{each.name}",
            )
            for each in job.inputs
        ],
        steps=[
            StepView(name=name, href=f"{here}/steps/{name}.jpg")
            for name in (live.steps if live else _drawn(service, job))
        ],
        summary=job.summary,
        bytes=job.bytes,
        links=JobLinks(self=here, events=f"{here}/events", files=f"{here}/files"),
    )


def view_rig(rig: RigRecord) -> RigView:
    """A rig."""
    here = f"/v1/rigs/{rig.id}"
    return RigView(
        id=rig.id,
        name=rig.name,
        created=moment(rig.created),
        summary=rig.summary,
        calibration=rig.calibration,
        checked=rig.checked,
        links=RigLinks(self=here, file=f"{here}/file"),
    )


def next_page(path: str, last: int, **asked: object) -> str:
    """The address of the page after the one that ends with the thing of this order."""
    given = {name: str(value) for name, value in asked.items() if value is not None}
    return f"{quote(path)}?{urlencode({**given, 'after': last})}"


def _fraction(job: Job, stages: tuple[str, ...]) -> float:
    """Of a job that is not under way here."""
    if job.state is State.DONE:
        return 1.0
    return stages.index(job.stage) / len(stages) if job.stage in stages else 0.0


def _drawn(service: Service, job: Job) -> list[str]:
    """The steps of which pictures lie in the job's folder."""
    if not job.options.get("steps"):
        return []
    folder = service.folders.steps(job.id)
    return [name for name in STEPS if (folder / f"{name}.jpg").is_file()]
