"""Rigs over HTTP: send, list, tell, give back, delete."""

from __future__ import annotations

from typing import Any

from anyio.to_thread import run_sync
from fastapi import APIRouter, Request, Response

from stereo_gpu.service.http.accepting import LONGEST_LABEL
from stereo_gpu.service.http.asking import After, Client, IdHere, Limit, ServiceHere
from stereo_gpu.service.http.models import RigPage, RigView
from stereo_gpu.service.http.openapi import BY, form, pictures, text, wrong
from stereo_gpu.service.http.rig_upload import RIG_FORM, accept_rig
from stereo_gpu.service.http.views import next_page, view_rig
from stereo_gpu.service.intake.uploads import receive_form
from stereo_gpu.service.records import RigRecord
from stereo_gpu.service.refusals import NotFound
from stereo_gpu.service.service import Service
from stereo_gpu.types import METRES_PER_UNIT

router = APIRouter(prefix="/v1", tags=["rigs"])


@router.post(
    "/rigs",
    status_code=201,
    response_model=RigView,
    responses={
        201: {"model": RigView, "description": "it is kept", "headers": {"Location": {"schema": {"type": "string"}}}},
        **wrong(401, 408, 413, 415, 422, 507),
    },
    openapi_extra=form(
        ["file"],
        file=pictures("rig.json, or OpenCV's, ROS's, Matlab's, KITTI's or Middlebury's calibration", 2, of="a file"),
        name=text("what you call it", LONGEST_LABEL),
        size=text(
            "width x height of the pictures, px, where the file does not say", 40, pattern=BY, examples=["640x480"]
        ),
        unit=text("of its lengths", 8, enum=list(METRES_PER_UNIT)),
    ),
)
async def post_rig(request: Request, client: Client, service: ServiceHere) -> Response:
    """Take a rig of any supported format: one file, or the two that belong together."""
    received = await receive_form(request, service.folders, service.settings, RIG_FORM)
    view = view_rig(await run_sync(accept_rig, service, client, received))
    return _json(view, 201, {"Location": view.links.self})


@router.get("/rigs", response_model=RigPage, responses=wrong(401, 422))
def get_rigs(client: Client, service: ServiceHere, limit: Limit = 20, after: After = None) -> Response:
    """Your rigs, newest first."""
    rigs = service.store.rigs(client, limit=limit + 1, after=after)
    shown = rigs[:limit]
    more = next_page("/v1/rigs", shown[-1].order, limit=limit) if len(rigs) > limit else None
    return _json(RigPage(items=[view_rig(rig) for rig in shown], next=more))


@router.get("/rigs/{id}", response_model=RigView, responses=wrong(401, 404))
def get_rig(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """A rig."""
    return _json(view_rig(_find(service, client, id)))


@router.get(
    "/rigs/{id}/file",
    response_class=Response,
    responses={
        200: {"description": "rig.json", "content": {"application/json": {"schema": {"type": "object"}}}},
        **wrong(401, 404),
    },
)
def get_rig_file(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """Its file, for the command line and the library."""
    _find(service, client, id)
    try:
        content = service.folders.rig(id).read_bytes()
    except FileNotFoundError:  # deleted a moment ago
        raise _missing(id) from None
    return Response(
        content, headers={"Content-Disposition": 'attachment; filename="rig.json"'}, media_type="application/json"
    )


@router.delete("/rigs/{id}", status_code=204, responses=wrong(401, 404, 409))
def delete_rig(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """Forget a rig; models that were made with it stay."""
    if not service.store.delete_rig(client, id):
        raise _missing(id)
    service.folders.remove_rig(id)
    return Response(status_code=204)


def _find(service: Service, client: str, id: str) -> RigRecord:
    rig = service.store.rig(client, id)
    if rig is None:
        raise _missing(id)
    return rig


def _missing(id: str) -> NotFound:
    return NotFound(f"there is no rig {id}: ask for the list of rigs, or send it again")


def _json(view: RigView | RigPage, status: int = 200, headers: dict[str, Any] | None = None) -> Response:
    return Response(view.model_dump_json(), status, headers, "application/json")
