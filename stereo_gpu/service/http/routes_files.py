"""The files of a job over HTTP: its result, the pictures that it was sent with, and those of its steps."""

from __future__ import annotations

import mimetypes
from typing import Annotated, Any

from fastapi import APIRouter, Path, Response

from stereo_gpu.service.data.manifest import Manifest
from stereo_gpu.service.http.asking import Client, IdHere, ServiceHere
from stereo_gpu.service.http.models import FileList, FileView
from stereo_gpu.service.http.openapi import body, header, wrong
from stereo_gpu.service.http.send_file import FileAnswer
from stereo_gpu.service.records import Job, State
from stereo_gpu.service.refusals import Conflict, NotFound
from stereo_gpu.service.service import Service

router = APIRouter(prefix="/v1/jobs/{id}", tags=["files"])

Name = Annotated[str, Path(min_length=1, max_length=100)]
_ANY = "application/octet-stream"
_WHOLE = {"ETag": "its sha256, in quotes", "Accept-Ranges": "bytes", "Content-Disposition": "its name"}
_ASKED = {
    "parameters": [
        header("Range", "one part of it, such as bytes=0-99; several are answered with the whole"),
        header("If-Range", "an ETag: the part only if it is still that file"),
        header("If-None-Match", "ETags that you have: 304 if it is one of them"),
    ]
}
_SENT: dict[int | str, dict[str, Any]] = {
    200: body("*/*", "the file; its type is that of the list", headers=_WHOLE),
    206: body("*/*", "a part of it", headers={**_WHOLE, "Content-Range": "which bytes, of how many"}),
    304: {"description": "it is the one that you have"},
}


@router.get("/files", response_model=FileList, responses=wrong(401, 404, 409))
def get_files(id: IdHere, client: Client, service: ServiceHere) -> Response:
    """All files of a result."""
    manifest = _manifest(service, service.store.job(client, id))
    items = [
        FileView(
            name=file.name,
            bytes=file.bytes,
            sha256=file.sha256,
            type=file.type,
            href=f"/v1/jobs/{id}/files/{file.name}",
        )
        for file in manifest.files
    ]
    return Response(FileList(items=items).model_dump_json(), media_type="application/json")


@router.head("/files/{name}", include_in_schema=False)
@router.get(
    "/files/{name}",
    response_class=Response,
    responses={**_SENT, **wrong(401, 404, 409, 416)},
    openapi_extra=_ASKED,
)
def get_file(id: IdHere, name: Name, client: Client, service: ServiceHere) -> Response:
    """A file of a result, or a part of it."""
    file = _manifest(service, service.store.job(client, id)).file(name)
    path = service.folders.result(id) / file.name
    return FileAnswer(path, media_type=file.type, etag=file.sha256, download=file.name)


@router.head("/inputs/{name}", include_in_schema=False)
@router.get(
    "/inputs/{name}", response_class=Response, responses={**_SENT, **wrong(401, 404, 416)}, openapi_extra=_ASKED
)
def get_input(id: IdHere, name: Name, client: Client, service: ServiceHere) -> Response:
    """A picture as it was sent."""
    for sent in service.store.job(client, id).inputs:
        if sent.name == name:
            kind = mimetypes.guess_type(sent.name)[0] or _ANY
            return FileAnswer(service.folders.inputs(id) / sent.name, media_type=kind, etag=sent.sha256)
    raise NotFound(f"job {id} was sent with no {name!r:.60}: its `inputs` say with which pictures")


@router.get(
    "/steps/{name}",
    response_class=Response,
    responses={200: body("image/jpeg", "the picture"), **wrong(401, 404)},
)
def get_step(id: IdHere, name: Name, client: Client, service: ServiceHere) -> Response:
    """A picture of a step, as soon as the job names it."""
    service.store.job(client, id)
    try:
        content = service.folders.step(id, name.removesuffix(".jpg")).read_bytes()
    except FileNotFoundError:
        raise NotFound(f"job {id} has no picture of step {name!r:.60}: its `steps` say what there is") from None
    return Response(content, media_type="image/jpeg")


def _manifest(service: Service, job: Job) -> Manifest:
    if job.state is not State.DONE:
        raise Conflict(f"job {job.id} is {job.state}: it has files once it is done")
    manifest = service.folders.manifest(job.id)
    if manifest is None:
        raise NotFound(f"the files of job {job.id} are missing or damaged: send its pair again")
    return manifest
