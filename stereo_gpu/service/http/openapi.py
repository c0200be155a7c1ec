"""The OpenAPI document: what the framework cannot see is added, which is bodies of files, and every error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from stereo_gpu.boards.board import SIDES_OF_SQUARES
from stereo_gpu.service.http.models import ProblemView
from stereo_gpu.service.options import JobOptions
from stereo_gpu.service.problems import MEDIA_TYPE

ABOUT = (
    "Pairs of pictures in, textured models in real units out. Every request under /v1 carries"
    " `Authorization: Bearer TOKEN`; what one token sent, another cannot see. Every error is a problem document"
    " (RFC 9457), whose `detail` is one line: the thing, the value, the way out."
)
SAID = {
    400: "the request is no HTTP, multipart or JSON, or was meant for another host",
    401: "no token, or a wrong one",
    404: "no such thing, or another client's",
    408: "the request came too slowly",
    409: "the thing is not in a state for this",
    413: "too large",
    415: "not the type of body that is wanted",
    416: "the range lies outside of the file",
    422: "well formed, and wrong",
    429: "too many jobs wait, or streams are open",
    500: "a fault of the service",
    503: "the service is stopping, or busy",
    507: "the disk is full",
}
BY = "^ *[0-9]{1,6} *[xX×] *[0-9]{1,6} *$"  # columns x rows, width x height
_PROBLEM = {"$ref": "#/components/schemas/ProblemView"}
_RETRY = {"Retry-After": {"description": "seconds", "schema": {"type": "integer"}}}
_CHALLENGE = {"WWW-Authenticate": {"description": "Bearer", "schema": {"type": "string"}}}


def wrong(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """These errors, and those of every route, as `responses` of one."""
    return {
        status: {
            "description": SAID[status],
            "content": {MEDIA_TYPE: {"schema": _PROBLEM}},
            **({"headers": _RETRY} if status in (429, 503, 507) else {}),
            **({"headers": _CHALLENGE} if status == 401 else {}),
        }
        for status in sorted({400, 500, 503, *statuses})
    }


def body(kind: str, description: str, *, status: int = 200, headers: Mapping[str, str] | None = None) -> dict[str, Any]:
    """An answer that is no JSON, or may be anything, as an entry of `responses`."""
    kinds = {"text/plain": {"type": "string"}, "*/*": {}}
    schema: dict[str, Any] = kinds.get(kind, {"type": "string", "format": "binary"})
    told = {name: {"description": text, "schema": {"type": "string"}} for name, text in (headers or {}).items()}
    return {"description": description, "content": {kind: {"schema": schema}}, **({"headers": told} if told else {})}


def events(description: str) -> dict[str, Any]:
    """An answer of server-sent events, each with a job, as an entry of `responses`; the schema is that of one event."""
    data = {
        "type": "string",
        "contentMediaType": "application/json",
        "contentSchema": {"$ref": "#/components/schemas/JobView"},
    }
    properties = {"event": {"const": "job"}, "id": {"type": "string"}, "data": data}
    schema = {"type": "object", "required": list(properties), "properties": properties}
    return {"description": description, "content": {"text/event-stream": {"schema": schema}}}


def form(required: list[str], **fields: dict[str, Any]) -> dict[str, Any]:
    """A multipart body, as `openapi_extra`.

    Args:
        required: names of the fields that must be there.
        fields: the schema of each.
    """
    schema = {"type": "object", "required": required, "properties": fields, "additionalProperties": False}
    encoding = {name: {"contentType": "application/json"} for name, each in fields.items() if "$ref" in each}
    content = {"schema": schema, **({"encoding": encoding} if encoding else {})}
    return {"requestBody": {"required": True, "content": {"multipart/form-data": content}}}


def picture(description: str) -> dict[str, Any]:
    """The schema of a field that holds a file."""
    return {"type": "string", "format": "binary", "description": description}


def pictures(description: str, most: int, *, of: str = "a picture") -> dict[str, Any]:
    """The schema of a field that holds several files."""
    return {"type": "array", "items": picture(of), "minItems": 1, "maxItems": most, "description": description}


def text(description: str, longest: int, **more: Any) -> dict[str, Any]:
    """The schema of a field of text."""
    return {"type": "string", "maxLength": longest, "description": description, **more}


def length(description: str) -> dict[str, Any]:
    """The schema of a field that holds a length."""
    smallest, largest = SIDES_OF_SQUARES
    return {"type": "number", "minimum": smallest, "maximum": largest, "description": description}


def header(name: str, description: str) -> dict[str, Any]:
    """A header that a request may have."""
    return {"name": name, "in": "header", "required": False, "description": description, "schema": {"type": "string"}}


def install_document(app: FastAPI) -> None:
    """Have the app give the whole document."""

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            made = get_openapi(
                title=app.title,
                version=app.version,
                description=ABOUT,
                routes=app.routes,
                license_info=app.license_info,
            )
            schemas = made["components"]["schemas"]
            for model in (ProblemView, JobOptions):
                schema = model.model_json_schema(ref_template="#/components/schemas/{model}")
                schemas.update(schema.pop("$defs", {}))
                schemas[model.__name__] = schema
            _drop_foreign_errors(made)
            app.openapi_schema = made
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]


def _drop_foreign_errors(made: dict[str, Any]) -> None:
    """Take out the framework's own form of errors, which no route uses, and where it supposes one."""
    foreign = {"$ref": "#/components/schemas/HTTPValidationError"}
    for operations in made["paths"].values():
        for operation in operations.values():
            supposed = operation["responses"].get("422", {}).get("content", {}).get("application/json", {})
            if supposed.get("schema") == foreign:
                del operation["responses"]["422"]
    for name in ("HTTPValidationError", "ValidationError"):
        made["components"]["schemas"].pop(name, None)
