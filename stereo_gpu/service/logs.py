"""What the service logs: one JSON object a line for machines, or plain lines for a terminal."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

from stereo_gpu.service.request_id import request_id

ROOT = "stereo_gpu"
EXTRAS = ("job", "client", "request", "status", "seconds", "reason", "worker")  # that a line may carry


class JsonLines(logging.Formatter):
    """A line: time, level, logger, message, and of job, client and request what is known; a fault has its traceback."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as one line of JSON."""
        told: dict[str, object] = {
            "time": _time(record).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **_extras(record),
        }
        if record.exc_info:
            told["traceback"] = self.formatException(record.exc_info)
        return json.dumps(told, default=str)


class PlainLines(logging.Formatter):
    """Time, level where it is worth a look, the message, and the job or request that it belongs to."""

    def format(self, record: logging.LogRecord) -> str:
        """The record as a line; a fault is followed by its traceback."""
        level = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        about = "".join(f" [{name} {value}]" for name, value in _extras(record).items() if name in ("job", "client"))
        line = f"{_time(record).astimezone():%H:%M:%S} {level}{' '.join(record.getMessage().split())}{about}"
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


@contextmanager
def show_logs(*, as_json: bool, debug: bool = False) -> Iterator[None]:
    """Write what this library logs to stderr until the block ends, in place of what showed it before.

    Args:
        as_json: as `JsonLines`; else as `PlainLines`.
        debug: whether everything is told; else from level info on.
    """
    logger = logging.getLogger(ROOT)
    handler = logging.StreamHandler()
    handler.setFormatter(JsonLines() if as_json else PlainLines())
    before, level, up = logger.handlers[:], logger.level, logger.propagate
    logger.handlers[:] = [handler]
    logger.setLevel(logging.DEBUG if debug else logging.INFO)
    logger.propagate = False
    try:
        yield
    finally:
        logger.handlers[:] = before
        logger.setLevel(level)
        logger.propagate = up


def _time(record: logging.LogRecord) -> datetime:
    return datetime.fromtimestamp(record.created, UTC)


def _extras(record: logging.LogRecord) -> dict[str, object]:
    found = {name: getattr(record, name) for name in EXTRAS if getattr(record, name, None) is not None}
    if "request" not in found and (name := request_id.get()) is not None:
        found["request"] = name
    return found
