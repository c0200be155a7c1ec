"""What is done every few minutes: old jobs go, and what nobody knows of."""

from __future__ import annotations

import logging
import threading

from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.data.retention import sweep
from stereo_gpu.service.settings import Settings
from stereo_gpu.service.store import Store

EVERY_S = 600.0
LAST_S = 5.0  # for a sweep that is under way at a stop

log = logging.getLogger("stereo_gpu.service")


class Housekeeping:
    """A thread that sweeps, at once and then every `EVERY_S`; a failure is logged, and it is tried again."""

    def __init__(self, store: Store, folders: Folders, settings: Settings) -> None:
        self._store, self._folders, self._settings = store, folders, settings
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="stereo-gpu housekeeping", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """End, after the sweep that is under way, or without it: what it leaves is swept the next time."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join(LAST_S)

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                gone = sweep(self._store, self._folders, self._settings)
                if gone:
                    log.info("%d old jobs removed", gone)
            except Exception:
                log.exception("old jobs cannot be removed")
            self._over.wait(EVERY_S)
