"""Refuse a kept run whose values are not what the report, the comparison and the pictures compute with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stereo_gpu.bench.machine import DeviceFacts
from stereo_gpu.bench.row import Row
from stereo_gpu.bench.timing import Times

# Ratios and products of numbers within these stay finite.
SMALLEST, LARGEST = 1e-30, 1e30
LARGEST_SIDE = 1_000_000  # px
KINDS = ("kernel", "profile", "peer")
METHOD = (
    "seconds",
    "warm_up_seconds",
    "repeats",
    "fewest_repeats",
    "dropped_at_either_end",
    "cap_seconds",
    "stereobm_share",
)


def check_times(times: Times, what: str) -> None:
    """Raises ValueError for times that are not positive and in order."""
    for name in ("median", "lowest", "highest", "repeats"):
        _check_number(getattr(times, name), f"{what} {name}", positive=True)
    if not times.lowest <= times.median <= times.highest:
        raise ValueError(f"{what} out of order: {times}")
    if not isinstance(times.repeats, int):
        raise ValueError(f"{what} repeats {times.repeats!r}")


def check_row(row: Row) -> None:
    """Raises ValueError for a row with a value of a wrong type or out of range; its times are checked apart."""
    _check_words({name: getattr(row, name) for name in ("name", "kind", "device", "per")}, "rows")
    _check_words({name: getattr(row, name) for name in ("formula", "peer", "note")}, "rows", empty=True)
    what = f"row {row.name}"
    if row.kind not in KINDS or row.per not in ("cell", "pixel"):
        raise ValueError(f"{what}: kind {row.kind!r}, per {row.per!r}")
    for side in (*row.size, row.window):
        if type(side) is not int or not 0 < side <= LARGEST_SIDE:
            raise ValueError(f"a row of size {row.size}, window {row.window!r}")
    _check_number(row.bytes_moved, f"{what}: bytes_moved")
    for name in ("operations", "transfer"):
        if getattr(row, name) is not None:
            _check_number(getattr(row, name), f"{what}: {name}")


def check_facts(facts: DeviceFacts) -> None:
    """Raises ValueError for a device without words or without roofs."""
    words = {name: getattr(facts, name) for name in ("name", "device", "driver", "compiler", "kind", "roofs")}
    _check_words(words, "devices", empty=True)
    for name in ("copy_bytes_s", "operations_s"):
        _check_number(getattr(facts, name), f"{name} of {facts.name}", positive=True)


def check_machine(machine: Mapping[str, Any]) -> None:
    """Raises KeyError or ValueError for a machine of which the report cannot tell."""
    _check_words({name: machine[name] for name in ("processor", "system", "python", "opencv")}, "machine", empty=True)
    _check_number(machine["cores"], "cores", positive=True)
    check_words(machine["versions"], "versions")
    for name in ("memory_bytes", "load_average"):
        if machine.get(name) is not None:
            _check_number(machine[name], name)


def check_method(method: Mapping[str, Any]) -> None:
    """Raises KeyError or ValueError for a method that lacks a number."""
    for name in METHOD:
        _check_number(method[name], f"method {name}")


def check_words(held: object, what: str) -> None:
    """Raises ValueError for anything but words by name."""
    if not isinstance(held, Mapping):
        raise ValueError(f"{what} {held!r:.40}")
    _check_words(held, what, empty=True)


def check_took(took: object) -> None:
    """Raises ValueError for anything but seconds."""
    _check_number(took, "took")


def _check_words(held: Mapping[str, Any], what: str, *, empty: bool = False) -> None:
    for name, value in held.items():
        if not isinstance(value, str) or not (value or empty):
            raise ValueError(f"{what}: {name} {value!r:.40}")


def _check_number(value: object, what: str, *, positive: bool = False) -> None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    # Not a number and infinity fail here too.
    if not is_number or not (SMALLEST if positive else 0) <= value <= LARGEST:  # type: ignore[operator]
        raise ValueError(f"{what} {value!r:.40}")
