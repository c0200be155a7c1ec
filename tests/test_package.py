"""The package's public names are there when asked for, and cost nothing before."""

import ast
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import stereo_gpu as sg

PROJECT = Path(__file__).parents[1] / "pyproject.toml"


def python(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_names_for_type_checkers_are_those_that_are_found():
    tree = ast.parse(Path(sg.__file__).read_text("utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    told = {alias.asname: node.module for node in block.body for alias in node.names if alias.name == alias.asname}
    assert told == sg._MODULES
    for name in sg.__all__:
        found = getattr(sg, name)
        assert found.__module__.startswith("stereo_gpu.") and name in dir(sg)


def test_a_wrong_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'reconstruckt'"):
        sg.reconstruckt  # noqa: B018
    with pytest.raises(ImportError, match="cannot import name 'reconstruckt'"):
        from stereo_gpu import reconstruckt  # noqa: F401


def test_a_function_is_not_hidden_by_the_module_of_its_name():
    said = python(
        "import stereo_gpu as sg, stereo_gpu.pipeline, stereo_gpu.capture\n"
        "from stereo_gpu import rectify\n"
        "print(*(callable(thing) for thing in (sg.match, sg.triangulate, sg.capture, sg.calibrate, rectify)))"
    )
    assert said == ["True"] * 5


@pytest.mark.skipif(not PROJECT.is_file(), reason="pyproject.toml is in the checkout only")
def test_every_package_gets_into_the_wheel():
    listed = set(tomllib.loads(PROJECT.read_text("utf-8"))["tool"]["setuptools"]["packages"])
    root = PROJECT.parent
    folders = [Path(folder) for folder, _, files in os.walk(root / "stereo_gpu") if files]  # those of data, too
    own = {".".join(folder.relative_to(root).parts) for folder in folders if folder.name != "__pycache__"}
    kernels = {f"stereo_gpu.{'.'.join(f.parent.relative_to(root).parts)}" for f in root.glob("kernels/**/__init__.py")}
    assert listed == own | kernels


def test_what_only_tells_imports_nothing_heavy():
    heavy = {"numpy", "cv2", "scipy", "warp", "pyopencl", "trimesh", "PIL", "matplotlib", "yaml"}
    loaded = python("import sys\nfrom stereo_gpu.cli import main\nmain(['--help'])\nprint('modules', *sys.modules)")
    assert "reconstruct" in loaded
    assert not heavy & set(loaded[loaded.index("modules") :])
