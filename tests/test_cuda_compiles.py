"""Every Warp kernel compiles for CUDA, without a GPU or a driver: to PTX for the oldest and a recent architecture."""

import importlib
from pathlib import Path
from typing import Any

import pytest
import warp as wp

import stereo_gpu.kernels as kernels
from stereo_gpu.backends.warp import statuses

FILES = (path.stem for path in (Path(kernels.__file__).parent / "opencl").glob("*.cl"))
WARP = sorted(name for name in FILES if not name.endswith("_cpu"))


def concrete(parameter, pixel):
    """The type of a parameter, with `pixel` for the elements of pictures of any type."""
    return wp.array(dtype=pixel) if getattr(parameter.type, "dtype", None) is Any else parameter.type


@pytest.mark.parametrize("name", WARP)
def test_compiles_for_cuda(name, tmp_path):
    statuses()  # starts Warp without its banner
    module = importlib.import_module(f"stereo_gpu.kernels.warp.{name}")
    program = getattr(module, name)
    entries = 1
    if program.is_generic:
        for pixel in (wp.uint8, wp.uint16):
            wp.overload(program, [concrete(parameter, pixel) for parameter in program.adj.args])
        entries = 2
    wp.compile_aot_module(module, arch=[75, 90], module_dir=tmp_path, use_ptx=True)
    made = list(tmp_path.rglob("*.ptx"))
    assert len(made) == 2
    for file in made:
        assert file.read_bytes().count(b".entry") >= entries
