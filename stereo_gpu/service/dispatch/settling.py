"""What becomes of a job when its worker has answered: kept, tried again, given back, failed; once, whatever fails."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

from stereo_gpu.engines.executor import Answer
from stereo_gpu.errors import BackendError, CancelledError, StereoError, WorkerError
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.dispatch.endings import end_badly, end_well
from stereo_gpu.service.dispatch.under_way import Entry, UnderWay
from stereo_gpu.service.jobs.outcome import Outcome
from stereo_gpu.service.live import Live
from stereo_gpu.service.metrics import Metrics
from stereo_gpu.service.records import State
from stereo_gpu.service.refusals import DiskFull, StoreError
from stereo_gpu.service.store import Ending, Store

MOST_FAILURES = 5  # of putting a result in its place, after which the try is lost

log = logging.getLogger("stereo_gpu.service")


class Settling:
    """Collects what is to be written of answers, and writes it in one transaction. For one thread.

    Args:
        owner: whose leases they are.
        store, folders: where it is written, and where results take their places.
        live, metrics: told of it.
        under_way: what is settled is taken out of it.
        tries: after so many lost ones a job has failed.
    """

    def __init__(
        self,
        owner: str,
        store: Store,
        folders: Folders,
        live: Live,
        metrics: Metrics,
        under_way: UnderWay,
        tries: int,
    ) -> None:
        self._owner, self._store, self._folders, self._live = owner, store, folders, live
        self._metrics, self._under_way, self._tries = metrics, under_way, tries
        self._endings: list[tuple[Entry, Ending]] = []
        self._returns: dict[bool, list[Entry]] = {True: [], False: []}  # by whether the try counts

    def take(self, entry: Entry, answer: Answer, *, stopping: bool) -> None:
        """Settle one answer, but for the table; nothing has happened where this fails, and it may be done again.

        Args:
            entry: whose answer it is.
            answer: of its worker.
            stopping: whether the service is, so that a worker may have been stopped with it.

        Raises:
            StereoError, OSError: the table or the disk fails.
        """
        try:
            self._take(entry, answer, stopping)
        except Exception as error:
            entry.failures += 1
            if entry.failures < MOST_FAILURES:
                raise
            self._lose_result(entry, answer, error)

    def _take(self, entry: Entry, answer: Answer, stopping: bool) -> None:
        error = answer.error
        if entry.taken:
            self._forget(entry)
        elif error is None:
            self._keep(entry, answer)
        elif entry.cancelled:
            self.end(entry, end_badly(entry.lease, CancelledError("cancelled"), answer.seconds))
        elif isinstance(error, CancelledError):  # by a stop, of the service or of the executor
            self._give_back(entry, charge=False)
        elif isinstance(error, WorkerError) and (stopping or answer.worker is None):
            # Whatever stopped us may have stopped the workers, too; and what no worker had was not tried.
            self._give_back(entry, charge=False)
        elif isinstance(error, WorkerError):
            self._try_again(entry, error, answer.seconds, "worker")
        elif isinstance(error, BackendError):  # a device that others filled or upset may be well the next time
            self._try_again(entry, error, answer.seconds, "device")
        else:
            self.end(entry, end_badly(entry.lease, error, answer.seconds))

    def _keep(self, entry: Entry, answer: Answer) -> None:
        device = answer.result["device"]
        if device is not None:
            self._metrics.device(*device)
        outcome: Outcome = answer.result["outcome"]
        try:
            ending = end_well(self._folders, entry.lease, outcome, answer.seconds)
        except DiskFull:
            raise  # a little later there may be room
        except StoreError as error:
            self._lose_result(entry, answer, error)
            return
        self.end(entry, ending)

    def _lose_result(self, entry: Entry, answer: Answer, error: Exception) -> None:
        """A result that is not whole, or cannot be moved; why is the operator's business, for it names folders."""
        log.error("a result cannot take its place: %s", error, exc_info=error, extra={"job": entry.id})
        why = WorkerError("its result could not be kept whole: restart it, or ask whoever runs the service")
        self._try_again(entry, why, answer.seconds, "result")

    def _try_again(self, entry: Entry, why: StereoError, seconds: float, reason: str) -> None:
        self._metrics.lost(reason)
        tries = entry.lease.job.tries + 1  # it was leased before this one
        log.warning("try %d lost: %s", tries, why, extra={"job": entry.id})
        if tries < self._tries:
            self._give_back(entry, charge=True)
        else:
            # The last reason stands for all: what ended one try mostly ended the others.
            said = f"{why} (tried {tries} times)" if tries > 1 else str(why)
            self.end(entry, end_badly(entry.lease, WorkerError(said), seconds))

    def not_begun(self, entry: Entry) -> None:
        """A job that could not be given to a worker: that counts as a try, or it might be the next one for ever."""
        why = WorkerError("it could not be given to a worker: restart it, or ask whoever runs the service")
        self._try_again(entry, why, 0.0, "begin")

    def end(self, entry: Entry, ending: Ending) -> None:
        """Have a job end so, with the next `write`."""
        if ending.state is not State.DONE:
            self._folders.clear(entry.id)
        told = self._live.progress(entry.id)
        stage = None if told is None else told.stage
        self._endings.append((entry, replace(ending, stage=stage)))

    def _give_back(self, entry: Entry, *, charge: bool) -> None:
        self._folders.clear(entry.id)
        self._returns[charge].append(entry)

    def write(self) -> None:
        """Tell the table, all endings in one transaction; what fails stays to be written.

        Raises:
            StoreError: the table cannot be written.
        """
        if self._endings:
            applied = self._finish([ending for _, ending in self._endings])
            ended, self._endings = self._endings, []
            for entry, ending in ended:
                self._told(entry, ending, entry.id in applied)
        for charge, entries in self._returns.items():
            if entries:
                self._store.give_back(self._owner, [entry.id for entry in entries], charge=charge)
                self._returns[charge] = []
                for entry in entries:
                    self._forget(entry)

    def _finish(self, endings: Sequence[Ending]) -> set[str]:
        try:
            return self._store.finish(endings)
        except StoreError:
            raise
        except Exception:  # one that no table can hold must not keep all others from ending
            if len(endings) == 1:
                log.exception("its ending cannot be kept", extra={"job": endings[0].id})
                failed = WorkerError("its result cannot be kept in the table: this is a fault of ours")
                return self._store.finish(
                    [Ending(id=endings[0].id, number=endings[0].number, state=State.FAILED, error=str(failed))]
                )
            return set().union(*(self._finish([ending]) for ending in endings))

    def _told(self, entry: Entry, ending: Ending, applied: bool) -> None:
        self._forget(entry)
        if not applied and entry.cancelled:  # before it had begun: the table did that at once
            return
        if not applied:
            log.warning("ended otherwise meanwhile", extra={"job": entry.id})
            return
        self._metrics.ended(entry.lease.job.kind, ending.state, ending.seconds)
        log.info("%s%s", ending.state, f": {ending.error}" if ending.error else "", extra={"job": entry.id})

    def _forget(self, entry: Entry) -> None:
        if self._under_way.forget(entry):
            self._live.end(entry.id)
