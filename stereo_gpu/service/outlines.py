"""Views to paint on: made, kept for an hour, and cut out along what was painted, by a worker of their own.

A person waits for the outline, so that it must not stand in the queue behind jobs: the desk is an executor with one
warm process, at which few may wait.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from anyio.to_thread import run_sync

from stereo_gpu.engines.choose import open_executor
from stereo_gpu.engines.executor import Executor, Limits, Work
from stereo_gpu.errors import WorkerError
from stereo_gpu.files import write_whole
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.intake.uploads import Form
from stereo_gpu.service.jobs.outline_work import PICTURE, Rectangle, Strokes, do_task, prepare
from stereo_gpu.service.problems import Problem
from stereo_gpu.service.refusals import NotFound
from stereo_gpu.service.settings import MEGABYTE, Settings

KEPT_S = 3600.0
MOST_WAITING = 8  # at the desk: behind more nobody would wait
MOST_EACH = 20  # views of one client; its oldest go first
RECORD = "outline.json"
LIMITS = Limits(seconds=60.0, memory_bytes=8192 * MEGABYTE)


@dataclass(frozen=True, kw_only=True)
class Outline:
    """A view to paint on, as RECORD in its folder has it.

    Args:
        id: 32 hexadecimal digits.
        client: whose it is.
        width, height: of the rectified reference view, px.
        expires: seconds since 1970.
    """

    id: str
    client: str
    width: int
    height: int
    expires: float


class Desk:
    """Makes views and masks.

    Args:
        settings: backend.
        folders: of the service.
        clock: seconds since 1970.
    """

    def __init__(self, settings: Settings, folders: Folders, clock: Callable[[], float] = time.time) -> None:
        self._folders = folders
        self._clock = clock
        self._waiting = 0
        self._changing = threading.Lock()
        # Here rather than on a cluster: who paints is near.
        shared = {"backend": settings.backend if settings.engine != "ray" else None}
        self._executor: Executor = open_executor("local", Work(task=do_task, shared=shared, prepare=prepare), workers=1)

    def start(self) -> None:
        """Warm the worker; returns at once."""
        self._executor.start()

    def close(self) -> None:
        """End the worker; open questions are answered 503."""
        self._executor.close()

    async def open(self, client: str, form: Form, rig: Path, reference: str) -> Outline:
        """Make the view of a pair that was received; the form's folder becomes the outline's.

        Raises:
            InputError: the pictures cannot be read, or do not fit each other or the rig.
            Problem: too many wait.
        """
        with form:
            (left,), (right,) = form.files["left"], form.files["right"]
            width, height = await self._ask("view", form.folder, (left.name, right.name, rig, reference))
            expires = self._clock() + KEPT_S
            outline = Outline(id=secrets.token_hex(16), client=client, width=width, height=height, expires=expires)
            await run_sync(self._keep, form, outline)
            return outline

    def find(self, client: str, id: str) -> Outline:
        """An outline of this client.

        Raises:
            NotFound: there is none, or its hour is over.
        """
        outline = _read(self._folders.outline(id))
        if outline is None or outline.client != client or outline.expires < self._clock():
            raise NotFound(f"there is no outline {id}, or its hour is over: send the pair again")
        return outline

    def picture(self, outline: Outline) -> bytes:
        """A JPEG of the view.

        Raises:
            NotFound: it was removed a moment ago.
        """
        try:
            return (self._folders.outline(outline.id) / PICTURE).read_bytes()
        except FileNotFoundError:
            raise NotFound(f"there is no outline {outline.id} any more: send the pair again") from None

    async def mask(
        self,
        outline: Outline,
        rectangle: Rectangle | None,
        wanted: Strokes,
        unwanted: Strokes,
    ) -> bytes:
        """The mask of what was painted, (radius, points) a stroke, as PNG.

        Raises:
            InputError: the marks are wrong, or nothing is found by them.
            Problem: too many wait.
        """
        png = await self._ask("mask", self._folders.outline(outline.id), (rectangle, wanted, unwanted))
        assert isinstance(png, bytes)
        return png

    async def _ask(self, what: str, folder: Path, given: tuple[object, ...]) -> Any:
        with self._changing:
            if self._waiting >= MOST_WAITING:
                said = f"{self._waiting} wait for an outline already: ask again in a moment"
                raise Problem(503, said, {"Retry-After": "2"})
            self._waiting += 1
        try:
            running = self._executor.submit((what, folder, given), limits=LIMITS)
        except BaseException:
            self._left()
            raise
        # Whoever goes away meanwhile leaves the worker warm for the others: it finishes what it has begun.
        running.answer.add_done_callback(lambda _: self._left())
        answer = await asyncio.shield(asyncio.wrap_future(running.answer))
        if isinstance(answer.error, WorkerError):
            raise Problem(503, f"the outline could not be made: {answer.error}", {"Retry-After": "2"})
        if answer.error is not None:
            raise answer.error
        return answer.result

    def _left(self) -> None:
        with self._changing:
            self._waiting -= 1

    def _keep(self, form: Form, outline: Outline) -> None:
        for file in form.inputs:
            form.path(file).unlink()
        write_whole(form.folder / RECORD, json.dumps(asdict(outline)))
        form.folder.rename(self._folders.outline(outline.id))
        form.keep()
        self._forget_oldest(outline.client)

    def _forget_oldest(self, client: str) -> None:
        """Keep no more than MOST_EACH of a client, and none whose hour is over."""
        now = self._clock()
        found = [outline for path in self._folders.outlines.iterdir() if (outline := _read(path)) is not None]
        found.sort(key=lambda outline: outline.expires)
        own = [outline for outline in found if outline.client == client]
        for outline in {*own[:-MOST_EACH], *(each for each in found if each.expires < now)}:
            with suppress(OSError):
                self._folders.remove_outline(outline.id)


def _read(folder: Path) -> Outline | None:
    try:
        return Outline(**json.loads((folder / RECORD).read_text("utf-8")))
    except (OSError, ValueError, TypeError):
        return None
