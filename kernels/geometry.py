"""How each kernel is launched: how many work-items, and the scalars and scratch that follow from that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class Geometry:
    """One launch.

    Args:
        size: work-items along each axis, the fastest axis first (OpenCL's order).
        scalars: parameters of the kernel that the launch decides.
        scratch_floats: length of the kernel's `scratch` buffer in floats; 0 for none.
        group: work-items of a group along the fastest axis, where the kernel needs so many; 0 where any number will
            do. size is a multiple of it.
        alone: work-items that share nothing and are best run one to a work-group.
        whole: work-items may write to each other's places, which is safe where an atomic is one. Warp's are none on
            the CPU, so that several threads must not share such a launch.
        stages: how many times the kernel runs, with its scalar `stage` counting from 0; scratch is kept in between.
    """

    size: tuple[int, ...]
    scalars: Mapping[str, int] = field(default_factory=dict)
    scratch_floats: int = 0
    group: int = 0
    alone: bool = False
    whole: bool = False
    stages: int = 1


@dataclass(frozen=True)
class Call:
    """What is known of a launch: its arguments by parameter name, and the device's language and compute units."""

    arguments: Mapping[str, Any]
    language: str
    units: int

    def __getitem__(self, name: str) -> Any:
        """An argument."""
        return self.arguments[name]

    def strips(self, about: int) -> tuple[int, int]:
        """How many strips the picture is cut into, about so many, and the rows of each, none under 16."""
        rows = max(16, -(-self["height"] // about))
        return -(-self["height"] // rows), rows


def geometry(kernel: str, language: str, form: str, arguments: Mapping[str, Any], units: int) -> Geometry:
    """Say how to launch a kernel.

    Args:
        kernel: its name.
        language: "warp" or "opencl".
        form: "gpu" or "cpu", for kernels that have a form for each.
        arguments: the call's arguments by parameter name.
        units: compute units of the device (cores of a CPU).
    """
    call = Call(arguments, language, units)
    if form == "cpu" and kernel in _ON_CPU[language]:
        return _ON_CPU[language][kernel](call)
    return _ON_ALL.get(kernel, _pixels)(call)


def _pixels(call: Call) -> Geometry:
    return Geometry((call["width"], call["height"]))


def _texels(call: Call) -> Geometry:
    return Geometry((call["texture_width"], call["texture_height"]))


def _triangles(call: Call) -> Geometry:
    return Geometry((call["triangles"],), whole=True)


# Work-items that draw a triangle together.
MEMBERS = 32


def _members(call: Call) -> Geometry:
    return Geometry((MEMBERS, call["triangles"]), {"members": MEMBERS}, whole=True, stages=2)


def _sample_bands(call: Call) -> Geometry:
    # Each band looks at every triangle, so that there are few. In Warp a band is told its rows.
    bands = min(call["height"], 3 * call.units)
    return Geometry((bands,), {"members": -(-call["height"] // bands)}, alone=True)


def _cells(call: Call) -> Geometry:
    return Geometry((call["disparities"], call["width"], call["height"]))


def _rows(call: Call) -> Geometry:
    return Geometry((call["height"],))


def _bands(call: Call) -> Geometry:
    # Eight bands of rows a core even out the load.
    return Geometry((min(call["height"], 8 * call.units),), alone=True)


def _texel_bands(call: Call) -> Geometry:
    return Geometry((min(call["texture_height"], 8 * call.units),), alone=True)


def _cover_bands(call: Call) -> Geometry:
    # Each band looks at every triangle, so that there are fewer.
    return Geometry((min(call["texture_height"], 3 * call.units),), alone=True)


def _norm_columns(call: Call) -> Geometry:
    strips, rows = call.strips(8)
    return Geometry((call["width"], strips), {"rows": rows})


def _norm_strips(call: Call) -> Geometry:
    strips, rows = call.strips(8 * call.units if call.language == "opencl" else 4 * call.units)
    return Geometry((strips,), {"rows": rows}, alone=call.language == "opencl")


def _volume_strips(call: Call) -> Geometry:
    strips, rows = call.strips(4)
    return Geometry((call["disparities"], call["width"], strips), {"rows": rows})


# The same as in block_winners, which the forms for GPUs of ncc_wta and wta use: disparities and columns of a group.
GROUPS = {"opencl": (64, 8), "warp": (128, 16)}
# Members of the record that waits in scratch between chunks of disparities.
RECORD = 7


def _grouped(call: Call, tiles: int, strips: int) -> Geometry:
    # OpenCL counts the work-items of groups along the fastest axis, Warp the groups along the slower one.
    group, _ = GROUPS[call.language]
    return Geometry((tiles * group, strips) if call.language == "opencl" else (group, tiles * strips), group=group)


def _winners_on_gpu(call: Call) -> Geometry:
    return _grouped(call, -(-call["width"] // GROUPS[call.language][1]), call["height"])


def _ncc_winners_on_gpu(call: Call) -> Geometry:
    group, columns = GROUPS[call.language]
    tiles = -(-call["width"] // columns)
    # About 2048 work-items a compute unit keep a GPU busy; every strip sums up its first window anew.
    strips, rows = call.strips(max(4, 2048 // group * call.units // tiles))
    scratch = RECORD * call["width"] * call["height"]
    return replace(_grouped(call, tiles, strips), scalars={"rows": rows}, scratch_floats=scratch)


def _ncc_winners_in_opencl(call: Call) -> Geometry:
    # Four strips a core even out the load; a strip much shorter than its window would repeat work.
    strips, rows = call.strips(4 * call.units)
    # What lay_out in opencl/ncc_wta_cpu.cl takes, with vectors of at most 16 lanes.
    padded = -(-call["disparities"] // 16) * 16
    block = min(640, max(64, 65536 // padded // 16 * 16))
    columns = block + 2 * call["radius"]
    span = (columns + padded + 16) // 16 * 16 + 16
    sums, keys = (padded + 16) * (columns + 2), 16 * (padded + 64)
    floats = sums + keys + 5 * span + 2 * block + 35 * 16
    return Geometry((strips,), {"rows": rows}, strips * floats, alone=True)


def _ncc_winners_in_warp(call: Call) -> Geometry:
    strips, rows = call.strips(4 * call.units)
    # What warp/ncc_wta_cpu.py takes, by its own constants.
    block, tile, lanes = 64, 16, 16
    padded = -(-call["disparities"] // lanes) * lanes
    columns = block + 2 * call["radius"]
    span = (columns + padded + 2 * lanes - 1) // lanes * lanes
    sums, keys = padded * (columns + 1), tile * (padded + 2 * (tile + lanes))
    floats = sums + keys + 7 * span + 2 * block + (2 * tile + 1) * lanes + 2 * tile
    return Geometry((strips,), {"rows": rows}, strips * floats + lanes)


# The same as in the forms of aggregate for GPUs: work-items and lines of a group, and disparities that need no scratch.
LINE_GROUP, GROUP_LINES, HELD = 64, 2, 256
# The same as in the forms of aggregate for CPUs: rows of a band, columns of a strip at most, lanes at most.
BAND, WIDEST, SHORTS = 32, 256, 32
# The same as in the form of aggregate for CPUs in Warp.
PAD = 4


def _lines(call: Call) -> int:
    """Lines of the picture in the direction of a path, at most."""
    return int(call["width"] + call["height"] - 1 if call["heading"] else call["height"])


def _paths(call: Call) -> int:
    return 3 if call["heading"] else 2


def _paths_on_gpu(call: Call) -> Geometry:
    lines = _lines(call)
    rest = 2 * lines * call["disparities"] if call["disparities"] > HELD else 1
    groups = -(-lines // GROUP_LINES)
    size = (groups * LINE_GROUP,) if call.language == "opencl" else (LINE_GROUP, groups)
    return Geometry(size, scratch_floats=rest, group=LINE_GROUP, stages=_paths(call))


def _paths_in_opencl(call: Call) -> Geometry:
    padded = -(-call["disparities"] // SHORTS) * SHORTS
    stride = padded + SHORTS
    common = stride + 3 * (padded + 2 * SHORTS)
    if call["heading"] == 0:
        items = min(call["height"], 8 * call.units)
        room = common + 2 * padded + call["width"] + 2 * SHORTS
        return Geometry((items,), scratch_floats=items * room // 2 + 1, alone=True)
    # Two strips a core even out the load; a wide one repeats less of what leans into it.
    columns = min(WIDEST, -(-call["width"] // (2 * call.units)))
    strips = -(-call["width"] // columns)
    room = common + 3 * (WIDEST + 2 * BAND + SHORTS) + 3 * (columns + min(BAND, call["height"])) * stride
    shorts = strips * room + 6 * call["width"] * stride
    return Geometry((strips,), scratch_floats=shorts // 2 + 1, alone=True, stages=-(-call["height"] // BAND))


def _paths_in_warp(call: Call) -> Geometry:
    lines = _lines(call)
    scratch = lines * (call["disparities"] + 2 * PAD)
    return Geometry((lines,), scratch_floats=scratch, alone=True, stages=_paths(call))


def _cell_grid(call: Call) -> Geometry:
    return Geometry((-(-call["width"] // call["cell"]), -(-call["height"] // call["cell"])))


def _cell_bands(call: Call) -> Geometry:
    return Geometry((min(-(-call["height"] // call["cell"]), 8 * call.units),), alone=True)


def _plane_grid(call: Call) -> Geometry:
    return Geometry((call["planes_wide"], call["planes_high"]))


def _plane_rows(call: Call) -> Geometry:
    return Geometry((call["planes_high"],))


def _plane_bands(call: Call) -> Geometry:
    return Geometry((min(call["planes_high"], 8 * call.units),), alone=True)


def _lowest_on_gpu(call: Call) -> Geometry:
    # As many columns of a row as a group has work-items.
    tiles = -(-call["width"] // LINE_GROUP)
    size = (tiles * LINE_GROUP, call["height"]) if call.language == "opencl" else (LINE_GROUP, tiles * call["height"])
    return Geometry(size, group=LINE_GROUP)


def _hypotenuses(call: Call) -> Geometry:
    side = call["side"]
    rows = side if call["diagonal"] else side // 2
    return Geometry((-(-call["width"] // side), -(-call["height"] // rows)))


# Every kernel that is not here or in the form's table has a work-item a pixel.
_ON_ALL: dict[str, Callable[[Call], Geometry]] = {
    "aggregate": _paths_on_gpu,
    "bake": _texels,
    "cells": _cell_grid,
    "cover": _triangles,
    "lowest": _lowest_on_gpu,
    "match_cost": _cells,
    "ncc_volume": _volume_strips,
    "ncc_wta": _ncc_winners_on_gpu,
    "place": _texels,
    "planes": _plane_grid,
    "rasterise": _members,
    "split_triangles": _hypotenuses,
    "window_norms": _norm_columns,
    "wta": _winners_on_gpu,
}
_ON_CPU: dict[str, dict[str, Callable[[Call], Geometry]]] = {
    "opencl": {
        "aggregate": _paths_in_opencl,
        "agree": _bands,
        "agreement": _bands,
        "bake": _texel_bands,
        "cells": _cell_bands,
        "census": _bands,
        "certainty": _bands,
        "confidence": _bands,
        "consistency": _bands,
        "cover": _cover_bands,
        "evidence": _bands,
        "fill": _bands,
        "flat": _bands,
        "grey": _bands,
        "guide": _bands,
        "guided_support": _bands,
        "lowest": _bands,
        "majority": _bands,
        "match_cost": _bands,
        "median": _bands,
        "merge": _bands,
        "ncc_wta": _ncc_winners_in_opencl,
        "place": _texel_bands,
        "plane_fit": _bands,
        "planes": _plane_bands,
        "rasterise": _sample_bands,
        "pull": _bands,
        "push": _bands,
        "rectify": _bands,
        "residual": _bands,
        "shade": _bands,
        "slopes": _bands,
        "smooth": _bands,
        "support": _bands,
        "triangulate": _bands,
        "vote": _bands,
        "window_norms": _norm_strips,
        "wta": _bands,
    },
    "warp": {
        "aggregate": _paths_in_warp,
        "agreement": _rows,
        "consistency": _rows,
        "evidence": _rows,
        "grey": _rows,
        "guided_support": _rows,
        "lowest": _pixels,
        "majority": _rows,
        "match_cost": _rows,
        "median": _rows,
        "merge": _rows,
        "ncc_wta": _ncc_winners_in_warp,
        "plane_fit": _rows,
        "planes": _plane_rows,
        "rasterise": _sample_bands,
        "rectify": _rows,
        "smooth": _rows,
        "support": _rows,
        "triangulate": _rows,
        "window_norms": _norm_strips,
        "wta": _pixels,
    },
}
