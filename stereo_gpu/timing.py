"""Seconds a step takes, collected by name."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Stopwatch:
    """Collects the wall time of named steps, and tells a listener when one begins."""

    def __init__(self, began: Callable[[str], None] | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._began = began

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time the block under this name; a name used twice adds up."""
        if self._began is not None:
            self._began(name)
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
