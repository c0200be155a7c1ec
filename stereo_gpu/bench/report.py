"""A run of the benchmark as lines of text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from stereo_gpu.bench.machine import DeviceFacts
from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.row import Row

NAME_WIDTH = 26
COLUMNS = (
    ("device ms", 11),
    ("wall ms", 10),
    ("spread", 8),
    ("copies ms", 11),
    ("GDE/s", 9),
    ("Mpx/s", 8),
    ("GB/s", 9),
    ("of copy", 9),
    ("x StereoBM", 12),
)


def report_lines(run: BenchRun) -> Iterator[str]:
    """The whole report of a run, such as one that was loaded."""
    yield from machine_lines(run.machine)
    yield from device_lines(run.devices)
    for size in run.sizes:
        yield from size_lines(*size, run.window)
        device = ""
        for row in run.rows:
            if row.size != size:
                continue
            facts = run.facts(row.device)
            if facts and row.device != device:
                device = row.device
                yield f"  {device}"
            yield row_line(row, facts)
    yield from peer_lines(run.peers)


def machine_lines(machine: Mapping[str, Any]) -> Iterator[str]:
    """The machine and the versions of what takes part."""
    memory = f"{machine['memory_bytes'] / 2**30:.0f} GiB" if machine.get("memory_bytes") else "memory unknown"
    yield f"{machine['processor']}, {machine['cores']} cores, {memory}, {machine['system']}"
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    yield f"Python {machine['python']}, OpenCV {machine['opencv']}, {versions}"
    load = machine.get("load_average")
    if load is not None and load > 0.5:
        yield f"others are at work here (load average {load:.1f}): times are noisy, look at the ratios"


def device_lines(facts: Sequence[DeviceFacts]) -> Iterator[str]:
    """Each device with its software and its roofs."""
    for each in facts:
        yield f"{each.name}: {each.device}; driver {each.driver}; compiler {each.compiler}"
        yield (
            f"  copies {each.copy_bytes_s / 1e9:.1f} GB/s, computes {each.operations_s / 1e9:,.0f} Gop/s"
            f" (measured: {each.roofs})"
        )


def size_lines(width: int, height: int, disparities: int, window: int) -> Iterator[str]:
    """The head of a size's table."""
    yield ""
    yield f"{width} x {height} x {disparities}, window {window}"
    yield f"{'':{NAME_WIDTH}}" + "".join(f"{name:>{wide}}" for name, wide in COLUMNS) + "   x peer"


def row_line(row: Row, facts: DeviceFacts | None) -> str:
    """One row as text."""
    name = f"    {row.name}"
    if row.wall is None:
        return f"{name:<{NAME_WIDTH + 2}}{row.note}"
    line = f"{name:<{NAME_WIDTH}}" + "".join(
        f"{value:>{wide}}" for value, (_, wide) in zip(row_cells(row, facts), COLUMNS, strict=True)
    )
    if row.to_peer is not None:
        line += f"   {number(row.to_peer)} x {row.peer}"
    return line + (f"   ({row.note})" if row.note else "")


def row_cells(row: Row, facts: DeviceFacts | None) -> tuple[str, ...]:
    """What stands in COLUMNS for a row that was run; a dash stands for what does not apply."""
    assert row.wall is not None
    share = row.bytes_s / facts.copy_bytes_s if facts and row.bytes_s else None
    pixels = row.width * row.height / row.seconds / 1e6 if row.seconds else None
    return (
        number(1e3 * row.on_device.median if row.on_device else None),
        number(1e3 * row.wall.median),
        f"{row.wall.spread:.0%}" if row.wall.repeats > 1 else "once",
        number(1e3 * row.transfer if row.transfer else None),
        number(row.evaluations_s and row.evaluations_s / 1e9),
        number(pixels),
        number(row.bytes_s and row.bytes_s / 1e9),
        f"{share:.1%}" if share is not None else "-",
        number(row.to_stereobm),
    )


def operations_words(row: Row) -> str:
    """Operations for each cell or pixel, as in `11 WHD`; a dash where they are not counted."""
    if not row.operations:
        return "-"
    cell = row.per == "cell"
    units = row.width * row.height * (row.disparities if cell else 1)
    return f"{row.operations / units:.3g} {'WHD' if cell else 'WH'}"


def peer_lines(peers: Mapping[str, str]) -> Iterator[str]:
    """What the columns mean, and what OpenCV's functions were called with."""
    yield ""
    yield "device ms: by the device's clock; wall ms: until the result is there, median; spread: of the middle 90 %"
    yield "GDE/s: W x H x D over the time (of a kernel: on the device; of a call: wall), GB/s: least traffic over it"
    yield "x peer, x StereoBM: wall time over that of the OpenCV function, timed in turn in the same run"
    for name, settings in peers.items():
        yield f"  {name}: {settings}"


def number(value: float | None) -> str:
    """A number with the digits that count; a dash for None."""
    if value is None:
        return "-"
    if value >= 99.95:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 9.995 else f"{value:.2f}" if value >= 0.0995 else f"{value:.2g}"
