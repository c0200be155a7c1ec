"""Outlines over HTTP: send a pair, see its rectified view, paint on it, get the mask."""

from __future__ import annotations

from typing import Annotated, Any

from anyio.to_thread import run_sync
from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from stereo_gpu.images import check_one_size
from stereo_gpu.mask import MOST_STROKES
from stereo_gpu.match_options import parse_view
from stereo_gpu.service.http.accepting import named_rig
from stereo_gpu.service.http.asking import Client, IdHere, ServiceHere
from stereo_gpu.service.http.models import ID, Href, Id, Time, View, moment
from stereo_gpu.service.http.openapi import body, form, picture, text, wrong
from stereo_gpu.service.intake.multipart import FileWanted, FormSpec
from stereo_gpu.service.intake.uploads import receive_form
from stereo_gpu.service.jobs.outline_work import Strokes
from stereo_gpu.service.outlines import Outline
from stereo_gpu.types import View as Side

router = APIRouter(prefix="/v1/outlines", tags=["outlines"])

OUTLINE_FORM = FormSpec(
    files={"left": FileWanted(), "right": FileWanted()}, fields={"rig": 64, "reference": 10}, required=("rig",)
)
FAR = 1e6  # px: farther from the picture no brush is moved
Coordinate = Annotated[float, Field(ge=-FAR, le=FAR, allow_inf_nan=False)]
Point = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Rectangle = Annotated[list[Annotated[int, Field(ge=0, le=int(FAR))]], Field(min_length=4, max_length=4)]


class OutlineView(View):
    """A view to paint on."""

    id: Id
    width: int = Field(description="px, of the rectified reference view, in which all that is painted is measured")
    height: int
    picture: Href = Field(description="a JPEG of it, smaller if it is large")
    expires: Time


class Brush(BaseModel):
    """A stroke of a brush; strict, as all that is painted."""

    model_config = ConfigDict(extra="forbid", strict=True)

    radius: float = Field(gt=0, le=FAR, allow_inf_nan=False, description="px")
    points: list[Point] = Field(min_length=1, max_length=50_000, description="[x, y] of its centre, px")


class Painted(BaseModel):
    """What somebody has painted."""

    model_config = ConfigDict(extra="forbid", strict=True)

    rectangle: Rectangle | None = Field(None, description="x, y, width, height around it, px")
    wanted: list[Brush] = Field(default_factory=list, max_length=MOST_STROKES, description="strokes over it")
    unwanted: list[Brush] = Field(default_factory=list, max_length=MOST_STROKES, description="strokes beside it")


@router.post(
    "",
    status_code=201,
    response_model=OutlineView,
    responses={
        201: {"model": OutlineView, "description": "it is kept for an hour"},
        **wrong(401, 408, 413, 415, 422, 507),
    },
    openapi_extra=form(
        ["left", "right", "rig"],
        left=picture("the left camera's picture, as it took it"),
        right=picture("the right camera's"),
        rig=text("id of a rig", 64, pattern=ID),
        reference=text("the view to paint on", 10, enum=[str(side) for side in Side]),
    ),
)
async def post_outline(request: Request, client: Client, service: ServiceHere) -> Response:
    """Rectify a pair, so that the object can be painted in its reference view."""
    received = await receive_form(request, service.folders, service.settings, OUTLINE_FORM)
    try:
        check_one_size(received.files["left"][0].picture_size, received.files["right"][0].picture_size)
        rig = await run_sync(named_rig, service, client, received)
        reference = str(parse_view(received.fields.get("reference", "right")))
    except BaseException:
        with received:  # removes it
            raise
    outline = await service.desk.open(client, received, service.folders.rig(rig.id), reference)
    return Response(_view(outline).model_dump_json(), 201, media_type="application/json")


@router.get(
    "/{id}/picture",
    response_class=Response,
    responses={200: body("image/jpeg", "the rectified reference view"), **wrong(401, 404)},
)
def get_outline_picture(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """The view to paint on."""
    return Response(service.desk.picture(service.desk.find(client, id)), media_type="image/jpeg")


@router.post(
    "/{id}/mask",
    response_class=Response,
    responses={
        200: body("image/png", "white where the object is; to be sent as `mask` of a job"),
        **wrong(401, 404, 408, 413, 415, 422),
    },
)
async def post_outline_mask(id: IdHere, painted: Painted, client: Client, service: ServiceHere) -> Response:
    """Cut out what was painted (GrabCut)."""
    outline = await run_sync(service.desk.find, client, id)
    x, y, width, height = painted.rectangle or (0, 0, 0, 0)
    rectangle = None if painted.rectangle is None else (x, y, width, height)
    png = await service.desk.mask(outline, rectangle, _strokes(painted.wanted), _strokes(painted.unwanted))
    return Response(png, media_type="image/png")


def _strokes(marks: list[Brush]) -> Strokes:
    return [(mark.radius, [(x, y) for x, y in mark.points]) for mark in marks]


def _view(outline: Outline) -> OutlineView:
    values: dict[str, Any] = {"id": outline.id, "width": outline.width, "height": outline.height}
    return OutlineView(picture=f"/v1/outlines/{outline.id}/picture", expires=moment(outline.expires), **values)
