"""What stands before all routes: which hosts are meant, the headers of every answer, and faults that nobody foresaw."""

from __future__ import annotations

import ipaddress
import logging
import secrets
import time
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stereo_gpu.service.problems import answer_fault, answer_problem
from stereo_gpu.service.request_id import request_id
from stereo_gpu.service.settings import Settings

# Answers of the interface are data, and never a document that could do anything.
OF_DATA = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox"
# The page: its own scripts and styles and nothing inline; pictures and models come as blobs, with the token.
OF_PAGE = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self';"
    " base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
ALWAYS = {
    "content-security-policy": OF_DATA,
    "cache-control": "no-store",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}

log = logging.getLogger(__name__)


def hosts_of(settings: Settings) -> frozenset[str] | None:
    """The names by which a service that only this machine reaches may be called; None where it listens to others.

    A page of another site whose name is made to mean 127.0.0.1 (DNS rebinding) comes with its own name.
    """
    if not _is_loopback(settings.host):
        return None
    linked = urlsplit(settings.link).hostname if settings.link else None
    return frozenset({"localhost", "127.0.0.1", "::1", settings.host.lower(), *([linked] if linked else [])})


class Guard:
    """The outermost layer of the app.

    Args:
        app: what is guarded.
        hosts: as `hosts_of` says.
    """

    def __init__(self, app: ASGIApp, *, hosts: Iterable[str] | None) -> None:
        self._app = app
        self._hosts = None if hosts is None else frozenset(hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; there are no web sockets."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        name = secrets.token_hex(8)
        token = request_id.set(name)
        answer = _Answer(send, name)
        began = time.monotonic()
        try:
            await self._answer(scope, receive, answer)
        except ClientDisconnect:
            pass  # there is nobody left to tell
        except Exception:
            log.exception("%s %s failed", scope["method"], _path(scope))
            if answer.status is not None:
                raise  # half of it has gone out: only a closed connection says that the rest is missing
            await answer_fault(name)(scope, receive, answer.send)
        finally:
            request_id.reset(token)
            self._log(scope, answer, time.monotonic() - began, name)

    async def _answer(self, scope: Scope, receive: Receive, answer: _Answer) -> None:
        host = Headers(scope=scope).get("host", "")
        if self._hosts is not None and _name(host) not in self._hosts:
            said = f"host {host[:60]!r} is not this service: call it by the address that `stereo-gpu serve` printed"
            await answer_problem(400, said)(scope, receive, answer.send)
            return
        await self._app(scope, receive, answer.send)

    def _log(self, scope: Scope, answer: _Answer, seconds: float, name: str) -> None:
        client = scope.get("state", {}).get("client")
        log.info(
            "%s %s %s",
            scope["method"],
            _path(scope),
            answer.status or "left",
            extra={"request": name, "client": client, "status": answer.status, "seconds": round(seconds, 4)},
        )


class _Answer:
    """Passes an answer on, with the headers that every one has."""

    def __init__(self, send: Send, name: str) -> None:
        self._send = send
        self._name = name
        self.status: int | None = None

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            headers = MutableHeaders(scope=message)
            for key, value in ALWAYS.items():
                headers.setdefault(key, value)
            headers["x-request-id"] = self._name
        await self._send(message)


def _path(scope: Scope) -> str:
    """As it was sent: decoded, it could hold line ends that make lines of the log."""
    raw: bytes = scope.get("raw_path") or b""
    return raw.decode("ascii", "backslashreplace")


def _name(host: str) -> str:
    """Without the port, in small letters; IPv6 without brackets."""
    if host.startswith("["):
        return host[1:].partition("]")[0].lower()
    return host.rpartition(":")[0].lower() if ":" in host else host.lower()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"
