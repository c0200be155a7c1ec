"""How each kernel is launched: how many work-items, and the scalars and scratch that follow from that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# The same constants as in warp/ncc_wta_cpu.py, whose work-item holds so much scratch.
BLOCK, TILE, LANES = 64, 16, 16
# The same as in the forms of aggregate for CPUs.
SIDE_BY_SIDE, PAD = 8, 4

# Kernels whose Warp form for CPUs gives each work-item a row.
ROWS = frozenset({"consistency", "grey", "median", "rectify", "slant", "smooth", "support", "triangulate"})
# Kernels whose OpenCL form for CPUs gives each work-item a band of rows.
BANDED = frozenset(
    {
        "census",
        "census_volume",
        "confidence",
        "consistency",
        "dilate",
        "fill",
        "grey",
        "median",
        "rectify",
        "slant",
        "smooth",
        "support",
        "triangulate",
        "wta",
    }
)


# The same as in block_winners, which the forms for GPUs of ncc_wta and wta use: disparities and columns of a group.
GROUPS = {"opencl": (64, 8), "warp": (128, 16)}
# The same as in the forms of aggregate for GPUs: work-items of a line, and disparities that need no scratch.
LINE_GROUP, HELD = 64, 256
# Members of the record that waits in their scratch between chunks of disparities.
RECORD = 7


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
    """

    size: tuple[int, ...]
    scalars: Mapping[str, int] = field(default_factory=dict)
    scratch_floats: int = 0
    group: int = 0
    alone: bool = False
    whole: bool = False


def geometry(kernel: str, language: str, form: str, arguments: Mapping[str, Any], units: int) -> Geometry:
    """Say how to launch a kernel.

    Args:
        kernel: its name.
        language: "warp" or "opencl".
        form: "gpu" or "cpu", for kernels that have a form for each.
        arguments: the call's arguments by parameter name.
        units: compute units of the device (cores of a CPU).
    """
    width, height = arguments.get("width", 1), arguments.get("height", 1)
    if form == "gpu" and kernel == "ncc_wta":
        return _ncc_wta_on_gpu(language, width, height, units)
    if form == "gpu" and kernel == "wta":
        group, columns = GROUPS[language]
        tiles = -(-width // columns)
        return Geometry((tiles * group, height) if language == "opencl" else (group, tiles * height), group=group)
    if kernel in ("cover", "bake") and language == "opencl" and form == "cpu":
        # Bands as below, of the atlas; each one of cover looks at every triangle, so that there are fewer.
        return Geometry((min(arguments["texture_height"], (3 if kernel == "cover" else 8) * units),), alone=True)
    if kernel == "cover":
        return Geometry((arguments["triangles"],), whole=True)
    if kernel == "bake":
        return Geometry((arguments["texture_width"], arguments["texture_height"]))
    if kernel == "aggregate":
        lines = height if arguments["step_y"] == 0 else width + (height - 1 if arguments["step_x"] else 0)
        if form == "gpu":
            rest = 2 * lines * arguments["disparities"] if arguments["disparities"] > HELD else 1
            size = (lines * LINE_GROUP,) if language == "opencl" else (LINE_GROUP, lines)
            return Geometry(size, {"lines": lines}, rest, group=LINE_GROUP)
        if language == "opencl" and form == "cpu":
            together = SIDE_BY_SIDE if arguments["step_y"] else 1
            walled = (-(-arguments["disparities"] // LANES) + 2) * LANES
            return Geometry((-(-lines // together),), {"lines": lines}, 2 * lines * walled, alone=True)
        return Geometry((lines,), {"lines": lines}, 2 * lines * (arguments["disparities"] + 2 * PAD), alone=True)
    if kernel in ROWS and language == "warp" and form == "cpu":
        return Geometry((height,))
    if kernel in BANDED and language == "opencl" and form == "cpu":
        # Eight bands a core even out the load.
        return Geometry((min(height, 8 * units),), alone=True)
    if kernel == "census_volume":
        return Geometry((arguments["disparities"], width, height))
    if kernel == "window_norms" and language == "warp" and form == "cpu":
        rows = _rows_a_strip(height, 4 * units)
        return Geometry((-(-height // rows),), {"rows": rows})
    if kernel == "window_norms":
        # Eight strips a core even out the load of a CPU, whose form takes whole rows.
        whole_rows = language == "opencl" and form == "cpu"
        rows = _rows_a_strip(height, 8 * units if whole_rows else 8)
        strips = -(-height // rows)
        return Geometry((strips,) if whole_rows else (width, strips), {"rows": rows}, alone=whole_rows)
    if kernel == "ncc_volume":
        rows = _rows_a_strip(height, 4)
        return Geometry((arguments["disparities"], width, -(-height // rows)), {"rows": rows})
    if kernel == "ncc_wta" and language == "opencl" and form == "cpu":
        # Four strips a core even out the load; a strip much shorter than its window would repeat work.
        rows = _rows_a_strip(height, 4 * units)
        strips = -(-height // rows)
        # What lay_out in opencl/ncc_wta_cpu.cl takes, with vectors of at most 16 lanes.
        padded = -(-arguments["disparities"] // 16) * 16
        block = min(640, max(64, 65536 // padded // 16 * 16))
        columns = block + 2 * arguments["radius"]
        span = (columns + padded + 16) // 16 * 16 + 16
        floats = (padded + 16) * (columns + 2) + 16 * (padded + 64) + 5 * span + 2 * block + 35 * 16
        return Geometry((strips,), {"rows": rows}, strips * floats, alone=True)
    if kernel == "ncc_wta" and language == "warp" and form == "cpu":
        rows = _rows_a_strip(height, 4 * units)
        strips = -(-height // rows)
        padded = -(-arguments["disparities"] // LANES) * LANES
        columns = BLOCK + 2 * arguments["radius"]
        span = (columns + padded + 2 * LANES - 1) // LANES * LANES
        sums, keys = padded * (columns + 1), TILE * (padded + 2 * (TILE + LANES))
        floats = sums + keys + 7 * span + 2 * BLOCK + (2 * TILE + 1) * LANES + 2 * TILE
        return Geometry((strips,), {"rows": rows}, strips * floats + LANES)
    return Geometry((width, height))


def _ncc_wta_on_gpu(language: str, width: int, height: int, units: int) -> Geometry:
    group, columns = GROUPS[language]
    tiles = -(-width // columns)
    # About 2048 work-items a compute unit keep a GPU busy; every strip sums up its first window anew.
    rows = _rows_a_strip(height, max(4, 2048 // group * units // tiles))
    strips = -(-height // rows)
    size = (tiles * group, strips) if language == "opencl" else (group, tiles * strips)
    return Geometry(size, {"rows": rows}, RECORD * width * height, group=group)


def _rows_a_strip(height: int, strips: int) -> int:
    """Rows of each strip when a picture is cut into about so many, none under 16 rows."""
    return max(16, -(-height // strips))
