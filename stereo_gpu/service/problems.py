"""Every error as a problem document (RFC 9457) whose `detail` is the line that the command line would print."""

from __future__ import annotations

import errno
import logging
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.routing import Match

from stereo_gpu.errors import InputError, StereoError
from stereo_gpu.service.refusals import Conflict, DiskFull, NotFound, QueueFull, StoreError

MEDIA_TYPE = "application/problem+json"
# What RFC 9110 calls them; Python before 3.13 has the names of an older one.
TITLES = {413: "Content Too Large", 416: "Range Not Satisfiable", 422: "Unprocessable Content"}
SHOWN = 60  # characters of a wrong value
STATUSES: dict[type[StereoError], int] = {NotFound: 404, Conflict: 409, InputError: 422}
FULL = "the disk of the service is full: delete jobs, or try again later"
UNUSABLE = "the service cannot read or write its folder: try again later, or tell its operator"
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")

log = logging.getLogger(__name__)


class Problem(StereoError):
    """What only HTTP knows: a request that is too large, too slow or of the wrong type; a service that is busy.

    Args:
        status: of the answer.
        detail: one line: the thing, the value, the way out.
        headers: of the answer besides, such as Retry-After.
    """

    def __init__(self, status: int, detail: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(detail)
        self.status = status
        self.headers = dict(headers or {})


def answer_problem(status: int, detail: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """The answer that tells of it."""
    title = TITLES.get(status) or HTTPStatus(status).phrase
    content = {"type": "about:blank", "title": title, "status": status, "detail": detail}
    return JSONResponse(content, status, headers=dict(headers or {}), media_type=MEDIA_TYPE)


def install_problems(app: FastAPI) -> None:
    """Have the app answer so to whatever its routes and the framework raise."""
    app.add_exception_handler(StereoError, _own)
    app.add_exception_handler(HTTPException, _of_framework)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(OSError, _of_system)


def answer_fault(request_id: str) -> JSONResponse:
    """For what nobody foresaw; its traceback is for the log, not for the client."""
    return answer_problem(
        500, f"the service has a fault: tell its operator, whose log says more of request {request_id}"
    )


async def _own(request: Request, error: Exception) -> JSONResponse:
    if isinstance(error, Problem):
        return answer_problem(error.status, str(error), error.headers)
    if isinstance(error, QueueFull):
        return answer_problem(429, str(error), {"Retry-After": str(error.retry_s)})
    for kind, status in STATUSES.items():
        if isinstance(error, kind):
            return answer_problem(status, str(error))
    log.error("%s %s: %s", request.method, request.url.path, error)
    if isinstance(error, DiskFull):
        return answer_problem(507, FULL, {"Retry-After": "60"})
    if isinstance(error, StoreError):  # it names the service's own files, which are none of the client's business
        return answer_problem(503, UNUSABLE, {"Retry-After": "10"})
    return answer_problem(503, str(error), {"Retry-After": "10"})


async def _of_framework(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    detail = str(error.detail)
    path = request.url.path[:SHOWN]
    if error.status_code == 404:
        detail = f"{path!r}: there is nothing of this name; /openapi.json lists what there is"
    if error.status_code == 400:  # of a body that cannot even be parsed; it does not say why
        detail = "the body is no JSON that can be read: send a plain object, without numbers of thousands of digits"
    if error.status_code == 405:
        headers["Allow"] = ", ".join(_allowed(request))
        detail = f"{request.method[:SHOWN]!r} is not for {path!r}: ask with {headers['Allow']}"
    return answer_problem(error.status_code, detail, headers)


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    """What does not fit the declared parameters or JSON body."""
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    place = first["loc"][0] if first["loc"] else ""
    if place == "path":
        return answer_problem(
            404, f"{request.url.path[:SHOWN]!r}: there is nothing of this name; an id has 32 hex digits"
        )
    if first["type"] == "json_invalid":
        return answer_problem(400, f"the body is no JSON: {_line(first.get('ctx', {}).get('error', first['msg']))}")
    kind = request.headers.get("content-type", "")
    if place == "body" and len(first["loc"]) == 1 and not _is_json(kind):
        return answer_problem(415, f"the body is of type {kind[:SHOWN] or 'none'!r}: send application/json")
    # A name may be the client's own: a line break, or anything.
    name = " ".join(".".join(str(part) for part in first["loc"][1:]).split()) or "the body"
    if first["type"] == "missing":
        return answer_problem(422, f"{name[:SHOWN]} is missing: give it; /openapi.json says how")
    return answer_problem(422, f"{name[:SHOWN]} = {_shown(first.get('input'))}: {_line(first['msg'])}")


async def _of_system(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, OSError)
    log.error("%s %s: %s", request.method, request.url.path, error, exc_info=error)
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return answer_problem(507, FULL, {"Retry-After": "60"})
    return answer_problem(503, UNUSABLE, {"Retry-After": "10"})


def _allowed(request: Request) -> list[str]:
    """All methods of this path: the framework names those of its first route alone."""
    found = set()
    for method in METHODS:
        scope = {**request.scope, "method": method}
        if any(route.matches(scope)[0] is Match.FULL for route in request.app.routes):
            found.add(method)
    return sorted(found)


def _is_json(kind: str) -> bool:
    essence = kind.partition(";")[0].strip().lower()
    return essence == "application/json" or (essence.startswith("application/") and essence.endswith("+json"))


def _shown(value: Any) -> str:
    """A wrong value, of which the middle is left out if it is long."""
    try:
        text = repr(value)
    except RecursionError:
        return "something deep"
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 10]}...{text[-7:]}"


def _line(text: str) -> str:
    """As we write: one line that does not begin with a capital."""
    text = " ".join(str(text).split())
    return text[:1].lower() + text[1:]
