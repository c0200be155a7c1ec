"""Run one launch of a Warp kernel on the CPU from several threads, each with a band of the work-items.

Warp runs a launch on one core and counts its work-items from 0, so a band needs a kernel that counts from elsewhere.
That kernel is made from the source of the first one: one parameter more, added to the slowest axis of `wp.tid()`.
"""

from __future__ import annotations

import inspect
import linecache
import os
import re
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

FIRST = "first_of_band"
# More bands than threads even out work-items of unequal cost, such as the diagonals of a picture.
_BANDS_A_THREAD = 4
_TID = re.compile(r"^( +)(\w+)((?:, \w+)*) = wp\.tid\(\)$", re.MULTILINE)
_PARAMETERS = re.compile(r"^( +)# In:$", re.MULTILINE)


@cache
def banded(kernel: Any) -> Any:
    """The kernel that counts its work-items from its own first parameter, FIRST, on the slowest axis.

    The whole file is run again as a module of its own, since Warp compiles by module and reads a kernel's source.

    Raises:
        ValueError: the file does not call `wp.tid()` and open its parameters, each in one place, as kernels do.
    """
    origin = inspect.getfile(kernel.func)
    text, tids = _TID.subn(rf"\g<0>\n\1\2 += {FIRST}", Path(origin).read_text("utf-8"))
    text, headings = _PARAMETERS.subn(rf"\1{FIRST}: int,\n\g<0>", text)
    if (tids, headings) != (1, 1):
        raise ValueError(f"{origin} has {tids} lines '... = wp.tid()' and {headings} '# In:': write one of each")
    name, file = f"{kernel.func.__module__}_bands", f"<bands of {origin}>"
    # Where Python, and through it Warp, finds the source of code that stands in no file.
    linecache.cache[file] = len(text), None, text.splitlines(keepends=True), file
    module = ModuleType(name)
    module.__file__ = file
    sys.modules[name] = module
    exec(compile(text, file, "exec"), module.__dict__)
    return getattr(module, kernel.func.__name__)


def cut(length: int, threads: int) -> list[tuple[int, int]]:
    """Cut a range of work-items into bands (first, how many) for so many threads."""
    bands = min(length, threads * _BANDS_A_THREAD)
    edges = [length * k // bands for k in range(bands + 1)]
    return [(first, last - first) for first, last in pairwise(edges)]


class Crew:
    """Threads that run bands; they start when first needed, and anew in a process that was forked."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def run(self, tasks: Sequence[Callable[[], None]]) -> None:
        """Run tasks and return when the last one has ended; the first error of any of them is raised then."""
        if self.threads == 1 or len(tasks) == 1:
            for task in tasks:
                task()
            return
        if self._pool is None or self._process != os.getpid():
            self._pool, self._process = ThreadPoolExecutor(self.threads, "stereo-gpu-warp"), os.getpid()
        running: list[Future[None]] = [self._pool.submit(task) for task in tasks]
        errors = [error for future in running if (error := future.exception())]
        if errors:
            raise errors[0]
