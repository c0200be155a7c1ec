"""Moves jobs from the table to the workers and back: leases, heartbeats, endings; one thread."""

from __future__ import annotations

import logging
import queue
import secrets
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from stereo_gpu.engines.executor import Answer, Executor, Limits, Running
from stereo_gpu.errors import CancelledError, InputError, StereoError, WorkerError
from stereo_gpu.service.endings import end_badly, end_well, find_outcome, lost
from stereo_gpu.service.folders import Folders
from stereo_gpu.service.live import Live
from stereo_gpu.service.metrics import Metrics
from stereo_gpu.service.order import WorkOrder
from stereo_gpu.service.outcome import Outcome
from stereo_gpu.service.records import Job, Lease, State
from stereo_gpu.service.refusals import DiskFull, StoreError
from stereo_gpu.service.settings import MEGABYTE, Settings
from stereo_gpu.service.store import Ending, Store

LEASED_EACH = 2  # jobs under way a worker: one that is done while the next one's order is there already
LOOK_S = 2.0  # for new jobs, even if nobody rang
AGAIN_S = 1.0  # after the table or the disk failed
MOST_FAILURES = 5  # of putting a result in its place, after which the try is lost
LATE_S = 5.0  # after its grace, when a stop waits no longer for answers

log = logging.getLogger("stereo_gpu.service")


@dataclass
class _Entry:
    """A job under way."""

    lease: Lease
    running: Running | None = None
    began: bool = False
    failures: int = 0  # of the table or the disk, while its answer was put in place
    cancelled: bool = False  # its client wants it no more
    returned: bool = False  # a stop gives it back
    taken: bool = False  # its lease is no longer ours


class Dispatcher:
    """Leases jobs, has them done, and ends each exactly once.

    An error of the table or of the disk is logged and what failed is tried again: nothing ends the thread but `stop`.

    Args:
        store, folders: what is to be done, and where it lies.
        live: told how far each job is.
        executor: does them; its task takes a `WorkOrder`.
        settings: limits, tries and leases.
        metrics: told what happens.
        clock: seconds since 1970, that of the store.
    """

    def __init__(
        self,
        store: Store,
        folders: Folders,
        live: Live,
        executor: Executor,
        settings: Settings,
        metrics: Metrics,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.owner = secrets.token_hex(16)
        self._store, self._folders, self._live, self._executor = store, folders, live, executor
        self._settings, self._metrics, self._clock = settings, metrics, clock
        memory = settings.job_memory_mb
        self._limits = Limits(seconds=settings.job_seconds, memory_bytes=None if memory is None else memory * MEGABYTE)
        self._lock = threading.Lock()  # guards the entries, which `cancel` looks up from other threads
        self._entries: dict[str, _Entry] = {}
        self._answers: queue.SimpleQueue[tuple[_Entry, Answer]] = queue.SimpleQueue()
        self._endings: list[tuple[_Entry, Ending]] = []
        self._returns: dict[bool, list[_Entry]] = {True: [], False: []}
        self._bell = threading.Event()
        self._stop_by: float | None = None
        self._beat_at = 0.0
        self._reclaimed = False
        self._short = False
        self._right: set[str] = set()  # rigs that are known to be marked checked
        self._thread = threading.Thread(target=self._run, name="stereo-gpu dispatcher", daemon=True)

    def start(self) -> None:
        """Begin to lease."""
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Whether it works; false once it has stopped."""
        return self._thread.is_alive()

    @property
    def stopping(self) -> bool:
        """Whether no more jobs are begun."""
        return self._stop_by is not None

    def wake(self) -> None:
        """There is something to do: a new job, for example."""
        self._bell.set()

    def cancel(self, job: str) -> None:
        """Stop a job that is under way, after the table has been told that it is wanted no more."""
        with self._lock:
            entry = self._entries.get(job)
        if entry is not None:
            entry.cancelled = True
            self._stop_entry(entry)

    def stop(self, grace_s: float) -> None:
        """Begin no more; jobs that have begun get `grace_s`, what is left then is given back without charge."""
        self._stop_by = time.monotonic() + grace_s
        self.wake()
        if self._thread.ident is not None:
            self._thread.join(grace_s + 2 * LATE_S)

    def _run(self) -> None:
        while not (self.stopping and self._is_over()):
            self._bell.wait(self._idle_s())
            self._bell.clear()
            try:
                self._turn()
            except Exception:  # nothing may end this thread; what was not done is still to be done
                log.exception("the dispatcher failed, and goes on")
                time.sleep(AGAIN_S)

    def _idle_s(self) -> float:
        waits = [LOOK_S, self._beat_at - time.monotonic()]
        if self._stop_by is not None:
            waits.append(self._stop_by - time.monotonic() if time.monotonic() < self._stop_by else 0.1)
        return max(0.01, min(waits))

    def _turn(self) -> None:
        if not self._reclaimed:
            self._reclaim(lambda owner: False)  # one server a folder: what others leased, they left
            self._reclaimed = True
        self._drain()
        self._finish()
        if self.stopping:
            self._give_back()
        if time.monotonic() >= self._beat_at:
            self._beat()
        if not self.stopping:
            self._lease()

    # -- from the table to the workers

    def _lease(self) -> None:
        free = LEASED_EACH * self._executor.slots - len(self._entries)
        if free <= 0 or self._is_disk_short():
            return
        leases = self._store.lease(self.owner, free, self._settings.lease_seconds)
        for lease in leases:
            entry = _Entry(lease)
            with self._lock:
                self._entries[lease.job.id] = entry
            self._live.begin(lease.job.id, lease.job.kind)
            try:
                self._begin(entry)
            except Exception as error:  # the table or the disk: the job must not stay between the two
                log.exception("cannot begin", extra={"job": lease.job.id})
                self._answers.put((entry, _failed(WorkerError(f"cannot begin: {error}"))))
                self.wake()
        if leases:
            self._live.queue_moved()

    def _begin(self, entry: _Entry) -> None:
        job = entry.lease.job
        outcome = find_outcome(self._folders, job)
        if outcome is not None:  # its result took its place just before the service died
            seconds = sum(outcome.seconds.values())
            self._endings.append((entry, end_well(self._folders, entry.lease, outcome, seconds)))
            self.wake()
            return
        order = self._order(entry.lease)
        if order is None:
            gone = InputError(f"its rig {job.rig} is there no more: send the job again with another")
            self._endings.append((entry, end_badly(entry.lease, gone, 0.0)))
            self.wake()
            return

        def began(worker: int) -> None:
            entry.began = True
            self._metrics.waited(self._clock() - job.created)
            self._live.took(job.id, worker)

        entry.running = self._executor.submit(
            (order,), limits=self._limits, began=began, tell=lambda word: self._live.tell(job.id, word)
        )
        entry.running.answer.add_done_callback(lambda answer: self._answered(entry, answer.result()))
        if entry.cancelled:
            entry.running.cancel()

    def _answered(self, entry: _Entry, answer: Answer) -> None:
        self._answers.put((entry, answer))
        self.wake()

    def _order(self, lease: Lease) -> WorkOrder | None:
        """What the worker is told; None where the job's rig is gone."""
        job = lease.job
        wanted = str(job.options.get("check", "first"))
        if job.rig is not None and wanted == "first":
            rig = self._store.rig(job.client, job.rig)
            if rig is None:
                return None
            wanted = "rows" if rig.checked else "full"
        return WorkOrder(
            job=job.id,
            number=lease.number,
            kind=job.kind,
            options=job.options,
            inputs=tuple(each.name for each in job.inputs),
            rig=job.rig,
            check="full" if wanted == "first" else wanted,
        )

    def _is_disk_short(self) -> bool:
        """Whether the disk has too little room to begin: half of what is spared, when uploads have long stopped."""
        short = shutil.disk_usage(self._settings.data).free < self._settings.spare_gb / 2 * 1024 * MEGABYTE
        if short != self._short:
            log.log(logging.ERROR if short else logging.INFO, "the disk is %s", "full" if short else "no longer full")
        self._short = short
        return short

    # -- from the workers to the table

    def _drain(self) -> None:
        while True:
            try:
                entry, answer = self._answers.get_nowait()
            except queue.Empty:
                return
            try:
                self._conclude(entry, answer)
            except Exception as error:
                entry.failures += 1
                if entry.failures < MOST_FAILURES:
                    self._answers.put((entry, answer))
                    raise
                log.exception("a result cannot take its place", extra={"job": entry.lease.job.id})
                self._try_again(entry, WorkerError(f"its result cannot take its place: {error}"), answer.seconds)

    def _conclude(self, entry: _Entry, answer: Answer) -> None:
        lease, error = entry.lease, answer.error
        why = lost(answer)
        if entry.taken:
            self._forget(entry)
        elif error is None:
            self._keep(entry, answer)
        elif isinstance(error, CancelledError) and not entry.cancelled:
            self._return(entry, charge=False)  # by a stop, of the service or of the executor
        elif entry.cancelled:
            self._end(entry, end_badly(lease, CancelledError("cancelled"), answer.seconds))
        elif why is not None and self.stopping:
            self._return(entry, charge=False)  # whoever stopped us may have stopped the workers, too
        elif why is not None:
            self._try_again(entry, why, answer.seconds)
        else:
            self._end(entry, end_badly(lease, error, answer.seconds))

    def _keep(self, entry: _Entry, answer: Answer) -> None:
        lease = entry.lease
        device = answer.result["device"]
        if device is not None:
            self._metrics.device(*device)
        outcome: Outcome = answer.result["outcome"]
        try:
            ending = end_well(self._folders, lease, outcome, answer.seconds)
        except DiskFull:
            raise  # a little later there may be room
        except StoreError as error:
            self._try_again(entry, WorkerError(str(error)), answer.seconds)
            return
        rig = lease.job.rig
        if outcome.checked and rig is not None and rig not in self._right:
            self._store.mark_checked(rig)
            self._right.add(rig)
        self._end(entry, ending)

    def _try_again(self, entry: _Entry, why: WorkerError, seconds: float) -> None:
        lease = entry.lease
        self._metrics.lost("died")
        tries = lease.job.tries
        log.warning("try %d lost: %s", tries, why, extra={"job": lease.job.id})
        if tries < self._settings.tries:
            self._return(entry, charge=True)
        else:
            self._end(entry, end_badly(lease, WorkerError(f"{why} (tried {tries} times)"), seconds))

    def _end(self, entry: _Entry, ending: Ending) -> None:
        if ending.state is not State.DONE:
            self._folders.clear(entry.lease.job.id)
        self._endings.append((entry, ending))

    def _return(self, entry: _Entry, *, charge: bool) -> None:
        self._folders.clear(entry.lease.job.id)
        self._returns[charge].append(entry)

    def _finish(self) -> None:
        """Write all endings in one transaction, then what is given back; what fails stays to be written."""
        if self._endings:
            applied = set(self._store.finish([ending for _, ending in self._endings]))
            done, self._endings = self._endings, []
            for entry, ending in done:
                job = entry.lease.job
                self._forget(entry)
                if job.id in applied:
                    self._metrics.ended(job.kind, ending.state, ending.seconds)
                    log.info("%s%s", ending.state, f": {ending.error}" if ending.error else "", extra={"job": job.id})
                else:
                    log.warning("ended otherwise meanwhile", extra={"job": job.id})
        for charge, entries in self._returns.items():
            if entries:
                self._store.give_back(self.owner, [entry.lease.job.id for entry in entries], charge=charge)
                self._returns[charge] = []
                for entry in entries:
                    self._forget(entry)

    def _forget(self, entry: _Entry) -> None:
        with self._lock:
            self._entries.pop(entry.lease.job.id, None)
        self._live.end(entry.lease.job.id)

    # -- leases

    def _beat(self) -> None:
        self._beat_at = time.monotonic() + self._settings.lease_seconds / 3
        unwanted = (
            self._store.beat(self.owner, self._live.stages(), self._settings.lease_seconds) if self._entries else ()
        )
        for job in unwanted:
            with self._lock:
                entry = self._entries.get(job)
            if entry is None:
                continue
            now: Job | None = self._store.any_job(job)
            if now is not None and now.state is State.RUNNING and now.cancel_asked:
                entry.cancelled = True
            else:
                entry.taken = True
            self._stop_entry(entry)
        self._reclaim(lambda owner: owner == self.owner)

    def _reclaim(self, alive: Callable[[str], bool]) -> None:
        for job in self._store.reclaim(alive, self._settings.tries):
            self._metrics.lost("stopped")
            log.warning("its lease ran out, it is %s", job.state, extra={"job": job.id})
            if job.state.ended:
                self._metrics.ended(job.kind, job.state, {})
            self._live.changed(job.id)

    # -- the end

    def _give_back(self) -> None:
        assert self._stop_by is not None
        late = time.monotonic() >= self._stop_by
        with self._lock:
            entries = list(self._entries.values())
        for entry in entries:
            if (late or not entry.began) and not entry.returned:
                entry.returned = True
                self._stop_entry(entry)

    def _stop_entry(self, entry: _Entry) -> None:
        if entry.running is not None:
            entry.running.cancel()

    def _is_over(self) -> bool:
        """Whether a stop is complete, or has waited long enough: what is open then is reclaimed at the next start."""
        assert self._stop_by is not None
        return not self._entries or time.monotonic() > self._stop_by + LATE_S


def _failed(error: StereoError) -> Answer:
    return Answer(result=None, error=error, seconds=0.0)
