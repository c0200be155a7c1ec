import subprocess
import sys
import time

import numpy as np
import pytest
from surfaces import CENTRE, ball, plane, seen, signed_areas, triangulated

from stereo_gpu import unwrap as unwrap_module
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.mesh import build_mesh
from stereo_gpu.types import Surface
from stereo_gpu.unwrap import unwrap

SHIFT = (80.0, 60.0)


@pytest.fixture(scope="module")
def scene():
    """A ball before a wall, 37,000 triangles in two pieces."""
    return build_mesh(*triangulated(ball()), method="dense", centre=CENTRE)


@pytest.fixture(scope="module")
def view_uv(scene):
    return seen(scene.vertices, shift=SHIFT)


@pytest.fixture(scope="module")
def charts(scene, view_uv):
    return unwrap(scene, view_uv, time_limit_s=120)


def painted(unwrapped):
    """How many triangles hold each texel's centre, and the chart that holds it (0 = none)."""
    width, height = unwrapped.size
    label = np.arange(len(unwrapped.vertices))
    while True:
        lowest = np.repeat(label[unwrapped.faces].min(axis=1), 3)
        new = label.copy()
        np.minimum.at(new, unwrapped.faces.ravel(), lowest)
        new = new[new]
        if (new == label).all():
            break
        label = new
    count, chart = np.zeros((height, width), int), np.zeros((height, width), int)
    corners = unwrapped.uv[unwrapped.faces].astype(float) * unwrapped.size - 0.5
    for (a, b, c), face in zip(corners, unwrapped.faces, strict=True):
        p, q = b - a, c - a
        area = p[0] * q[1] - p[1] * q[0]
        if abs(area) < 1e-9:
            continue
        low, high = np.ceil(np.min((a, b, c), axis=0)).astype(int), np.floor(np.max((a, b, c), axis=0)).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        s = ((x - a[0]) * q[1] - (y - a[1]) * q[0]) / area
        t = (p[0] * (y - a[1]) - p[1] * (x - a[0])) / area
        # Just off its sides, since a texel on a side belongs to both of its triangles.
        inside = (s > 1e-4) & (t > 1e-4) & (s + t < 1 - 1e-4)
        count[y[inside], x[inside]] += 1
        chart[y[inside], x[inside]] = label[face[0]] + 1
    return count, chart


def test_charts_keep_the_mesh(scene, charts):
    assert (charts.method, charts.reason) == ("xatlas", None)
    np.testing.assert_array_equal(charts.vertex_map[charts.faces], scene.faces)
    np.testing.assert_array_equal(charts.vertices, scene.vertices[charts.vertex_map])
    assert charts.vertices.dtype == charts.uv.dtype == np.float32
    assert charts.faces.dtype == charts.vertex_map.dtype == np.int32
    assert charts.uv.min() >= 0 and charts.uv.max() <= 1


def test_a_texel_is_about_a_pixel(scene, view_uv, charts):
    texels = np.abs(signed_areas(charts.uv.astype(float) * charts.size, charts.faces))
    pixels = np.abs(signed_areas(view_uv, scene.faces))
    assert texels.sum() == pytest.approx(pixels.sum(), rel=0.1)
    assert np.mean(np.abs(texels / pixels - 1) < 0.2) > 0.9
    assert np.prod(charts.size) < 3 * pixels.sum()


def test_charts_do_not_overlap_and_keep_apart(charts):
    count, chart = painted(charts)
    assert (count > 1).sum() <= 1e-3 * (count > 0).sum()
    assert len(np.unique(chart)) > 10
    for gap in range(1, 5):
        for one, other in ((chart[gap:], chart[:-gap]), (chart[:, gap:], chart[:, :-gap])):
            assert not ((one > 0) & (other > 0) & (one != other)).any()


def test_resolution_and_limit(view_uv, scene):
    half = unwrap(scene, view_uv, texels_per_pixel=0.5, time_limit_s=120)
    texels = np.abs(signed_areas(half.uv.astype(float) * half.size, half.faces)).sum()
    assert texels == pytest.approx(0.25 * np.abs(signed_areas(view_uv, scene.faces)).sum(), rel=0.1)
    for method in ("charts", "view"):
        small = unwrap(scene, view_uv, method=method, max_size=100, time_limit_s=120)
        assert max(small.size) <= 100, method


def test_view_coordinates_are_the_pixels(scene, view_uv):
    view = unwrap(scene, view_uv, method="view")
    assert (view.method, view.reason) == ("view", None)
    np.testing.assert_array_equal(view.faces, scene.faces)
    assert view.uv.min() > 0 and view.uv.max() < 1
    # Texel centres are at halves, pixel centres at whole numbers: they coincide, so that nothing gets blurred.
    offset = view.uv * view.size - 0.5 - view_uv
    np.testing.assert_allclose(offset, np.broadcast_to(np.rint(offset[0]), offset.shape), atol=1e-3)


def test_time_limit_gives_the_view_and_the_reason(scene, view_uv):
    start = time.monotonic()
    view = unwrap(scene, view_uv, time_limit_s=0.05)
    assert time.monotonic() - start < 5
    assert view.method == "view" and view.reason == "xatlas did not finish in 0.05 s"


def test_a_failing_process_gives_the_view_and_the_reason(tmp_path, monkeypatch):
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    coordinates = seen(surface.vertices)
    for source, reason in (
        ("import sys; sys.exit('out of luck')", "xatlas ended with status 1: out of luck"),
        ("import os; os.abort()", "xatlas ended with status -6: it said nothing"),
        ("print('no arrays')", "the answer of xatlas cannot be read"),
    ):
        worker = tmp_path / "worker.py"
        worker.write_text(source)
        monkeypatch.setattr(unwrap_module, "_WORKER", worker)
        view = unwrap(surface, coordinates)
        assert view.method == "view" and view.reason.startswith(reason)


def test_vertices_that_would_hang_xatlas_never_reach_it():
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    coordinates = seen(surface.vertices)
    vertices = surface.vertices.copy()
    vertices[7, 2] = np.inf
    view = unwrap(Surface(vertices=vertices, faces=surface.faces), coordinates)
    assert view.method == "view" and "not finite" in view.reason
    vertices[7, 2] = 1e30
    start = time.monotonic()
    unwrap(Surface(vertices=vertices, faces=surface.faces), coordinates, time_limit_s=5)
    assert time.monotonic() - start < 10


def test_a_script_without_a_main_guard_can_unwrap(tmp_path):
    """A child made by multiprocessing would run the whole script again."""
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np\n"
        "from stereo_gpu.types import Surface\n"
        "from stereo_gpu.unwrap import unwrap\n"
        "vertices = np.array([[0, 0, 9], [0, 4, 9], [4, 4, 9], [4, 0, 9]], np.float32)\n"
        "faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)\n"
        "print(unwrap(Surface(vertices=vertices, faces=faces), vertices[:, :2] * 10).method)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.returncode) == ("xatlas\n", 0), done.stderr


@pytest.mark.parametrize(
    "option", [{"method": "sphere"}, {"time_limit_s": 0}, {"texels_per_pixel": 0}, {"padding": -1}, {"max_size": 1}]
)
def test_options_out_of_range(scene, view_uv, option):
    with pytest.raises(InputError, match=next(iter(option))):
        unwrap(scene, view_uv, **option)


def test_what_cannot_be_unwrapped(scene, view_uv):
    with pytest.raises(InputError, match="view_uv"):
        unwrap(scene, view_uv[1:])
    with pytest.raises(InputError, match="view_uv"):
        unwrap(scene, view_uv * np.nan)
    with pytest.raises(StageError, match="without faces"):
        unwrap(Surface(vertices=scene.vertices, faces=scene.faces[:0]), view_uv)
