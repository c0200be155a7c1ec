"""The child process in which xatlas runs, so that it can be stopped; and the frames that it and its parent exchange.

Run as a script, it answers one frame after another on stdin until that closes. It must start quickly, so it imports
nothing of ours. A frame is a length, a JSON header and the raw bytes of the arrays that the header names.

verb    in                                               out
charts  positions (N, 3) float32, faces (M, 3) uint32    chart (M,) int32, the chart of each face; -1 for none
pack    corners (N, 2) float32, faces (M, 3) uint32,     place (C, 2) float64, where xatlas put the vertices `first`;
        first (C,) int64, a vertex of each chart         size (2,) int64, width and height
"""

from __future__ import annotations

import json
import os
import signal
import struct
import sys
from typing import IO, Any

import numpy as np

Arrays = dict[str, np.ndarray]

_LENGTH = struct.Struct("<I")
# How long after its time limit a child that nobody stopped ends by itself: its parent may have been killed.
_GRACE_S = 2


def write_frame(stream: IO[bytes], header: dict[str, Any], arrays: Arrays) -> None:
    """Send a header and arrays; OSError where the other end is gone."""
    whole = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    layout = [(name, array.dtype.str, array.shape) for name, array in whole.items()]
    text = json.dumps({**header, "arrays": layout}).encode()
    stream.write(b"".join([_LENGTH.pack(len(text)), text, *(array.tobytes() for array in whole.values())]))
    stream.flush()


def read_frame(stream: IO[bytes]) -> tuple[dict[str, Any], Arrays] | None:
    """Receive what `write_frame` sent; None where the stream ends, be it in the middle of a frame."""
    length = stream.read(_LENGTH.size)
    if len(length) < _LENGTH.size:
        return None
    text = stream.read(*_LENGTH.unpack(length))
    if len(text) < _LENGTH.unpack(length)[0]:
        return None
    header = json.loads(text)
    arrays = {}
    for name, kind, shape in header.pop("arrays"):
        dtype = np.dtype(kind)
        size = dtype.itemsize * int(np.prod(shape))
        data = stream.read(size)
        if len(data) < size:
            return None
        arrays[name] = np.frombuffer(data, dtype).reshape(shape)
    return header, arrays


def charts(xatlas: Any, arrays: Arrays) -> Arrays:
    """Cut a mesh into charts."""
    atlas = xatlas.Atlas()
    atlas.add_mesh(arrays["positions"], arrays["faces"])
    # The charts are packed elsewhere, so this packing need only be quick.
    packing = xatlas.PackOptions()
    packing.texels_per_unit, packing.padding, packing.bilinear, packing.rotate_charts = 0.05, 0, False, False
    atlas.generate(xatlas.ChartOptions(), packing, verbose=False)
    chart = np.full(len(arrays["faces"]), -1, np.int32)
    for number in range(atlas.get_mesh_chart_count(0)):
        chart[atlas.get_mesh_chart(0, number).faces] = number
    return {"chart": chart}


def pack(xatlas: Any, arrays: Arrays) -> Arrays:
    """Place charts, a unit a texel, unturned; their extents are whole numbers, or xatlas would stretch them."""
    atlas = xatlas.Atlas()
    atlas.add_uv_mesh(arrays["corners"], arrays["faces"])
    packing = xatlas.PackOptions()
    packing.texels_per_unit, packing.padding, packing.bilinear = 1.0, 0, False
    packing.rotate_charts = packing.rotate_charts_to_axis = False
    packing.bruteForce = True
    atlas.generate(xatlas.ChartOptions(), packing, verbose=False)
    if atlas.chart_count != len(arrays["first"]) or atlas.atlas_count != 1:
        raise RuntimeError(f"{len(arrays['first'])} charts became {atlas.chart_count} in {atlas.atlas_count} atlases")
    _, _, uv = atlas[0]
    size = np.array([atlas.width, atlas.height])
    return {"place": uv[arrays["first"]].astype(np.float64) * size, "size": size}


def main() -> None:
    """Say that all is imported, then answer until stdin closes."""
    # Ctrl-C reaches the whole group of processes; the parent is the one to act on it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints must not come between the frames
    import xatlas

    verbs = {"charts": charts, "pack": pack}
    write_frame(answers, {"error": None}, {})
    while (question := read_frame(questions)) is not None:
        header, arrays = question
        if hasattr(signal, "alarm"):  # it ends even a process in which xatlas holds Python's lock
            signal.alarm(int(header["seconds"]) + _GRACE_S)
        try:
            answer, error = verbs[header["verb"]](xatlas, arrays), None
        except Exception as problem:  # the parent decides what is lost by it
            answer, error = {}, " ".join(str(problem).split()) or type(problem).__name__
        if hasattr(signal, "alarm"):
            signal.alarm(0)
        try:
            write_frame(answers, {"error": error}, answer)
        except OSError:
            return


if __name__ == "__main__":
    main()
