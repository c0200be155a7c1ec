"""Which request is being answered, so that every line of the log that belongs to it can say so."""

from __future__ import annotations

from contextvars import ContextVar

request_id: ContextVar[str | None] = ContextVar("request_id", default=None)
