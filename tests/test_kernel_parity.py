"""The same kernel, file and parameter names in both languages and in the loops of reference.py."""

import importlib
from pathlib import Path

import pytest
import reference

import stereo_gpu.kernels as kernels
from stereo_gpu.kernels.opencl import parameters, together

FOLDER = Path(kernels.__file__).parent
FILES = sorted(path.stem for path in (FOLDER / "opencl").glob("*.cl"))
OPENCL = [name for name in FILES if not name.endswith("_cpu")]
FORMS = [name.removesuffix("_cpu") for name in FILES if name.endswith("_cpu")]
FIXED = ["rectify", "smooth", "ncc_volume", "wta", "ncc_wta", "consistency", "median", "triangulate", "bake"]
TYPES = {"float32": "float", "int32": "int", "uint8": "uchar", "uint16": "ushort", "Any": "PIXEL"}


def test_every_kernel_is_there():
    assert set(FIXED) <= set(OPENCL)


@pytest.mark.parametrize("name", OPENCL)
def test_same_parameters(name):
    program = getattr(importlib.import_module(f"stereo_gpu.kernels.warp.{name}"), name)
    warp = []
    for argument in program.adj.args:
        array = hasattr(argument.type, "dtype")
        element = argument.type.dtype if array else argument.type
        warp.append(
            (
                argument.label,
                TYPES[{"int": "int32", "float": "float32"}.get(element.__name__, element.__name__)],
                array,
            )
        )
    assert warp == [(p.name, p.type, p.array) for p in parameters(name)]


@pytest.mark.parametrize("name", OPENCL)
def test_outputs_come_last_and_are_named_so(name):
    outputs = [p.name.endswith("_out") for p in parameters(name)]
    assert any(outputs)
    assert outputs == sorted(outputs)


@pytest.mark.parametrize("name", OPENCL)
def test_has_reference(name):
    # ncc_wta is ncc_volume followed by wta, and is tested against both.
    assert name == "ncc_wta" or callable(getattr(reference, name))


@pytest.mark.parametrize("name", FORMS)
def test_both_forms_take_the_same_parameters(name):
    assert parameters(name, "cpu") == parameters(name, "gpu")


@pytest.mark.parametrize("name", OPENCL)
def test_kernels_of_one_program_have_no_type_to_choose(name):
    names = together(name)
    assert name in names and set(names) <= set(OPENCL)
    assert len(names) == 1 or all(p.type != "PIXEL" for p in parameters(name))
