from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from mesh_measures import check_valid, smallest_angles, stray
from surfaces import BASELINE, CENTRE, FOCAL, ball, from_ball, plane, seen, signed_areas, triangulated

from stereo_gpu.decimate import decimate
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.evaluation.pairs import load_pair
from stereo_gpu.fairing import fair
from stereo_gpu.match import match
from stereo_gpu.mesh import build_mesh
from stereo_gpu.meshing.compare_surfaces import compare
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.types import Surface

FRAME = ViewFrame(FOCAL, BASELINE, CENTRE)


@pytest.fixture(scope="module")
def scene():
    return build_mesh(*triangulated(ball()), method="dense", centre=CENTRE)


def test_shape_borders_and_direction_stay(scene):
    small = decimate(scene, 2000, FRAME)
    assert 1800 < len(small.faces) <= 2000
    assert small.vertices.dtype == np.float32 and small.faces.dtype == np.int32
    assert len(np.unique(small.faces)) == len(small.vertices)
    check_valid(seen(small.vertices), small.faces)
    area = signed_areas(seen(small.vertices), small.faces)
    whole = signed_areas(seen(scene.vertices), scene.faces).sum()
    assert area.sum() == pytest.approx(whole, rel=0.005)  # borders are neither eaten nor bridged
    on_ball = small.vertices[:, 2] < 1200
    # Quadrics put corners outside of a ball, by about as much as its facets cut into it.
    np.testing.assert_allclose(from_ball(small.vertices[on_ball]), 100, atol=1.5)
    np.testing.assert_allclose(small.vertices[~on_ball][:, 2], 1500, atol=0.01)


def test_outlines_stay_where_they_are(scene):
    """The jump around the ball and the picture's edge, to a pixel, and mostly to a third of one."""
    small = decimate(scene, 2000, FRAME)
    before, after = seen(scene.vertices), seen(small.vertices)
    for off in (
        stray(after, small.faces, before, scene.faces),
        stray(before, scene.faces, after, small.faces),
    ):
        assert off.mean() < 0.2 and np.percentile(off, 95) < 0.5 and off.max() < 1


def test_plane_keeps_its_outline_down_to_few_triangles():
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    small = decimate(surface, 20, FRAME)
    assert len(small.faces) <= 20
    before, after = seen(surface.vertices), seen(small.vertices)
    np.testing.assert_allclose(after.min(axis=0), before.min(axis=0), atol=0.1)
    np.testing.assert_allclose(after.max(axis=0), before.max(axis=0), atol=0.1)
    whole = signed_areas(before, surface.faces).sum()
    assert signed_areas(after, small.faces).sum() == pytest.approx(whole, rel=0.005)


@pytest.mark.parametrize("profile", ["fast", "precise"])
def test_real_maps_make_valid_meshes(data, profile):
    """Motorcycle, with its many holes, jumps and thin parts, to a third of its triangles."""
    pair = load_pair(data, "motorcycle")
    rows = slice(150, 330)
    found = match(pair.left[rows], pair.right[rows], disparities=pair.search, profile=profile, reference="left")
    focal, baseline, offset = 994.978, 193.001, 31.086
    depth = focal * baseline / (found.values + offset)
    x, y = np.meshgrid(np.arange(depth.shape[1]), np.arange(depth.shape[0]))
    points = np.stack([x * depth / focal, y * depth / focal, depth], axis=-1).astype(np.float32)
    frame = ViewFrame(focal, baseline, (0.0, 0.0, 0.0))
    surface = fair(build_mesh(found.values, points, infinity_px=-offset), frame)
    small = decimate(surface, len(surface.faces) // 3, frame)
    assert 0.9 * len(surface.faces) // 3 < len(small.faces) <= len(surface.faces) // 3
    before, after = frame.see(surface.vertices)[:, :2], frame.see(small.vertices)[:, :2]
    check_valid(after, small.faces)
    angles = smallest_angles(small.vertices, small.faces)
    assert np.percentile(angles, 1) > 8 and np.median(angles) > 33
    off = stray(after, small.faces, before, surface.faces)
    assert off.mean() < 0.1 and np.percentile(off, 99) < 0.5


@pytest.mark.parametrize("error", [1.0, 3.0])
def test_the_surface_moves_by_no_more_than_the_error(scene, error):
    """Measured here from the vertices of each to the triangles of the other, in space."""
    import trimesh

    on_ball = scene.vertices[:, 2] < 1200
    part = Surface(vertices=scene.vertices, faces=scene.faces[on_ball[scene.faces].all(axis=1)])
    small = decimate(part, 0, FRAME, error=error)
    assert len(small.faces) < len(part.faces) / 3
    for one, other in ((part, small), (small, part)):
        of = trimesh.Trimesh(other.vertices, other.faces, process=False)
        _, off, _ = trimesh.proximity.closest_point_naive(of, one.vertices[np.unique(one.faces)][::19])
        assert off.max() <= error


@pytest.mark.parametrize("seed", range(6))
def test_riddled_maps_come_out_whole(seed):
    """Noise, a jump and holes everywhere, down to a few triangles; and an error that little can be done about."""
    rng = np.random.default_rng(seed)
    disparity = np.maximum(20 + rng.normal(0, 0.4, (30, 44)) + 5 * (np.arange(44) > 22), 1)
    disparity[rng.random((30, 44)) < 0.25] = np.nan
    surface = build_mesh(*triangulated(FOCAL * BASELINE / disparity), method="dense", smallest_part=0, centre=CENTRE)
    for count in (len(surface.faces) // 2, len(surface.faces) // 8, 20):
        small = decimate(surface, count, FRAME)
        assert 0 < len(small.faces) <= count
        check_valid(seen(small.vertices), small.faces)
    for error in (0.1, 1000.0):
        small = decimate(surface, 0, FRAME, error=error)
        check_valid(seen(small.vertices), small.faces)


def test_a_larger_error_leaves_fewer_triangles(scene):
    counts = [len(decimate(scene, 0, FRAME, error=error).faces) for error in (1.0, 4.0, 16.0)]
    assert counts[0] > counts[1] > counts[2]


def test_distance_of_surfaces_is_that_between_them():
    near, far = (build_mesh(*triangulated(np.full((40, 50), z)), method="dense", centre=CENTRE) for z in (900, 903.5))
    corners = [(FRAME.see(surface.vertices), surface.faces) for surface in (near, far)]
    apart, places = compare(*corners, FRAME)
    assert apart == pytest.approx(3.5, rel=5e-3)  # the lines of sight spread
    assert len(places) == 2 * 40 * 50
    assert compare(corners[0], corners[0], FRAME, enough=1e-4)[1].size == 0
    cut = near.faces[(FRAME.see(near.vertices)[:, 0] < 10)[near.faces].all(axis=1)]
    apart, places = compare(corners[0], (corners[0][0], cut), FRAME, enough=10.0)
    assert apart == np.inf and places[:, 0].min() > 10  # a part has nothing near it
    assert 500 < len(places) < 1000


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_unit_does_not_matter(scene, scale):
    scaled = Surface(vertices=scene.vertices * np.float32(scale), faces=scene.faces)
    small = decimate(scaled, 2000, ViewFrame(FOCAL, BASELINE * scale, (CENTRE[0] * scale, 0, 0)))
    same = decimate(scene, 2000, FRAME)
    assert abs(len(small.faces) - len(same.faces)) < 20
    on_ball = small.vertices[:, 2] < 1200 * scale
    np.testing.assert_allclose(from_ball(small.vertices[on_ball] / scale), 100, atol=1.5)


def test_threads_do_not_mix_their_meshes(scene):
    flat = build_mesh(*triangulated(plane(90, 90)), method="dense", centre=CENTRE)
    jobs = [scene, flat] * 3
    alone = [decimate(job, 3000, FRAME) for job in jobs[:2]] * 3
    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(lambda job: decimate(job, 3000, FRAME), jobs))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one.faces, other.faces)
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_small_meshes_stay_as_they_are(scene):
    assert decimate(scene, len(scene.faces), FRAME) is scene
    assert decimate(scene, 0, FRAME, error=1e-9) is scene


def test_what_cannot_be_decimated(scene):
    with pytest.raises(InputError, match="target_faces is 0"):
        decimate(scene, 0, FRAME)
    with pytest.raises(InputError, match="error is -1"):
        decimate(scene, 10, FRAME, error=-1)
    with pytest.raises(InputError, match="baseline 0"):
        ViewFrame(FOCAL, 0, CENTRE)
    broken = Surface(vertices=scene.vertices - np.float32(1e4), faces=scene.faces)
    with pytest.raises(StageError, match="not before the camera"):
        decimate(broken, 10, FRAME)
