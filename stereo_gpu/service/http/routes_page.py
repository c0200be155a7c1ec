"""The page: plain files that lie beside this one, and three.js as trimesh brings it."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header, Response
from fastapi import Path as PathParameter

from stereo_gpu.service.http.security import OF_PAGE
from stereo_gpu.service.refusals import NotFound
from stereo_gpu.viewer import viewer_script

FOLDER = Path(__file__).parents[1] / "page"
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}

router = APIRouter(include_in_schema=False)

Known = Annotated[str | None, Header(alias="If-None-Match")]


@router.api_route("/", methods=["GET", "HEAD"])
def index(known: Known = None) -> Response:
    """The page itself."""
    return _answer("index.html", known)


@router.api_route("/page/{name}", methods=["GET", "HEAD"])
def part(name: Annotated[str, PathParameter(max_length=100)], known: Known = None) -> Response:
    """A script, a style or a picture of it."""
    return _answer(name, known)


def _answer(name: str, known: str | None) -> Response:
    content, kind, etag = _part(name)
    headers = {"Content-Security-Policy": OF_PAGE, "Cache-Control": "no-cache", "ETag": etag}
    if known == etag:
        return Response(status_code=304, headers=headers)
    return Response(content, headers=headers, media_type=kind)


def _part(name: str) -> tuple[bytes, str, str]:
    """Content, type and ETag of a part."""
    if name == "three.js":
        return _three()
    # By the names that are there, so that no other can be made to mean anything.
    parts = {path.name: path for path in FOLDER.iterdir() if path.suffix in KINDS}
    if name not in parts:
        raise NotFound(f"the page has no part {name!r:.60}: open /")
    content = parts[name].read_bytes()
    return content, KINDS[parts[name].suffix], _etag(content)


@cache  # 700 kB out of an archive
def _three() -> tuple[bytes, str, str]:
    content = viewer_script().encode()
    if not content:
        raise NotFound("trimesh brings no three.js any more: the page shows a picture of the model in place of it")
    return content, KINDS[".js"], _etag(content)


def _etag(content: bytes) -> str:
    return f'"{hashlib.sha256(content).hexdigest()[:32]}"'
