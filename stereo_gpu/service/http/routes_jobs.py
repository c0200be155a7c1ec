"""Jobs over HTTP: take, list, tell, follow, cancel, restart, delete."""

from __future__ import annotations

from typing import Annotated, Any

from anyio.to_thread import run_sync
from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import StreamingResponse

from stereo_gpu.boards.markers import FAMILIES
from stereo_gpu.service.http.accepting import (
    BOARDS_FORM,
    KEY,
    LONGEST_LABEL,
    LONGEST_WORD,
    MOST_BOARDS,
    PAIR_FORM,
    accept_boards,
    accept_pair,
)
from stereo_gpu.service.http.asking import After, Client, IdHere, Limit, ServiceHere
from stereo_gpu.service.http.events import MEDIA_TYPE, Streams
from stereo_gpu.service.http.models import ID, JobPage, JobView
from stereo_gpu.service.http.openapi import BY, events, form, length, picture, pictures, text, wrong
from stereo_gpu.service.http.views import next_page, view_job, view_jobs
from stereo_gpu.service.intake.uploads import receive_form
from stereo_gpu.service.problems import Problem
from stereo_gpu.service.records import Job, Kind, State
from stereo_gpu.service.refusals import NotFound
from stereo_gpu.service.service import Service

router = APIRouter(prefix="/v1", tags=["jobs"])

Key = Annotated[
    str | None, Header(pattern=KEY, description="makes a retry safe: the same request again gives the same job")
]
_TAKEN = {"model": JobView, "description": "it waits", "headers": {"Location": {"schema": {"type": "string"}}}}
_AGAIN = {"model": JobView, "description": "the job of an earlier request with this Idempotency-Key"}
_UPLOAD_ERRORS = (401, 408, 413, 415, 422, 429, 507)


@router.post(
    "/jobs",
    status_code=202,
    response_model=JobView,
    responses={202: _TAKEN, 200: _AGAIN, **wrong(*_UPLOAD_ERRORS)},
    openapi_extra=form(
        ["left", "right", "rig"],
        left=picture("the left camera's picture, as it took it"),
        right=picture("the right camera's"),
        rig=text("id of a rig", 64, pattern=ID),
        mask=picture("black where the rectified reference view is not wanted"),
        options={"$ref": "#/components/schemas/JobOptions"},
        label=text("what you call it", LONGEST_LABEL),
    ),
)
async def post_job(request: Request, client: Client, service: ServiceHere, idempotency_key: Key = None) -> Response:
    """Take a pair: the answer comes once it is safe on the disk."""
    _refuse_while_stopping(service)
    received = await receive_form(request, service.folders, service.settings, PAIR_FORM)
    return await run_sync(lambda: _taken(service, *accept_pair(service, client, received, idempotency_key)))


@router.post(
    "/calibrations",
    status_code=202,
    response_model=JobView,
    responses={202: _TAKEN, 200: _AGAIN, **wrong(*_UPLOAD_ERRORS)},
    openapi_extra=form(
        ["left", "right", "board", "square"],
        left=pictures("the left camera's pictures of the board", MOST_BOARDS),
        right=pictures("the right camera's, in the same order", MOST_BOARDS),
        board=text("squares as printed, columns x rows", LONGEST_WORD, pattern=BY, examples=["10x7"]),
        square=length("side of a square, mm"),
        marker=length("side of a marker, mm, of a ChArUco board"),
        dictionary=text("of the markers", LONGEST_WORD, enum=[name for some in FAMILIES.values() for name in some]),
        label=text("what you call it, and the rig", LONGEST_LABEL),
    ),
)
async def post_calibration(
    request: Request, client: Client, service: ServiceHere, idempotency_key: Key = None
) -> Response:
    """Take pictures of a board; the job's `rig` is set once it is done."""
    _refuse_while_stopping(service)
    received = await receive_form(request, service.folders, service.settings, BOARDS_FORM)
    return await run_sync(lambda: _taken(service, *accept_boards(service, client, received, idempotency_key)))


@router.get("/jobs", response_model=JobPage, responses=wrong(401, 422))
def get_jobs(
    client: Client,
    service: ServiceHere,
    state: State | None = None,
    kind: Kind | None = None,
    limit: Limit = 20,
    after: After = None,
) -> Response:
    """Your jobs, newest first."""
    jobs = service.store.jobs(client, state=state, kind=kind, limit=limit + 1, after=after)
    shown = jobs[:limit]
    more = None
    if len(jobs) > limit:
        more = next_page("/v1/jobs", shown[-1].order, state=state, kind=kind, limit=limit)
    return _json(JobPage(items=view_jobs(service, shown), next=more))


@router.get("/jobs/{id}", response_model=JobView, responses=wrong(401, 404))
def get_job(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """How a job is."""
    return _json(view_job(service, service.store.job(client, id)))


@router.get(
    "/jobs/{id}/events",
    response_class=StreamingResponse,
    responses={
        200: events("`event: job`, whose data is the job as JSON, until it has ended"),
        **wrong(401, 404, 429),
    },
)
async def get_events(
    id: IdHere,
    request: Request,
    client: Client,
    service: ServiceHere,
    last_event_id: Annotated[str | None, Header(description="the number of the last event that came")] = None,
) -> Response:
    """A job as it changes."""

    def look() -> JobView | None:
        try:
            return view_job(service, service.store.job(client, id))
        except NotFound:
            return None

    await run_sync(service.store.job, client, id)
    last = last_event_id or ""
    first = int(last) + 1 if last.isascii() and last.isdigit() and len(last) < 16 else 0
    streams: Streams = request.app.state.streams
    streams.check_room(client)
    # A proxy that gathers answers would hand the events over when the job has ended.
    headers = {"X-Accel-Buffering": "no"}
    return StreamingResponse(
        streams.follow(service.live, id, look, first, client), media_type=MEDIA_TYPE, headers=headers
    )


@router.post("/jobs/{id}/cancel", response_model=JobView, responses=wrong(401, 404, 409))
def cancel_job(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """Want a job no more: one that runs is cancelled a moment later."""
    job = service.store.ask_cancel(client, id)
    service.dispatcher.cancel(id)
    service.live.changed(id)
    service.live.queue_moved()
    return _json(view_job(service, job))


@router.post(
    "/jobs/{id}/restart",
    status_code=202,
    response_model=JobView,
    responses={202: {"model": JobView, "description": "it waits again"}, **wrong(401, 404, 409, 429)},
)
def restart_job(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """Do a job that failed or was cancelled once more."""
    _refuse_while_stopping(service)
    settings = service.settings
    job = service.store.restart(client, id, queue_limit=settings.queue_limit, client_limit=settings.client_limit)
    service.dispatcher.wake()
    service.live.changed(id)
    return _json(view_job(service, job), 202)


@router.delete("/jobs/{id}", status_code=204, responses=wrong(401, 404, 409))
def delete_job(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """Forget a job that has ended, and remove its files."""
    service.store.delete(client, id)
    service.folders.remove_job(id)
    service.live.changed(id)
    return Response(status_code=204)


def _taken(service: Service, job: Job, new: bool) -> Response:
    view = view_job(service, job)
    return _json(view, 202 if new else 200, {"Location": view.links.self})


def _refuse_while_stopping(service: Service) -> None:
    if service.dispatcher.stopping:
        raise Problem(503, "the service is stopping: try again in a moment", {"Retry-After": "5"})


def _json(view: JobView | JobPage, status: int = 200, headers: dict[str, Any] | None = None) -> Response:
    return Response(view.model_dump_json(), status, headers, "application/json")
