"""Look over the folder of a service, and what it needs, whether it runs or not; nothing is changed."""

from __future__ import annotations

import importlib.metadata
import os
import re
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path

from stereo_gpu.doctor import Finding
from stereo_gpu.errors import StereoError
from stereo_gpu.service.settings import MEGABYTE, Settings

EXTRA = "service"
MOST_FAULTS = 5  # of the table that are told; the others are counted


def examine_service(settings: Settings) -> Iterator[Finding]:
    """Examine the packages of the extra, the folder, its lock, token and table, the disk and the port."""
    missing = False
    for package in _packages():
        try:
            yield Finding(package, True, True, importlib.metadata.version(package))
        except importlib.metadata.PackageNotFoundError:
            missing = True
            yield Finding(package, False, True, "not installed", f'pip install "stereo-gpu[{EXTRA}]"')
    if missing:
        return
    there = settings.data.is_dir()
    yield _folder(settings.data)
    yield _disk(settings)
    holder = _holder(settings.data / "lock") if there else None
    if there:
        yield Finding("lock", True, False, f"process {holder} serves it" if holder else "free: no service has it")
        yield _token(settings.data / "token")
        yield _table(settings.data)
    if holder is None:
        yield _port(settings)


def _packages() -> list[str]:
    """The packages that the extra names, by this package's own list."""
    wanted = importlib.metadata.requires("stereo-gpu") or []
    found = [re.split(r"[^\w.-]", line)[0] for line in wanted if re.search(rf"extra == ['\"]{EXTRA}['\"]", line)]
    return sorted(set(found))


def _folder(data: Path) -> Finding:
    if not data.exists():
        return Finding("folder", True, False, f"{data} is not there yet: the first start makes it")
    if not data.is_dir():
        return Finding("folder", False, True, f"{data} is a file", "name a folder")
    mode = stat.S_IMODE(data.stat().st_mode)
    if not os.access(data, os.R_OK | os.W_OK | os.X_OK):
        return Finding("folder", False, True, f"{data} cannot be written by this user", f"chown -R USER {data}")
    if mode & 0o077:
        return Finding("folder", False, False, f"{data} can be read by others ({mode:o})", f"chmod 700 {data}")
    return Finding("folder", True, True, f"{data}, for its owner alone")


def _disk(settings: Settings) -> Finding:
    nearest = settings.data.absolute()
    while not nearest.exists():
        nearest = nearest.parent
    free = shutil.disk_usage(nearest).free / (1024 * MEGABYTE)
    said = f"{free:.1f} GB free; with less than {settings.spare_gb:g} nothing is taken, and up to {settings.keep_gb:g}"
    enough = free > settings.spare_gb
    remedy = "" if enough else "make room, or start with a smaller --keep-gb"
    return Finding("disk", enough, True, f"{said} are for results", remedy)


def _holder(lock: Path) -> str | None:
    """The process that serves the folder; None where none does."""
    if os.name != "posix" or not lock.is_file():
        return None
    import fcntl

    with lock.open("rb") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return held.read(20).decode(errors="replace").strip() or "unknown"
    return None


def _token(path: Path) -> Finding:
    if not path.is_file():
        return Finding("token", False, False, f"{path} is not there", "`serve --new-token NAME` makes another one")
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        return Finding("token", False, False, f"{path} can be read by others ({mode:o})", f"chmod 600 {path}")
    return Finding("token", True, False, f"{path}, for its owner alone")


def _table(data: Path) -> Finding:
    from stereo_gpu.service.data.audit import audit
    from stereo_gpu.service.data.folders import Folders
    from stereo_gpu.service.store import Store

    folders = Folders(data)
    if not folders.database.exists():
        return Finding("table", True, False, "not there yet")
    remedy = "restore the folder from its backup (docs/operations.md)"
    try:
        store = Store(folders.database, create=False)
        try:
            faults = audit(store, folders)
            counts = ", ".join(f"{count} {state}" for state, count in store.counts().items() if count)
        finally:
            store.close()
    except StereoError as error:
        return Finding("table", False, True, str(error), remedy)
    if faults:
        more = f"; and {len(faults) - MOST_FAULTS} more" if len(faults) > MOST_FAULTS else ""
        return Finding("table", False, True, "; ".join(faults[:MOST_FAULTS]) + more, remedy)
    return Finding("table", True, True, f"sound; jobs: {counts or 'none'}")


def _port(settings: Settings) -> Finding:
    from stereo_gpu.service.server import listen

    try:
        listen(settings).close()
    except StereoError as error:
        return Finding("port", False, False, str(error), "give `serve` another --port")
    return Finding("port", True, False, f"{settings.host} port {settings.port} is free")
