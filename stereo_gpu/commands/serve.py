"""Serve pairs in, models out, over HTTP, with a page.

The extra `service` is needed: pip install "stereo-gpu[service]".
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stereo_gpu.service.service import Service
    from stereo_gpu.service.settings import Settings

MISSING = 'a package of the service is missing ({}): pip install "stereo-gpu[service]"'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what the command takes: fields of `Settings`, which are left out where nothing is said, and the rest."""
    from stereo_gpu.service.settings import Settings

    def add(group: Any, option: str, text: str, usual: str | None = None, **more: Any) -> None:
        name = more.pop("dest", option.removeprefix("--").replace("-", "_"))
        value = getattr(Settings, name)
        told = usual or (f"{value:g}" if isinstance(value, float) else value)
        group.add_argument(option, dest=name, default=argparse.SUPPRESS, help=f"{text} ({told})", **more)

    parser.add_argument("--data", type=Path, required=True, metavar="DIR", help="folder of all that it keeps")
    given = parser.add_argument_group("where it listens")
    add(given, "--host", "address; only this machine reaches the usual one")
    add(given, "--port", "0 for any that is free", type=int)
    add(given, "--link", "what people open, where a proxy stands before it", "that address", metavar="URL")
    given = parser.add_argument_group("workers")
    add(given, "--engine", "where jobs are done", choices=("local", "inline", "ray"))
    add(given, "--address", "of the Ray cluster", "one is started here")
    add(given, "--workers", "jobs at once", "what suits the device", type=int, metavar="N")
    add(given, "--backend", "where to compute, as `devices` names it", "every GPU, else the CPU")
    given = parser.add_argument_group("limits of a job")
    add(given, "--job-seconds", "time, or none", type=_or_none(float), metavar="S")
    add(
        given,
        "--job-memory",
        "memory of its process, or none",
        "none",
        dest="job_memory_mb",
        type=_or_none(int),
        metavar="MB",
    )
    add(given, "--tries", "lost workers after which a job has failed", type=int, metavar="N")
    add(given, "--grace", "what jobs under way get at a stop", dest="grace_seconds", type=float, metavar="S")
    given = parser.add_argument_group("limits of the queue and of uploads")
    add(given, "--queue-limit", "that may wait, of all clients", type=int, metavar="JOBS")
    add(given, "--client-limit", "that may wait, of one client", type=int, metavar="JOBS")
    add(given, "--file-mb", "largest picture, as a file", type=int, metavar="MB")
    add(given, "--request-mb", "largest request", type=int, metavar="MB")
    add(given, "--megapixels", "largest picture, by its header", type=float, metavar="MP")
    given = parser.add_argument_group("what is kept")
    add(given, "--keep-days", "of jobs that have ended", type=float, metavar="DAYS")
    add(given, "--keep-gb", "room for them, the oldest go first", type=float, metavar="GB")
    add(given, "--spare-gb", "with less left on the disk nothing is taken", type=float, metavar="GB")
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

    given = {field.name: getattr(options, field.name) for field in fields(Settings) if hasattr(options, field.name)}
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


def _or_none(kind: Callable[[str], float]) -> Callable[[str], float | None]:
    """A reader of a number, or of `none`."""

    def parse(text: str) -> float | None:
        return None if text == "none" else kind(text)

    parse.__name__ = "number"
    return parse
