"""The whole service but for HTTP: opened on a folder, and closed in order."""

from __future__ import annotations

import logging
import shutil
from contextlib import ExitStack
from dataclasses import dataclass

from stereo_gpu.engines.executor import Executor
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.data.housekeeping import Housekeeping
from stereo_gpu.service.dispatch.dispatcher import Dispatcher
from stereo_gpu.service.dispatch.workers import open_workers
from stereo_gpu.service.live import Live
from stereo_gpu.service.metrics import Metrics
from stereo_gpu.service.outlines import Desk
from stereo_gpu.service.settings import MEGABYTE, Settings
from stereo_gpu.service.store import Store

FIRST_CLIENT = "owner"

log = logging.getLogger("stereo_gpu.service")


@dataclass(kw_only=True)
class Service:
    """What routes and commands work with; `open` makes one.

    Args:
        settings: an operator's.
        folders: where files lie.
        store: the table.
        live: how far the jobs under way are.
        executor: the workers.
        dispatcher: which gives them the jobs.
        metrics: what is counted.
        housekeeping: what removes what is old.
        desk: where views to paint on are made.
        new_token: of the first client, where this start made it; None otherwise.
    """

    settings: Settings
    folders: Folders
    store: Store
    live: Live
    executor: Executor
    dispatcher: Dispatcher
    metrics: Metrics
    housekeeping: Housekeeping
    desk: Desk
    new_token: str | None
    resources: ExitStack

    @classmethod
    def open(cls, settings: Settings) -> Service:
        """Open the folder, make what is missing in it, start the workers and begin with what waits.

        Raises:
            InputError: the folder is another server's, damaged or cannot be written, or a setting is wrong.
            BackendError: the device is missing.
        """
        stack = ExitStack()
        try:
            return cls._opened(settings, stack)
        except BaseException:
            stack.close()
            raise

    @classmethod
    def _opened(cls, settings: Settings, stack: ExitStack) -> Service:
        folders = Folders(settings.data)
        stack.enter_context(folders.own())
        store = Store(folders.database)
        stack.callback(store.close)
        new_token = _first_token(store, folders)
        executor = open_workers(settings)
        stack.callback(executor.close)
        desk = Desk(settings, folders)
        stack.callback(desk.close)
        live = Live()
        metrics = Metrics(store.counts, executor, settings.data)
        service = cls(
            settings=settings,
            folders=folders,
            store=store,
            live=live,
            executor=executor,
            dispatcher=Dispatcher(store, folders, live, executor, settings, metrics),
            metrics=metrics,
            housekeeping=Housekeeping(store, folders, settings),
            desk=desk,
            new_token=new_token,
            resources=stack,
        )
        executor.start()
        desk.start()
        service.dispatcher.start()
        service.housekeeping.start()
        return service

    def not_ready(self) -> list[str]:
        """Why jobs that came now would not be done; empty where they would."""
        reasons = []
        if self.dispatcher.stopping:
            reasons.append("it is stopping")
        elif not self.dispatcher.alive:
            reasons.append("nothing gives jobs to the workers")
        if not any(worker.warm for worker in self.executor.workers()):
            reasons.append("no worker is warm yet")
        return reasons + self._faults_of_the_disk()

    def _faults_of_the_disk(self) -> list[str]:
        try:
            free = shutil.disk_usage(self.settings.data).free
        except OSError as error:
            return [f"the data folder cannot be reached: {error.strerror or error}"]
        if free < self.settings.spare_gb * 1024 * MEGABYTE:
            return [f"less than {self.settings.spare_gb:g} GB is free on the disk"]
        return []

    def close(self, grace_s: float | None = None) -> None:
        """End in order: jobs that have begun get `grace_s`, or what the settings say; the rest stays in the queue."""
        self.dispatcher.stop(self.settings.grace_seconds if grace_s is None else grace_s)
        self.housekeeping.stop()
        self.resources.close()


def _first_token(store: Store, folders: Folders) -> str | None:
    """Make the first client and keep its token in a file that its owner alone can read; None if there are clients."""
    if store.clients():
        return None
    return store.add_client(FIRST_CLIENT, keep=folders.keep_token)
