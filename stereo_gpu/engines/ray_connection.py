"""The Ray cluster that this process works with: one that is there, or one started here, closed to strangers.

Ray lets whoever reaches its ports run any code, and its ports are open to the network even on a laptop. A cluster
that is started here therefore has a token that nobody else knows, no dashboard, and ends with its last user.
"""

from __future__ import annotations

import atexit
import importlib.util
import ipaddress
import logging
import os
import secrets
import shutil
import signal
import socket
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from stereo_gpu.errors import InputError

PROBE_S = 5.0  # for a cluster to take a connection; Ray itself goes on trying for minutes
CONNECT_S = 60.0
END_S = 20.0
STORE_BYTES = 128 << 20  # of Ray's object store, besides what each worker adds; jobs go by paths, answers are small
STORE_BYTES_EACH = 64 << 20
FOLDER = "stereo-gpu-ray-"

_changing = threading.Lock()
_users = 0
_address: str | None = None
_end: Callable[[], None] | None = None


def connect(address: str | None, cpus: int) -> None:
    """Use a cluster until `release`; users of one process share it, the last one to leave ends the connection.

    Args:
        address: HOST:PORT of its head node, of which this machine must be a node; "auto" for the one that runs here,
            or that RAY_ADDRESS names; None starts one on this machine alone.
        cpus: that a cluster started here offers.

    Raises:
        InputError: Ray is not installed, there is no cluster, it cannot be joined or shows an open dashboard, or this
            process works with another one already.
    """
    global _users, _address, _end
    _require_ray()
    with _changing:
        if _users and address != _address:
            raise InputError(
                f"this process works with the Ray cluster {_address or 'it started'} already: close that first, or"
                f" give its address in place of {address or 'none'}"
            )
        if not _users:
            _end = _join(address) if address is not None else _start(cpus)
            _address = address
            _take_back_sigterm()
        _users += 1


def release() -> None:
    """Leave the cluster; one that was started here ends with its last user."""
    global _users, _end
    with _changing:
        _users -= 1
        if not _users and _end is not None:
            _end()
            _end = None


def _require_ray() -> None:
    if importlib.util.find_spec("ray") is None:
        raise InputError('engine ray needs Ray, which is not installed: pip install "stereo-gpu[ray]"')


def _join(address: str) -> Callable[[], None] | None:
    """Connect to a cluster that runs; None where the program that called us did so before."""
    if address.startswith("ray://"):
        raise InputError(
            f"address {address!r:.60}: run this on a node of the cluster and give its head as HOST:PORT, or auto"
        )
    if address != "auto":
        _probe(address)
    ray = _import_ray()
    if ray.is_initialized():
        return None
    held = _Held({"address": address}, None)
    try:
        _refuse_open_dashboard(held.dashboard)
    except InputError:
        held.end()
        raise
    return held.end


def _start(cpus: int) -> Callable[[], None] | None:
    # Read by Ray when it is loaded; the processes that it starts inherit both. What the user has set stays.
    if os.environ.setdefault("RAY_AUTH_MODE", "token") == "token" and "RAY_AUTH_TOKEN_PATH" not in os.environ:
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_urlsafe(32))
    ray = _import_ray()
    if ray.is_initialized():
        return None
    ray._raylet.Config.initialize("")  # it may have been loaded before; Ray does this where it sets the mode itself
    folder = None if "RAY_TMPDIR" in os.environ else _make_folder()
    options = {
        "address": "local",
        "num_cpus": cpus,
        "include_dashboard": False,
        "object_store_memory": STORE_BYTES + cpus * STORE_BYTES_EACH,
        "_temp_dir": folder,
    }
    return _Held(options, folder).end


def _make_folder() -> str:
    """A folder for what Ray keeps, and away with those of processes that were killed."""
    # The names of its sockets are long, and a system takes 107 characters; the usual temporary folder may be deep.
    above = Path("/tmp") if Path("/tmp").is_dir() else Path(tempfile.gettempdir())
    for old in above.glob(f"{FOLDER}*"):
        owner = old.name.removeprefix(FOLDER).partition("-")[0]
        if owner.isdigit() and Path("/proc/self").exists() and not Path("/proc", owner).exists():
            shutil.rmtree(old, ignore_errors=True)
    return tempfile.mkdtemp(prefix=f"{FOLDER}{os.getpid()}-", dir=above)


class _Held:
    """A connection, made and kept by a thread of its own.

    Ray's processes end with the thread that started them, and its handlers of signals stay out of a thread that is not
    the main one.
    """

    def __init__(self, options: dict[str, Any], folder: str | None) -> None:
        self._options, self._folder = options, folder
        self._over, self._ready = threading.Event(), Future[str]()
        self._thread = threading.Thread(target=self._hold, name="stereo-gpu ray", daemon=True)
        self._thread.start()
        atexit.register(self.end)
        try:
            self.dashboard = self._ready.result(CONNECT_S)
        except TimeoutError:
            self.end()
            raise InputError(
                f"no Ray cluster answers at {options['address']}: see that its head is meant, and `ray status` there"
            ) from None
        except Exception as error:
            self.end()
            raise InputError(
                f"Ray cluster {options['address']} cannot be used ({_first_line(error)}): see `ray status`, and that"
                " RAY_AUTH_MODE and RAY_AUTH_TOKEN are the cluster's"
            ) from error

    def _hold(self) -> None:
        import ray

        try:
            context = ray.init(log_to_driver=False, logging_level=logging.ERROR, **self._options)
            # It prints what becomes of its workers, whatever it was told; we say that ourselves, by a job's answer.
            vars(ray._private.worker).update(_worker_logs_enabled=False)
            self._ready.set_result(context.dashboard_url or "")
        except BaseException as error:
            self._ready.set_exception(error if isinstance(error, Exception) else RuntimeError(error))
            return
        self._over.wait()
        with suppress(Exception):  # a cluster that is gone already
            ray.shutdown()

    def end(self) -> None:
        atexit.unregister(self.end)
        self._over.set()
        self._thread.join(END_S if self._ready.done() else 0.0)
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)


def _take_back_sigterm() -> None:
    """Have SIGTERM as it was: Ray puts a handler before Python's that prints a stack first."""
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) is not None:
        signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGTERM))


def _import_ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
    os.environ.setdefault("RAY_ENABLE_AUTO_CONNECT", "0")  # no late call starts a cluster that nobody ends
    import ray

    return ray


def _probe(address: str) -> None:
    """Find out in seconds whether somebody is there."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise InputError(f"address {address!r:.60}: give a Ray cluster's head as HOST:PORT, or auto")
    try:
        socket.create_connection((host.strip("[]"), int(port)), PROBE_S).close()
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"no Ray cluster answers at {address} ({reason}): see that `ray start --head` ran") from error


def _refuse_open_dashboard(url: str) -> None:
    """Refuse a cluster whose dashboard lets whoever reaches it run any code."""
    host = urlsplit(f"//{url}").hostname
    if host is None or host == "localhost":
        return
    with suppress(ValueError):
        if ipaddress.ip_address(host).is_loopback:
            return
    if not _asks_for_token(url):
        raise InputError(
            f"the cluster's dashboard is open to the network without a token, at {url}: start it with"
            " RAY_AUTH_MODE=token, or with --include-dashboard=false"
        )


def _asks_for_token(url: str) -> bool:
    """Whether a dashboard turns a stranger away; that our own environment names a token tells nothing of it."""
    dashboard = HTTPConnection(url, timeout=PROBE_S)
    try:
        dashboard.request("GET", "/api/version")
        return dashboard.getresponse().status in (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)
    except (OSError, HTTPException):
        return False
    finally:
        dashboard.close()


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return f"{lines[0]:.200}" if lines else type(error).__name__
