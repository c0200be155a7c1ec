import numpy as np
import pytest
from mesh_measures import check_valid, outline
from surfaces import BASELINE, CENTRE, FOCAL, ball, from_ball, normals, plane, seen, signed_areas, triangulated

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.fairing import fair
from stereo_gpu.mesh import build_mesh
from stereo_gpu.meshing.outline import smooth_outline
from stereo_gpu.meshing.view_frame import ViewFrame
from stereo_gpu.types import Surface

FRAME = ViewFrame(FOCAL, BASELINE, CENTRE)


@pytest.fixture(scope="module")
def cap():
    """The front of a ball, at steps of about 2 mm."""
    depth = ball(wall=np.nan)
    depth[depth > 860] = np.nan  # no steep rim, where a pixel's noise is larger than its triangles
    return build_mesh(*triangulated(depth), method="dense", centre=CENTRE)


def noisy(surface, size, seed=1):
    """Noise of the disparity, px: along the line of sight."""
    seen = FRAME.see(surface.vertices)
    seen[:, 2] += np.random.default_rng(seed).normal(0, size, len(seen))
    return Surface(vertices=FRAME.place(seen), faces=surface.faces)


def roughness(surface):
    """Mean angle between a face and a ball's surface under it, degrees."""
    middle = surface.vertices[surface.faces].mean(axis=1) - (*CENTRE[:2], 900)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    cosine = (normals(surface.vertices, surface.faces) * middle).sum(axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()


def test_noise_goes_and_the_radius_stays(cap):
    rough = noisy(cap, 0.05)
    smooth = fair(rough, FRAME, iterations=20)
    assert roughness(smooth) < roughness(rough) / 4
    assert from_ball(smooth.vertices).mean() == pytest.approx(100, abs=0.1)
    assert from_ball(smooth.vertices).std() < from_ball(rough.vertices).std() / 2
    np.testing.assert_array_equal(smooth.faces, rough.faces)


def test_size_stays_over_many_iterations(cap):
    smooth = fair(cap, FRAME, iterations=200)
    before, after = (np.ptp(s.vertices, axis=0) for s in (cap, smooth))
    np.testing.assert_allclose(after, before, rtol=0.03)
    assert from_ball(smooth.vertices).mean() == pytest.approx(100, abs=0.5)


def test_plane_stays_flat_and_keeps_its_border():
    surface = build_mesh(*triangulated(plane()), method="dense", centre=CENTRE)
    smooth = fair(surface, FRAME, iterations=10)
    direction = normals(surface.vertices, surface.faces).mean(axis=0)
    np.testing.assert_allclose(smooth.vertices @ direction, surface.vertices @ direction, atol=0.01)
    areas = [signed_areas(seen(s.vertices), s.faces).sum() for s in (surface, smooth)]
    assert areas[1] == pytest.approx(areas[0], rel=1e-3)


def test_steps_and_creases_stay():
    """A roof with a step of a pixel in one of its sides, and noise of a twentieth."""
    x, _ = np.meshgrid(np.arange(61.0), np.arange(41.0))
    disparity = 30 - 0.15 * np.abs(x - 30) + (x > 45)
    depth = FOCAL * BASELINE / disparity
    surface = build_mesh(*triangulated(depth), method="dense", min_angle_deg=0, centre=CENTRE)
    rough = noisy(surface, 0.05)
    true = FRAME.see(surface.vertices)
    column = np.rint(true[:, 0] + 30)

    def off(mesh, where=slice(None)):
        return np.abs(FRAME.see(mesh.vertices)[:, 2] - true[:, 2])[where].mean()

    smooth, blunt = fair(rough, FRAME), fair(rough, FRAME, noise_px=100.0)
    assert off(smooth) < 0.6 * off(rough)
    step = (column == 45) | (column == 46)
    assert off(smooth, step) < 0.075  # of a pixel
    assert off(smooth, step) < 0.5 * off(blunt, step)
    assert off(smooth, column == 30) < 0.075  # half of what the ridge rises over its neighbours


def test_vertices_move_along_their_lines_of_sight(cap):
    rough = noisy(cap, 0.1)
    smooth = fair(rough, FRAME, outline_px=0.0)
    before, after = FRAME.see(rough.vertices), FRAME.see(smooth.vertices)
    np.testing.assert_allclose(after[:, :2], before[:, :2], atol=1e-3)
    assert np.abs(after[:, 2] - before[:, 2]).max() <= 0.25 + 1e-3
    assert np.abs(after[:, 2] - before[:, 2]).mean() > 0.02


def test_each_value_is_that_of_a_weighted_plane():
    """One half pass without edges to keep, against numpy's least squares for every vertex."""
    from stereo_gpu import fairing

    surface = build_mesh(*triangulated(plane(7, 9)), method="dense", smallest_part=0, centre=CENTRE)
    corners = FRAME.see(noisy(surface, 0.3).vertices)
    edges, _ = fairing.find_edges(surface.faces, len(corners))
    weights, slopes = fairing._weigh(corners, edges, 0.2)
    matrix, tilt = fairing._expectation(corners, weights, slopes)
    found = matrix @ corners[:, 2] + tilt
    dense = weights.toarray()
    for vertex in range(len(corners)):
        near = np.flatnonzero(dense[vertex])
        root = np.sqrt(dense[vertex, near])
        away = corners[near, :2] - corners[vertex, :2]
        # Off the vertex's own slope, with a little of the neighbours' distance against slopes across their row.
        values = corners[near, 2] - away @ slopes[vertex]
        middle = (dense[vertex, near, None] * away).sum(axis=0) / dense[vertex, near].sum()
        ridge = fairing._RIDGE * (dense[vertex, near] * (away**2).sum(axis=1)).sum()
        terms = np.column_stack([np.ones(len(near)), away - middle]) * root[:, None]
        terms = np.vstack([terms, [0, np.sqrt(ridge), 0], [0, 0, np.sqrt(ridge)]])
        level, *slope = np.linalg.lstsq(terms, np.append(values * root, [0, 0]), rcond=None)[0]
        assert found[vertex] == pytest.approx(level - middle @ slope, abs=1e-4)


def test_steps_of_pixels_leave_the_outline_and_corners_stay():
    """A leaning band: its sides are straight afterwards, to a tenth of a pixel, and its ends are where they were."""
    x, y = np.meshgrid(np.arange(60), np.arange(80))
    depth = np.where((x > 10 + y / 3) & (x < 30 + y / 3), 900.0, np.nan)
    surface = build_mesh(*triangulated(depth), method="dense", centre=CENTRE)
    smooth = fair(surface, FRAME)
    before, after = seen(surface.vertices), seen(smooth.vertices)
    rows = before[:, 1] + 39.5
    border = np.unique(outline(surface.faces))
    side = border[(rows[border] > 8) & (rows[border] < 71)]
    off = [p[side, 0] - p[side, 1] / 3 for p in (before, after)]
    jagged, straight = (np.concatenate([o[o < 0] - o[o < 0].mean(), o[o > 0] - o[o > 0].mean()]).std() for o in off)
    assert straight < 0.4 * jagged
    np.testing.assert_allclose(after.min(axis=0), before.min(axis=0), atol=0.3)
    np.testing.assert_allclose(after.max(axis=0), before.max(axis=0), atol=0.3)
    check_valid(after, smooth.faces)


def test_no_triangle_turns_its_back(cap):
    rough = noisy(cap, 0.1)
    smooth = fair(rough, FRAME, iterations=10)
    assert (signed_areas(seen(smooth.vertices), smooth.faces) < 0).all()


def test_an_outline_that_would_fold_stays():
    """Two thin triangles at a notch: moving its tip by a pixel would turn one over."""
    places = np.array([[0, 0], [10, 0], [5.0, 0.4], [5.0, 8.0]])
    faces = np.array([[0, 2, 3], [2, 1, 3]], np.int32)[:, ::-1].copy()
    border = np.array([[0, 2], [1, 2], [1, 3], [0, 3]])
    moved = smooth_outline(places, faces, border, 10, 0.1, 1.0)
    a, b, c = (moved[faces[:, i]] for i in range(3))
    p, q = b - a, c - a
    assert (p[:, 1] * q[:, 0] - p[:, 0] * q[:, 1] > 0).all()


def test_a_lone_triangle_and_no_iterations(cap):
    assert fair(cap, FRAME, iterations=0) is cap
    lone = Surface(vertices=np.eye(3, dtype=np.float32) + 5, faces=np.array([[0, 1, 2]], np.int32))
    assert np.isfinite(fair(lone, ViewFrame(FOCAL, BASELINE, (0.0, 0.0, 0.0))).vertices).all()


@pytest.mark.parametrize(
    "option", [{"iterations": -1}, {"pass_band": 1.0}, {"noise_px": 0.0}, {"furthest_px": -1.0}, {"outline_px": np.nan}]
)
def test_options_out_of_range(cap, option):
    with pytest.raises(InputError, match=next(iter(option))):
        fair(cap, FRAME, **option)


def test_what_is_behind_the_camera(cap):
    with pytest.raises(StageError, match="not before the camera"):
        fair(Surface(vertices=-cap.vertices, faces=cap.faces), FRAME)
