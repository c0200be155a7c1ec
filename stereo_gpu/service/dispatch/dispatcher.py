"""Moves jobs from the table to the workers and back: leases, heartbeats, endings; one thread."""

from __future__ import annotations

import logging
import queue
import secrets
import shutil
import threading
import time
from collections.abc import Callable

from stereo_gpu.engines.executor import Answer, Executor, Limits
from stereo_gpu.errors import InputError, WorkerError
from stereo_gpu.service.data.folders import Folders
from stereo_gpu.service.dispatch.endings import end_badly, end_well, find_outcome
from stereo_gpu.service.dispatch.settling import Settling
from stereo_gpu.service.dispatch.under_way import Entry, UnderWay
from stereo_gpu.service.jobs.order import order_of
from stereo_gpu.service.live import Live
from stereo_gpu.service.metrics import Metrics
from stereo_gpu.service.records import State
from stereo_gpu.service.settings import MEGABYTE, Settings
from stereo_gpu.service.store import Store

LEASED_EACH = 2  # jobs under way a worker: one that is done while the next one's order is there already
LOOK_S = 2.0  # for new jobs, even if nobody rang
MOVED_S = 1.0  # between two times that those who wait are told
AGAIN_S = 1.0  # after the table or the disk failed
LATE_S = 5.0  # after its grace, when a stop waits no longer for answers

log = logging.getLogger("stereo_gpu.service")


class Dispatcher:
    """Leases jobs, has them done, and ends each exactly once.

    An error of the table or of the disk is logged and what failed is tried again: nothing ends the thread but `stop`.

    Args:
        store, folders: what is to be done, and where it lies.
        live: told how far each job is.
        executor: does them; its task takes a `WorkOrder`, and answers as `work.do_job` does.
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
        self._under_way = UnderWay()
        self._settling = Settling(self.owner, store, folders, live, metrics, self._under_way, settings.tries)
        self._answers: queue.SimpleQueue[tuple[Entry, Answer]] = queue.SimpleQueue()
        self._bell = threading.Event()
        self._stop_by: float | None = None
        self._beat_at = self._lease_at = 0.0
        self._moved_at = 0.0
        self._reclaimed = self._short = self._moved = False
        self._steps = (
            self._reclaim_all,
            self._settle,
            self._note_begun,  # before the endings of those whose answers are there
            self._write,
            self._give_back,
            self._beat,
            self._lease,
            self._tell_queue,
        )
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
        entry = self._under_way.get(job)
        if entry is None:  # it may be on its way from the table: the heartbeat tells of those
            self._beat_at = 0.0
            self.wake()
        else:
            entry.cancelled = True
            entry.stop()

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
            failed = False
            for step in self._steps:
                try:
                    step()
                except Exception:  # nothing may end this thread; what was not done is still to be done
                    log.exception("the dispatcher failed, and goes on")
                    failed = True
            if failed:
                time.sleep(AGAIN_S)
                self.wake()
        self._leave()

    def _idle_s(self) -> float:
        now = time.monotonic()
        waits = [LOOK_S, self._beat_at - now]
        if self._lease_at > now:
            waits.append(self._lease_at - now)
        if self._stop_by is not None:
            waits.append(self._stop_by - now if now < self._stop_by else 0.1)
        return max(0.01, min(waits))

    def _is_over(self) -> bool:
        """Whether a stop is complete, or has waited long enough: what is open then is reclaimed at the next start."""
        assert self._stop_by is not None
        return not self._under_way or time.monotonic() > self._stop_by + LATE_S

    def _leave(self) -> None:
        """Give back without charge what no worker let go of in time; where that fails, the next start reclaims it."""
        try:
            self._store.give_back(self.owner, [entry.id for entry in self._under_way.all()], charge=False)
        except Exception:
            log.exception("jobs under way cannot be given back: the next start takes them")

    def _reclaim_all(self) -> None:
        """Once, at the start: one service has the folder, so that what others leased, they left."""
        if not self._reclaimed:
            self._reclaim(lambda owner: owner == self.owner)
            self._reclaimed = True

    def _settle(self) -> None:
        for _ in range(self._answers.qsize()):
            entry, answer = self._answers.get_nowait()
            if answer.worker is None and isinstance(answer.error, WorkerError):
                self._lease_at = time.monotonic() + AGAIN_S  # no worker can be had: it would come back at once
            try:
                self._settling.take(entry, answer, stopping=self.stopping)
            except Exception:
                self._answers.put((entry, answer))
                raise

    def _note_begun(self) -> None:
        """Tell the table which jobs workers have: these run, and lose a try should the service die."""
        begun = [entry for entry in self._under_way.all() if entry.began and not entry.noted]
        if not begun:
            return
        self._store.begin([entry.lease for entry in begun])
        for entry in begun:
            entry.noted = self._moved = True
            self._live.changed(entry.id)

    def _write(self) -> None:
        self._settling.write()

    def _give_back(self) -> None:
        """In a stop, end what has not begun, and after the grace the rest."""
        if self._stop_by is None:
            return
        late = time.monotonic() >= self._stop_by
        for entry in self._under_way.all():
            if (late or not entry.began) and not entry.returned:
                entry.returned = True
                entry.stop()

    def _beat(self) -> None:
        """Keep our leases, and hear which jobs are wanted no more."""
        if time.monotonic() < self._beat_at:
            return
        lease_s = self._settings.lease_seconds
        if self._under_way:
            for job in self._store.beat(self.owner, self._live.stages(), lease_s):
                self._stop_unwanted(job)
        self._reclaim(lambda owner: owner == self.owner)
        self._beat_at = time.monotonic() + lease_s / 3

    def _stop_unwanted(self, job: str) -> None:
        entry, now = self._under_way.get(job), self._store.any_job(job)
        if entry is None:
            return
        if now is not None and now.state is State.RUNNING and now.cancel_asked:
            entry.cancelled = True
        else:
            entry.taken = True
        entry.stop()

    def _reclaim(self, alive: Callable[[str], bool]) -> None:
        for job in self._store.reclaim(alive, self._settings.tries):
            self._metrics.lost("stopped")
            log.warning("its lease ran out, it is %s", job.state, extra={"job": job.id})
            if job.state.ended:
                self._metrics.ended(job.kind, job.state, {})
            self._live.changed(job.id)

    def _lease(self) -> None:
        """Take as many jobs as the workers have room for, in one transaction, and submit them."""
        free = LEASED_EACH * self._executor.slots - len(self._under_way)
        if self.stopping or free <= 0 or time.monotonic() < self._lease_at or self._is_disk_short():
            return
        for lease in self._store.lease(self.owner, free, self._settings.lease_seconds):
            entry = Entry(lease)
            older = self._under_way.add(entry)
            if older is not None:  # its lease ran out, where the table could not be reached for long
                older.taken = True
                older.stop()
            self._live.begin(entry.id, lease.job.kind)
            try:
                self._begin(entry)
            except Exception:  # the table or the disk: the job must not stay between the two
                log.exception("a job cannot begin", extra={"job": entry.id})
                self._settling.not_begun(entry)
                self._lease_at = time.monotonic() + AGAIN_S

    def _tell_queue(self) -> None:
        """Say that places in the queue have changed; each who waits then asks the table, so not too often."""
        now = time.monotonic()
        if self._moved and now - self._moved_at >= MOVED_S:
            self._moved, self._moved_at = False, now
            self._live.queue_moved()

    def _begin(self, entry: Entry) -> None:
        job = entry.lease.job
        outcome = find_outcome(self._folders, job)
        if outcome is not None:  # its result took its place just before a service died
            seconds = sum(outcome.seconds.values())
            self._settling.end(entry, end_well(self._folders, entry.lease, outcome, seconds))
            self.wake()
            return
        order = order_of(entry.lease, self._store)
        if order is None:
            gone = InputError(f"its rig {job.rig} is there no more: send the job again with another")
            self._settling.end(entry, end_badly(entry.lease, gone, 0.0))
            self.wake()
            return

        def began(worker: int) -> None:
            entry.began = True
            if job.tries == 0:
                self._metrics.waited(self._clock() - job.created)
            self._live.took(job.id, worker)
            self.wake()
            if self._executor.name == "inline":
                self._note_begun()  # at once: a pair that crashes its worker crashes this process

        entry.running = self._executor.submit(
            (order,), limits=self._limits, began=began, tell=lambda word: self._live.tell(job.id, word)
        )
        if entry.cancelled:
            entry.stop()
        entry.running.answer.add_done_callback(lambda answer: self._answered(entry, answer.result()))

    def _answered(self, entry: Entry, answer: Answer) -> None:
        self._answers.put((entry, answer))
        self.wake()

    def _is_disk_short(self) -> bool:
        """Whether there is too little room to begin: half of what is spared, when uploads have long been refused."""
        short = shutil.disk_usage(self._settings.data).free < self._settings.spare_gb / 2 * 1024 * MEGABYTE
        if short != self._short:
            log.log(logging.ERROR if short else logging.INFO, "the disk is %s", "full" if short else "no longer full")
        self._short = short
        return short
