"""What a run of the benchmark found, and the JSON file that keeps it."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereo_gpu.bench.checks import (
    check_facts,
    check_machine,
    check_method,
    check_row,
    check_times,
    check_took,
    check_words,
)
from stereo_gpu.bench.machine import DeviceFacts
from stereo_gpu.bench.row import OPENCV, Row
from stereo_gpu.bench.timing import Times
from stereo_gpu.errors import InputError
from stereo_gpu.files import write_whole

FORMAT = "stereo-gpu bench"
VERSION = 1
LARGEST_FILE = 64 << 20  # bytes; a run on ten devices takes about 1 MB


@dataclass(frozen=True, kw_only=True)
class BenchRun:
    """One run.

    Args:
        started: when, ISO 8601 in UTC.
        took: seconds for all of it.
        method: how long each work was timed, and how.
        machine: processor, system, versions.
        peers: the settings of each OpenCV function.
        devices: what was found, with roofs.
        rows: what was timed.
    """

    started: str
    took: float
    method: dict[str, float]
    machine: dict[str, Any]
    peers: dict[str, str]
    devices: tuple[DeviceFacts, ...]
    rows: tuple[Row, ...]

    @property
    def sizes(self) -> list[tuple[int, int, int]]:
        """The sizes in the order of the run."""
        return list(dict.fromkeys(row.size for row in self.rows))

    @property
    def window(self) -> int:
        """Side of the window, px."""
        return self.rows[0].window

    def facts(self, device: str) -> DeviceFacts | None:
        """What is known of a device; None for OpenCV."""
        return next((facts for facts in self.devices if facts.name == device), None)

    def share_of_copy(self, row: Row) -> float | None:
        """Bytes a second over what a copy reaches on the same device."""
        facts = self.facts(row.device)
        return row.bytes_s / facts.copy_bytes_s if facts and row.bytes_s else None

    def save(self, path: Path) -> None:
        """Write it as JSON, whole or not at all; derived figures stand beside the times for other programs.

        Raises:
            InputError: the file cannot be written.
        """
        content = {"format": FORMAT, "version": VERSION, **dataclasses.asdict(self)}
        for row, held in zip(self.rows, content["rows"], strict=True):
            held["derived"] = {
                "disparity_evaluations_s": row.evaluations_s,
                "bytes_s": row.bytes_s,
                "share_of_copy": self.share_of_copy(row),
                "to_peer": row.to_peer,
                "to_stereobm": row.to_stereobm,
            }
        write_whole(path, json.dumps(content, indent=1) + "\n")

    @classmethod
    def load(cls, path: Path) -> BenchRun:
        """Read what `save` wrote.

        Raises:
            InputError: there is no such file, or it is something else.
        """
        mend = "give a file that `stereo-gpu bench --json FILE` wrote"
        try:
            if path.stat().st_size > LARGEST_FILE:
                raise InputError(f"{path} has {path.stat().st_size:,} bytes: {mend}")
            content = json.loads(path.read_text("utf-8"))
        except OSError as error:
            raise InputError(f"cannot read {path} ({error.strerror or error}): {mend}") from error
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path} is not JSON ({error}): {mend}") from error
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise InputError(f"{path} is JSON, but no run of the benchmark: {mend}")
        if content.get("version") != VERSION:
            raise InputError(f"{path} has version {content.get('version')!r}, this program reads {VERSION}: run again")
        try:
            return _parse(content)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{path} is damaged ({type(error).__name__}: {error}): {mend}") from error


def _parse(content: dict[str, Any]) -> BenchRun:
    devices = tuple(DeviceFacts(**facts) for facts in content["devices"])
    for facts in devices:
        check_facts(facts)
    rows = tuple(_row(held) for held in content["rows"])
    if not rows:
        raise ValueError("no rows")
    names = {facts.name for facts in devices}
    for row in rows:
        if row.device not in ({OPENCV} if row.kind == "peer" else names):
            raise ValueError(f"row {row.name} on {row.device}, which is none of its devices")
    machine, method, peers = dict(content["machine"]), dict(content["method"]), content["peers"]
    check_machine(machine)
    check_method(method)
    check_words(peers, "peers")
    check_words({"started": content["started"]}, "run")
    check_took(content["took"])
    return BenchRun(
        started=content["started"],
        took=content["took"],
        method=method,
        machine=machine,
        peers=peers,
        devices=devices,
        rows=rows,
    )


def _row(held: dict[str, Any]) -> Row:
    fields = {name: value for name, value in held.items() if name != "derived"}
    for name in ("wall", "on_device", "peer_wall", "stereobm_wall"):
        if fields[name] is not None:
            fields[name] = Times(**fields[name])
            check_times(fields[name], f"times {name}")
    row = Row(**fields)
    check_row(row)
    return row
