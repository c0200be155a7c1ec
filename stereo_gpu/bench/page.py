"""A run of the benchmark as one HTML page that opens offline: figures, tables, machine, settings."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape

from stereo_gpu.bench.record import BenchRun
from stereo_gpu.bench.report import COLUMNS, device_lines, machine_lines, number, operations_words, row_cells
from stereo_gpu.bench.row import Row

CAPTIONS = {
    "peers": "Wall time over that of the OpenCV function that does the same, timed in turn on the same input.",
    "speed": "How many times as fast as StereoBM each matcher is, timed in turn with it on the same input.",
    "roofline": "How far each kernel is from what the memory and the arithmetic of the device allow.",
}
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #22262b; max-width: 1300px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.5rem } h2 { font-size: 1.15rem; margin-top: 2.2rem }
figure { margin: 1.5rem 0 } img { max-width: 100%; height: auto } figcaption { color: #5a616b; font-size: .9rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-size: .84rem; font-variant-numeric: tabular-nums; width: 100% }
th, td { padding: .22rem .45rem; text-align: right; white-space: nowrap; border-bottom: 1px solid #e6e9ed }
th { font-weight: 600; border-bottom: 1px solid #5a616b }
th.device { padding-top: .9rem; color: #12708e } td.name, th.name { text-align: left }
td.note { text-align: left; color: #a04a2c; white-space: normal } .faster { color: #1d7459 } .slower { color: #b8492a }
dt { font-weight: 600 } dd { margin: 0 0 .5rem 1.2rem } code { font-size: .9em }
"""


def page(run: BenchRun, pictures: Mapping[str, bytes]) -> str:
    """The page.

    Args:
        run: what to show.
        pictures: PNG files by name, a key of CAPTIONS.
    """
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width">',
        f"<title>stereo-gpu bench, {escape(run.started[:10])}</title><style>{STYLE}</style>",
        "<h1>stereo-gpu bench</h1>",
        *(f"<p>{escape(line)}</p>" for line in machine_lines(run.machine)),
        "<ul>",
        *(f"<li>{' '.join(escape(line.strip()) for line in device_lines([facts]))}</li>" for facts in run.devices),
        "</ul>",
    ]
    for name, caption in CAPTIONS.items():
        if name in pictures:
            data = base64.b64encode(pictures[name]).decode("ascii")
            parts.append(
                f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{data}">'
                f"<figcaption>{escape(caption)}</figcaption></figure>"
            )
    for size in run.sizes:
        parts.append(f"<h2>{size[0]} x {size[1]} x {size[2]}, window {run.window}</h2>")
        parts.append('<div class="wide"><table><tr><th class="name"></th>')
        parts += [f"<th>{name}</th>" for name, _ in COLUMNS]
        parts.append(
            '<th class="name">x peer</th><th class="name">least bytes</th><th class="name">operations</th></tr>'
        )
        shown = [row for row in run.rows if row.size == size]
        for device in dict.fromkeys(row.device for row in shown):
            parts.append(f'<tr><th class="name device" colspan="{len(COLUMNS) + 4}">{escape(device)}</th></tr>')
            parts += [_table_row(run, row) for row in shown if row.device == device]
        parts.append("</table></div>")
    method = run.method
    parts.append(
        "<h2>Method</h2><p>Each of ours and its peer were run in turn, after"
        f" {method['warm_up_seconds']:g} s of warming up, for at least {method['seconds']:g} s and"
        f" {method['repeats']:g} repeats each, at most {method['cap_seconds']:g} s. The upper and lower"
        f" {method['dropped_at_either_end']:.0%} were dropped; shown is the median, and as spread the range of the"
        " rest. device ms is by the device's own clock; wall ms lasts until the result is there; copies are those to"
        " and from the device, measured apart. GB/s counts each input and output once. A share of the copy over"
        f" 100 % means that caches hold the data. Started {escape(run.started)}, took {run.took:,.0f} s.</p>"
    )
    parts.append("<h2>What OpenCV was called with</h2><dl>")
    parts += [f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in run.peers.items()]
    parts.append("</dl></html>")
    return "\n".join(parts)


def _table_row(run: BenchRun, row: Row) -> str:
    name = f'<tr><td class="name">{escape(row.name)}</td>'
    if row.wall is None:
        return f'{name}<td class="note" colspan="{len(COLUMNS) + 3}">{escape(row.note)}</td></tr>'
    peer = ""
    if row.to_peer is not None:
        kind = "faster" if row.to_peer < 1 else "slower"
        peer = f'<span class="{kind}">{number(row.to_peer)}</span> x {escape(row.peer)}'
    return (
        name
        + "".join(f"<td>{cell}</td>" for cell in row_cells(row, run.facts(row.device)))
        + f'<td class="name">{peer}</td><td class="name">{escape(row.formula)}</td>'
        + f'<td class="name">{operations_words(row)}</td></tr>'
    )
