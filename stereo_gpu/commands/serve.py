"""Serve pairs in, models out, over HTTP, with a page.

The extra `service` is needed: pip install "stereo-gpu[service]".
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stereo_gpu.service.service import Service
    from stereo_gpu.service.settings import Settings

MISSING = 'a package of the service is missing ({}): pip install "stereo-gpu[service]"'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes; what is left out is as `service/settings.py` has it."""
    parser.add_argument("--data", type=Path, required=True, metavar="DIR", help="folder of all that it keeps")
    given = parser.add_argument_group("where it listens")
    given.add_argument("--host", help="address; only this machine reaches the usual one (127.0.0.1)")
    given.add_argument("--port", type=int, help="0 for any that is free (8000)")
    given.add_argument("--link", metavar="URL", help="what people open, where a proxy stands before it")
    given = parser.add_argument_group("workers")
    given.add_argument("--engine", choices=("local", "inline", "ray"), help="where jobs are done (local)")
    given.add_argument("--address", help="of the Ray cluster; by default one is started here")
    given.add_argument("--workers", type=int, metavar="N", help="jobs at once; by default what suits the device")
    given.add_argument("--backend", help="where to compute, as `devices` names it; by default every GPU, else the CPU")
    given = parser.add_argument_group("limits of a job")
    given.add_argument("--job-seconds", type=_or_none(float), metavar="S", help="time, or none (600)")
    given.add_argument("--job-memory", type=_or_none(int), metavar="MB", help="memory of its process, or none (none)")
    given.add_argument("--tries", type=int, metavar="N", help="lost workers after which a job has failed (3)")
    given.add_argument("--grace", type=float, metavar="S", help="what jobs under way get at a stop (30)")
    given = parser.add_argument_group("limits of the queue and of uploads")
    given.add_argument("--queue-limit", type=int, metavar="JOBS", help="that may wait, of all clients (10000)")
    given.add_argument("--client-limit", type=int, metavar="JOBS", help="that may wait, of one client (5000)")
    given.add_argument("--file-mb", type=int, metavar="MB", help="largest picture, as a file (64)")
    given.add_argument("--request-mb", type=int, metavar="MB", help="largest request (512)")
    given.add_argument("--megapixels", type=float, metavar="MP", help="largest picture, by its header (50)")
    given = parser.add_argument_group("what is kept")
    given.add_argument("--keep-days", type=float, metavar="DAYS", help="of jobs that have ended (30)")
    given.add_argument("--keep-gb", type=float, metavar="GB", help="room for them, the oldest go first (50)")
    given.add_argument("--spare-gb", type=float, metavar="GB", help="with less left on the disk nothing is taken (1)")
    given = parser.add_argument_group("clients")
    given.add_argument(
        "--new-token",
        metavar="NAME",
        help="print a token for a client of this name, and end; a running service knows it",
    )
    given.add_argument("--remove-token", metavar="NAME", help="make the tokens of this client worthless, and end")
    given = parser.add_argument_group("what it says")
    choice = given.add_mutually_exclusive_group()
    choice.add_argument(
        "--json-logs",
        action="store_true",
        default=None,
        help="one JSON object a line on stderr, as by default where that is no terminal",
    )
    choice.add_argument("--plain-logs", dest="json_logs", action="store_false", help="plain lines, as on a terminal")


def run(options: argparse.Namespace) -> None:
    """Serve until a signal, or make or remove a token."""
    from stereo_gpu.errors import InputError

    try:
        settings = read_settings(options)
        if options.new_token is not None or options.remove_token is not None:
            _change_clients(settings, options.new_token, options.remove_token)
        else:
            _serve(settings, options)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("stereo_gpu"):
            raise
        raise InputError(MISSING.format(error.name)) from None


def read_settings(options: argparse.Namespace) -> Settings:
    """The settings that the options name.

    Raises:
        InputError: one is out of range.
    """
    from stereo_gpu.service.settings import Settings

    named = {
        "job_memory_mb": options.job_memory,
        "grace_seconds": options.grace,
        "job_seconds": options.job_seconds,
        **{
            name: getattr(options, name)
            for name in (
                *("data", "host", "port", "link", "engine", "address", "workers", "backend", "tries"),
                *("queue_limit", "client_limit", "file_mb", "request_mb", "megapixels"),
                *("keep_days", "keep_gb", "spare_gb"),
            )
        },
    }
    given = {name: value for name, value in named.items() if value is not None}
    # "none" is read as infinity, since None means that nothing was said.
    for name in ("job_seconds", "job_memory_mb"):
        if given.get(name) == float("inf"):
            given[name] = None
    settings = Settings(**given)
    _check(settings)
    return settings


def _check(settings: Settings) -> None:
    from stereo_gpu.errors import InputError

    for name, least in (
        ("tries", 1),
        ("queue_limit", 1),
        ("client_limit", 1),
        ("file_mb", 1),
        ("request_mb", 1),
        ("keep_days", 0),
        ("keep_gb", 0),
        ("spare_gb", 0),
        ("grace_seconds", 0),
    ):
        value = getattr(settings, name)
        if not least <= value < float("inf"):  # false for NaN, too
            raise InputError(f"--{_option(name)} {value:g}: give a number of {least} or more")
    for name in ("job_seconds", "job_memory_mb", "megapixels"):
        value = getattr(settings, name)
        if value is not None and not 0 < value < float("inf"):
            raise InputError(f"--{_option(name)} {value:g}: give a number above 0")


def _option(name: str) -> str:
    return {"grace_seconds": "grace", "job_memory_mb": "job-memory"}.get(name, name.replace("_", "-"))


def _serve(settings: Settings, options: argparse.Namespace) -> None:
    import stereo_gpu.service.server as server
    from stereo_gpu.service.logs import show_logs
    from stereo_gpu.service.service import Service

    as_json = options.json_logs if options.json_logs is not None else not sys.stderr.isatty()
    with show_logs(as_json=as_json, debug=options.debug):
        listener = server.listen(settings)
        try:
            service = Service.open(settings)
        except BaseException:
            listener.close()
            raise
        server.serve(service, settings, listener, lambda address: _tell(service, settings, address))
    if settings.engine == "inline":
        # Its thread may be inside a compiler or a kernel still, and Python's own end would tear it apart: SIGABRT.
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        os._exit(0)


def _tell(service: Service, settings: Settings, address: str) -> None:
    """Say where the page is; the token stands behind a #, which browsers never send.

    It is told on a terminal alone: what a unit or a container prints is kept in a log, which others may read.
    """
    link = (settings.link or address).rstrip("/")
    if service.new_token is not None and sys.stdout.isatty():
        print(f"open  {link}/#token={service.new_token}")
        print(f"      this token is kept in {service.folders.token_file}; --new-token NAME makes one for somebody else")
    else:
        print(f"open  {link}/#token=...  with the token in {service.folders.token_file}, or your own")
    print("end it with Ctrl-C", flush=True)


def _change_clients(settings: Settings, new: str | None, gone: str | None) -> None:
    from stereo_gpu.errors import InputError
    from stereo_gpu.service.data.folders import Folders
    from stereo_gpu.service.store import Store

    folders = Folders(settings.data)
    if not folders.database.is_file():
        raise InputError(f"{settings.data} is no folder of a service yet: start it there once without this option")
    store = Store(folders.database, create=False)
    try:
        if gone is not None:
            if gone not in store.clients():
                known = ", ".join(store.clients())
                raise InputError(f"there is no client {gone!r:.60}: give one of {known:.200}")
            store.remove_client(gone)
            print(
                f"the tokens of {gone} are worth nothing from now on; its jobs stay until they are old", file=sys.stderr
            )
        if new is not None:
            print(store.add_client(new))
    finally:
        store.close()


def _or_none(kind: Callable[[str], float]) -> Callable[[str], float]:
    """A reader of a number, or of `none`, which is told as infinity."""

    def parse(text: str) -> float:
        return float("inf") if text == "none" else kind(text)

    parse.__name__ = "number"
    return parse
