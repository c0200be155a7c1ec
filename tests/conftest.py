"""Devices and data that tests run on; what is missing is skipped by name, or fails if it is required.

STEREO_GPU_REQUIRE=opencl,warp:cpu,data,ptxas,vtk,gltf-validator,matplotlib,service,ray,chromium turns the skip of a
missing device, of missing data, of an extra or of a tool into a failure.
"""

import importlib.util
import os
from pathlib import Path

import pytest

from stereo_gpu.backends import devices, open_backend
from stereo_gpu.errors import BackendError
from stereo_gpu.images import write_png
from stereo_gpu.scene import build_scene
from stereo_gpu.scene_render import render_pair

REQUIRED = {name for name in os.environ.get("STEREO_GPU_REQUIRE", "").split(",") if name}
DATA = Path(os.environ.get("STEREO_GPU_DATA", Path(__file__).parents[1] / ".." / "shared" / "data"))


def missing(name, reason):
    if name in REQUIRED:
        pytest.fail(f"{name} is required here: {reason}")
    pytest.skip(f"{name}: {reason}")


def need_matplotlib():
    """Skip a test that draws plots where they cannot be drawn."""
    if importlib.util.find_spec("matplotlib") is None:
        missing("matplotlib", "it is not installed: pip install 'stereo-gpu[plot]'")


def device_names():
    gpus = [status.name for status in devices() if status.kind == "gpu" and status.available]
    return ["opencl", "warp:cpu", *gpus]


@pytest.fixture(params=device_names())
def backend(request):
    """Every device that can be had; the whole suite of kernel tests runs on each."""
    try:
        return open_backend(request.param)
    except BackendError as error:
        missing(request.param, str(error))


@pytest.fixture(scope="session")
def data():
    """The folder of real pictures with known truth."""
    if not DATA.is_dir():
        missing("data", f"no folder {DATA}; set STEREO_GPU_DATA")
    return DATA


@pytest.fixture(scope="session")
def board_calibration(data):
    """The 13 real pairs of board_10x7, calibrated in full; several tests ask for it, and it takes seconds."""
    from stereo_gpu.boards.board import Board
    from stereo_gpu.calibrate import calibrate_in_full

    folder = data / "calibration" / "board_10x7"
    return calibrate_in_full(*(sorted(folder.glob(f"{side}*.jpg")) for side in ("left", "right")), Board(10, 7, 30.0))


@pytest.fixture(scope="session")
def small_scene():
    """The built-in scene at 320 x 240, whose true cameras spare a test the calibration."""
    return build_scene((320, 240))


@pytest.fixture(scope="session")
def raw_folder(small_scene, tmp_path_factory):
    """A folder with the scene's raw pair, left.png and right.png, and its true rig, rig.json."""
    folder = tmp_path_factory.mktemp("raw")
    for name, picture in zip(("left", "right"), render_pair(small_scene), strict=True):
        write_png(folder / f"{name}.png", picture)
    small_scene.rig.save(folder / "rig.json")
    return folder


def need_service():
    """Skip where what the service needs is not installed."""
    try:
        import httpx  # noqa: F401
        import uvicorn  # noqa: F401

        import stereo_gpu.service.http.app  # noqa: F401
    except ModuleNotFoundError as error:
        missing("service", f"{error}; pip install 'stereo-gpu[service]' httpx")


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """The service with one worker on a free port: a `serving.Served`. Whoever stops it makes one of its own."""
    from serving import serving

    need_service()
    with serving(tmp_path_factory.mktemp("service")) as one:
        yield one


@pytest.fixture(scope="module")
def browser(served):
    """A headless Chromium; of a module, since no test can run an event loop while Playwright has one in its thread."""
    from browsing import chromium

    with chromium() as one:
        yield one


@pytest.fixture
def visit(browser, served):
    """Opens the service's page, a `browsing.Visit`; at the end nothing may have gone wrong in its console."""
    from browsing import Visit

    opened = []

    def open_page(token=None, **options):
        opened.append(Visit(browser, served, token, **options))
        return opened[-1]

    yield open_page
    for each in opened:
        each.close()
    assert [line for each in opened for line in each.wrong] == []


@pytest.fixture(scope="module")
def owner(served):
    """An httpx client of the service with its first token."""
    with served.client() as one:
        yield one


@pytest.fixture(scope="module")
def done(owner, raw_folder):
    """A job of the owner, called cup, that has ended well, with pictures of its steps."""
    from serving import FAST, add_rig, post_pair, wait_for

    job = post_pair(owner, raw_folder, add_rig(owner, raw_folder), {**FAST, "steps": True}, label="cup").json()
    return wait_for(owner, job["id"])


@pytest.fixture(scope="module")
def ray_cluster():
    """A Ray cluster of this machine alone, which all executors of a module share: each would start one of its own."""
    if importlib.util.find_spec("ray") is None:
        missing("ray", 'it is not installed: pip install "stereo-gpu[ray]"')
    from stereo_gpu.engines.ray_connection import connect, release

    connect(None, 2)
    yield
    release()
