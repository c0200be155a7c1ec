"""The files of the service: taken, published, removed and swept; `paths.py` says where each one lies.

Folders move in one step, and what they hold reaches the disk before: nobody sees half of anything.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.service.data.manifest import Manifest, flush_file, flush_folder, read_manifest, seal
from stereo_gpu.service.data.owning import own
from stereo_gpu.service.data.paths import ID, TRY, UPLOAD, Paths
from stereo_gpu.service.refusals import DiskFull, StoreError


class Folders(Paths):
    """The data folder of a service; makes paths, and moves what belongs together in one step."""

    seal = staticmethod(seal)  # what a worker does last: see there

    def new_upload(self) -> Path:
        """A new folder, for what is being sent.

        Raises:
            DiskFull, StoreError: it cannot be made.
        """
        path = self.uploads / f"{secrets.token_hex(16)}.part"
        with written(path):
            path.mkdir(mode=0o700)
        return path

    def accept(self, upload: Path, id: str) -> None:
        """Make an upload the inputs of a new job; when this returns, they are on the disk.

        Raises:
            DiskFull, StoreError: they cannot be moved, or the job has inputs already.
        """
        job = self.job(id)
        with written(job):
            for file in upload.iterdir():
                flush_file(file)
            flush_folder(upload)
            job.mkdir(mode=0o700)
            try:
                upload.rename(job / "inputs")
            except OSError:
                job.rmdir()
                raise
            flush_folder(job)
            flush_folder(self.jobs)

    def keep_rig(self, id: str, write: Callable[[Path], object]) -> None:
        """Write a rig's file; when this returns, it is on the disk.

        Args:
            id: of the rig; a file that is there already is replaced.
            write: writes the path that it gets, whole or not at all.

        Raises:
            DiskFull, StoreError: it cannot be written.
        """
        path = self.rig(id)
        with written(path):
            path.parent.mkdir(mode=0o700, exist_ok=True)
            write(path)
            flush_folder(path.parent)
            flush_folder(self.rigs)

    def publish(self, id: str, number: int) -> Manifest:
        """Make what a sealed try has made the job's result, and remove what other tries have left.

        A whole result that is there already stays, so that this can be done again after a stop at any moment.

        Raises:
            StoreError: the try is not whole, or cannot be moved.
        """
        attempt, result = self.attempt(id, number), self.result(id)
        manifest = read_manifest(result)
        with written(result):
            if manifest is None:
                manifest = read_manifest(attempt)
                if manifest is None:
                    raise StoreError(f"{attempt} is not whole: restart the job")
                if result.exists():
                    self._vanish(result)
                attempt.rename(result)
                flush_folder(result.parent)
        self.clear(id)
        return manifest

    def manifest(self, id: str) -> Manifest | None:
        """What is in a job's result; None where there is none, or where it is not whole."""
        return read_manifest(self.result(id))

    def bytes(self, id: str) -> int:
        """What all files of a job take: inputs, result and steps."""
        total = 0
        for folder, _, names in os.walk(self.job(id)):
            for name in names:
                with suppress(FileNotFoundError):  # a try that nobody waits for may be going away
                    total += Path(folder, name).stat().st_size
        return total

    def clear(self, id: str) -> None:
        """Remove what tries of a job have left, when none is under way."""
        for name in _names(self.job(id)):
            if TRY.fullmatch(name):
                shutil.rmtree(self.job(id) / name, ignore_errors=True)

    def remove_job(self, id: str) -> None:
        """Remove a job's folder, if there is one; it is gone at once, or not at all.

        Raises:
            StoreError: it cannot be removed.
        """
        self._remove(self.job(id))

    def remove_rig(self, id: str) -> None:
        """Remove a rig's folder, if there is one; as `remove_job`."""
        self._remove(self.rig(id).parent)

    def remove_outline(self, id: str) -> None:
        """Remove a view to paint on, if there is one; as `remove_job`."""
        self._remove(self.outline(id))

    def sweep(self, known: Collection[str], older_than: float, *, busy: Collection[str] = ()) -> int:
        """Remove what nobody knows: uploads, views to paint on, folders of jobs and rigs, and what tries have left.

        Args:
            known: the ids of all jobs and rigs.
            older_than: seconds since 1970; what has changed since stays.
            busy: jobs that are under way, whose tries stay.

        Returns:
            How many folders went. What bears no name of ours is never touched.
        """
        known = set(known)
        unwanted = [self.uploads / name for name in _names(self.uploads) if UPLOAD.fullmatch(name)]
        unwanted += [self.outlines / name for name in _names(self.outlines) if ID.fullmatch(name)]
        for folder in (self.jobs, self.rigs):
            unwanted += [folder / name for name in _names(folder) if ID.fullmatch(name) and name not in known]
        # There may be a hundred thousand of them: no path is made where there is nothing to remove.
        jobs = str(self.jobs)
        for id in known.difference(busy):
            unwanted += [self.job(id) / name for name in _names(f"{jobs}/{id}") if TRY.fullmatch(name)]
        gone = 0
        for part in unwanted:
            with suppress(OSError, StoreError):  # it may have gone by itself; what stays is swept the next time
                if part.stat().st_mtime < older_than:
                    self._vanish(part)
                    gone += 1
        return gone

    def own(self) -> AbstractContextManager[None]:
        """Make the folder if it is missing, and keep every other service out of it; see `owning.own`."""
        return own(self)

    def keep_token(self, token: str) -> Path:
        """Write the token where only the owner of the folder can read it; returns the file.

        Raises:
            DiskFull, StoreError: it cannot be written.
        """
        part = self.uploads / f"{secrets.token_hex(16)}.part"
        with written(self.token_file):
            held = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            try:
                os.write(held, f"{token}\n".encode())
                os.fsync(held)
            finally:
                os.close(held)
            part.rename(self.token_file)
            flush_folder(self.root)
        return self.token_file

    def _remove(self, folder: Path) -> None:
        with written(folder):
            if folder.exists():
                self._vanish(folder)

    def _vanish(self, path: Path) -> None:
        """Remove what nobody needs any more: its name goes in one step, what is left of it is swept one day."""
        away = path if path.parent == self.uploads else self.uploads / f"{secrets.token_hex(16)}.part"
        if away != path:
            path.rename(away)
        if away.is_dir():
            shutil.rmtree(away, ignore_errors=True)
        else:
            away.unlink(missing_ok=True)


def _names(folder: str | os.PathLike[str]) -> list[str]:
    try:
        with os.scandir(folder) as parts:
            return [part.name for part in parts]
    except OSError:
        return []


@contextmanager
def written(path: Path) -> Iterator[None]:
    """Turn the system's errors into lines that name the path and the way out."""
    try:
        yield
    except (OSError, InputError) as error:
        # `write_whole` calls a full disk a wrong choice of the caller's, which it is not here.
        cause = error.__cause__ if isinstance(error, InputError) else error
        if not isinstance(cause, OSError):
            raise
        if cause.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull(f"cannot write {path}: the disk is full; make room") from error
        raise StoreError(
            f"cannot write {path}: {cause.strerror or cause}; see that the folder can be written"
        ) from error
