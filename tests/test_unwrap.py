import time
import tracemalloc

import numpy as np
import pytest
from surfaces import CENTRE, ball, plane, seen, signed_areas, triangulated

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.mesh import build_mesh
from stereo_gpu.types import Surface
from stereo_gpu.unwrap import unwrap
from stereo_gpu.unwrapping.pack import find_cells
from stereo_gpu.unwrapping.parts import parts

SHIFT = (50.0, 40.0)
METHODS = ("charts", "view")
OFF_ANY_SIDE = (0.137, 0.289)


@pytest.fixture(scope="module")
def scene():
    """A ball before a wall, 15,000 triangles in two pieces."""
    return build_mesh(*triangulated(ball(81, 101, radius=70.0)), method="dense", centre=CENTRE)


@pytest.fixture(scope="module")
def view_uv(scene):
    return seen(scene.vertices, shift=SHIFT)


@pytest.fixture(scope="module", autouse=True)
def small_tiles():
    """So that there are several, with seams between them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stereo_gpu.unwrapping.charts._FACES_PER_TILE", 4000)
        yield


@pytest.fixture(scope="module")
def charts(scene, view_uv):
    return unwrap(scene, view_uv)


@pytest.fixture(scope="module")
def owner(charts):
    return painted(charts)[1]


@pytest.fixture(scope="module")
def corners():
    """Two squares of 40 px in opposite corners of a picture of 600 x 400, at places between the pixels."""
    x, y = np.meshgrid(np.arange(0, 41, 4), np.arange(0, 41, 4))
    square = np.column_stack([x.ravel(), y.ravel()]) + 0.3
    first = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    faces = np.concatenate([first[:, None] + [0, 11, 1], first[:, None] + [1, 11, 12]])
    flat = np.concatenate([square, square + np.array([559, 359])])
    vertices = np.column_stack([flat, np.full(len(flat), 900.0)])
    surface = Surface(vertices=vertices.astype(np.float32), faces=np.concatenate([faces, faces + 121]).astype(np.int32))
    return surface, flat


def texels(unwrapped):
    return unwrapped.uv.astype(float) * unwrapped.size - 0.5


def painted(unwrapped, fine=1, at=(0.0, 0.0)):
    """Two pictures, `fine` times the atlas: how many triangles hold each point, and the chart that does (0 = none).

    Points are `at` beside the texels' centres; those on the sides of triangles count for each of them.
    """
    width, height = unwrapped.size
    chart = parts(unwrapped.faces, len(unwrapped.vertices)) + 1
    count, owner = np.zeros((height * fine, width * fine), int), np.zeros((height * fine, width * fine), int)
    shared = np.zeros_like(count)
    for (a, b, c), own in zip((texels(unwrapped)[unwrapped.faces] - at) * fine, chart, strict=True):
        p, q = b - a, c - a
        area = p[0] * q[1] - p[1] * q[0]
        if abs(area) < 1e-9:
            continue
        low, high = np.ceil(np.min((a, b, c), axis=0)).astype(int), np.floor(np.max((a, b, c), axis=0)).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        s = ((x - a[0]) * q[1] - (y - a[1]) * q[0]) / area
        t = (p[0] * (y - a[1]) - p[1] * (x - a[0])) / area
        inside = (s >= -1e-6) & (t >= -1e-6) & (s + t <= 1 + 1e-6)
        x, y = x[inside], y[inside]
        count[y, x] += 1
        shared[y, x] += (owner[y, x] > 0) & (owner[y, x] != own)
        owner[y, x] = own
    assert not shared.any(), "a texel belongs to two charts"
    return count, owner


def narrowest_gap(owner):
    """Texels between charts, and from charts to the edge of the atlas; at most 12 are told apart."""
    for gap in range(12):
        reach = gap + 1
        framed = np.pad(owner, reach, constant_values=-1)
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                near = framed[reach + dy :, reach + dx :][: owner.shape[0], : owner.shape[1]]
                if ((owner > 0) & (near != 0) & (near != owner)).any():
                    return gap
    return 12


def test_charts_keep_the_mesh_and_the_order_of_its_faces(scene, charts):
    assert (charts.method, charts.reason) == ("xatlas", None)
    np.testing.assert_array_equal(charts.vertex_map[charts.faces], scene.faces)
    np.testing.assert_array_equal(charts.vertices, scene.vertices[charts.vertex_map])
    assert charts.vertices.dtype == charts.uv.dtype == np.float32
    assert charts.faces.dtype == charts.vertex_map.dtype == np.int32
    assert charts.uv.min() >= 0 and charts.uv.max() <= 1
    assert charts.charts == parts(charts.faces, len(charts.vertices)).max() + 1 > 4


def test_every_triangle_has_as_many_texels_as_the_view_has_pixels_there(scene, view_uv, charts):
    got = np.abs(signed_areas(texels(charts), charts.faces))
    wanted = np.abs(signed_areas(view_uv, scene.faces))
    np.testing.assert_allclose(got, wanted, rtol=1e-3, atol=1e-3)


def test_half_of_the_atlas_is_in_use(scene, view_uv):
    """At a size at which the gutters around a ring and a disk hardly count."""
    fine = unwrap(scene, view_uv, texels_per_pixel=6)
    assert fine.charts > 4
    assert 36 * np.abs(signed_areas(view_uv, scene.faces)).sum() > 0.5 * np.prod(fine.size)


def test_charts_are_the_view_shifted_by_whole_texels(view_uv, charts):
    """So that baking copies the picture, where it would otherwise blur it."""
    offset = texels(charts) - view_uv[charts.vertex_map]
    np.testing.assert_allclose(offset, np.rint(offset), atol=1e-3)
    chart = np.empty(len(offset), int)
    chart[charts.faces] = parts(charts.faces, len(offset))[:, None]
    for number in range(charts.charts):
        assert np.ptp(np.rint(offset[chart == number]), axis=0).max() == 0


def test_charts_keep_apart_by_the_padding(scene, view_uv, owner):
    assert narrowest_gap(owner) >= 4
    _, wide = painted(unwrap(scene, view_uv, padding=7))
    assert narrowest_gap(wide) >= 7


def test_a_cell_of_four_texels_belongs_to_one_chart(owner):
    """So does a texel of the second mip level."""
    high, wide = (size // 4 for size in owner.shape)
    cells = owner[: high * 4, : wide * 4].reshape(high, 4, wide, 4).transpose(0, 2, 1, 3).reshape(-1, 16)
    largest = cells.max(axis=1, keepdims=True)
    assert ((cells == 0) | (cells == largest)).all() and (cells > 0).any()


@pytest.mark.parametrize("method", METHODS)
def test_coordinates_are_one_to_one(scene, view_uv, method):
    """Points that lie on no side of a triangle have one triangle at most, four to a texel."""
    count, _ = painted(unwrap(scene, view_uv, method=method), fine=2, at=OFF_ANY_SIDE)
    assert count.max() == 1
    assert count.sum() == pytest.approx(4 * np.abs(signed_areas(view_uv, scene.faces)).sum(), rel=0.01)


def test_faces_that_turn_their_back_get_a_chart_of_their_own():
    """A strip that is folded over itself, as the view sees it."""
    x = np.array([0.0, 40.0, 20.0])
    view = np.array([(column, row) for column in x for row in (0.0, 30.0)]) + 5.3
    vertices = np.column_stack([view, np.repeat([900.0, 900.0, 880.0], 2)]).astype(np.float32)
    faces = np.array([[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]], np.int32)
    unwrapped = unwrap(Surface(vertices=vertices, faces=faces), view)
    assert unwrapped.charts == 2
    count, _ = painted(unwrapped, fine=2, at=OFF_ANY_SIDE)
    assert count.max() == 1


@pytest.mark.parametrize("method", METHODS)
def test_resolution_and_limit(view_uv, scene, method):
    half = unwrap(scene, view_uv, texels_per_pixel=0.5, method=method)
    got = np.abs(signed_areas(texels(half), half.faces)).sum()
    assert got == pytest.approx(0.25 * np.abs(signed_areas(view_uv, scene.faces)).sum(), rel=1e-3)
    small = unwrap(scene, view_uv, method=method, max_size=100)
    assert half.reason is None and half.texels_per_pixel == 0.5
    assert 80 < max(small.size) <= 100
    assert small.reason == f"{small.texels_per_pixel:.2g} texels a pixel, to be no larger than 100"
    got = np.abs(signed_areas(texels(small), small.faces)) / np.abs(signed_areas(view_uv, scene.faces))
    np.testing.assert_allclose(got, got.mean(), rtol=0.02)


def test_view_coordinates_are_the_pixels(scene, view_uv):
    view = unwrap(scene, view_uv, method="view")
    assert (view.method, view.reason) == ("view", None)
    np.testing.assert_array_equal(view.faces, scene.faces)
    assert view.uv.min() > 0 and view.uv.max() < 1
    # Texel centres are at halves, pixel centres at whole numbers: they coincide, so that nothing gets blurred.
    offset = texels(view) - view_uv
    np.testing.assert_allclose(offset, np.broadcast_to(np.rint(offset[0]), offset.shape), atol=1e-3)


def test_parts_far_apart_on_the_view_do_not_waste_the_atlas(corners):
    surface, view = corners
    unwrapped = unwrap(surface, view, method="view")
    assert (unwrapped.method, unwrapped.reason, unwrapped.charts) == ("view", None, 2)
    np.testing.assert_array_equal(unwrapped.faces, surface.faces)
    assert np.prod(unwrapped.size) < 3 * 2 * 40**2
    offset = texels(unwrapped) - view
    np.testing.assert_allclose(offset, np.rint(offset), atol=1e-3)
    count, owner = painted(unwrapped)
    assert count.max() >= 1 and narrowest_gap(owner) >= 4


def test_vertices_that_no_face_uses_do_no_harm(corners):
    surface, view = corners
    more = Surface(vertices=np.concatenate([surface.vertices, surface.vertices[:1] + 7]), faces=surface.faces)
    for method in METHODS:
        unwrapped = unwrap(more, np.concatenate([view, view[:1] + 300.5]), method=method)
        np.testing.assert_array_equal(unwrapped.vertex_map[unwrapped.faces], surface.faces)
        assert unwrapped.uv.min() >= 0 and unwrapped.uv.max() <= 1


def test_time_limit_gives_the_view_and_the_reason(scene, view_uv):
    start = time.monotonic()
    view = unwrap(scene, view_uv, time_limit_s=0.001)
    assert time.monotonic() - start < 5
    assert view.method == "view"
    assert view.reason == "the view's own coordinates instead of charts: xatlas did not finish in 0.001 s"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("far", [1e7, 1e30])
def test_a_vertex_far_outside_of_the_picture_ends_in_time(method, far):
    """xatlas hangs on coordinates so large that its grids overflow."""
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    coordinates = seen(surface.vertices)
    coordinates[7, 0] = far
    start = time.monotonic()
    unwrapped = unwrap(surface, coordinates, method=method, time_limit_s=4, max_size=1024)
    assert time.monotonic() - start < 10
    assert max(unwrapped.size) <= 1024 and 0 <= unwrapped.uv.min() <= unwrapped.uv.max() <= 1
    np.testing.assert_array_equal(unwrapped.vertex_map[unwrapped.faces], surface.faces)


@pytest.mark.parametrize(
    "option",
    [
        {"method": "sphere"},
        {"time_limit_s": 0},
        {"time_limit_s": np.inf},
        {"texels_per_pixel": 0},
        {"padding": -1},
        {"max_size": 20},
    ],
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


def test_a_large_picture_has_no_more_cells_than_a_small_one(scene, view_uv):
    chart = parts(scene.faces, len(scene.vertices))
    small, large = (find_cells(view_uv * scale, scene.faces, chart) for scale in (1, 64))
    assert small.side == 4 and large.side == 32
    assert len(large.touched) < 1.2 * 40_000
    middles = ((view_uv * 64)[scene.faces].mean(axis=1) - large.corner[chart]) // 32
    at = large.base[chart] + middles[:, 1] * (large.extent[chart, 0] + 1) + middles[:, 0]
    assert np.isin(at, large.touched).all()


def test_the_cells_are_those_that_a_triangle_touches():
    random = np.random.default_rng(3)
    corners = random.uniform(0, 90, (3, 2))
    cells = find_cells(corners, np.array([[0, 1, 2]]), np.zeros(1, int), padding=0)
    _, column, row = cells.places()
    touched = np.zeros((30, 30), bool)
    touched[row, column] = True
    # Points of the triangle, each in its own cell.
    shares = random.dirichlet((1, 1, 1), 200_000)
    at = ((shares @ corners - cells.corner[0]) // cells.side).astype(int)
    held = np.zeros((30, 30), bool)
    held[at[:, 1], at[:, 0]] = True
    assert touched[held].all()
    assert touched.sum() <= held.sum() + 2  # the tips of it


def test_slivers_that_lie_askew_have_no_more_cells_than_they_touch():
    count = 1000
    first = np.column_stack([np.arange(count) * 0.5, np.zeros(count)])
    vertices = np.concatenate([first, first + np.array([1500, 1500]), first + np.array([1500.3, 1500])])
    faces = np.arange(3 * count).reshape(3, count).T
    tracemalloc.start()
    cells = find_cells(vertices, faces, np.zeros(count, int))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(cells.touched) < 100_000
    assert peak < 2e8  # of their rectangles it was 10 GB
