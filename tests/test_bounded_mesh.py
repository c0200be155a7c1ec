"""What the bounded mesh promises: its error at every pixel, no bridge, no gap, and no bad triangle."""

import json

import numpy as np
import pytest
from surfaces import BASELINE, CENTRE, FOCAL, normals, plane, signed_areas, triangulated

import stereo_gpu as sg
from stereo_gpu.backends import open_backend
from stereo_gpu.errors import StageError
from stereo_gpu.mesh import build_mesh
from stereo_gpu.meshing.bounded_mesh import LARGEST_SIDE, bounded_triangles
from stereo_gpu.meshing.cell_triangles import dense_triangles
from stereo_gpu.meshing.parts import covered_pixels, number_parts
from stereo_gpu.scene_render import render_pair

ERROR, JUMP = 0.25, 3.0
ROUNDED = 1e-4  # px, of float32 disparities up to some hundreds


def smallest_angles(points, faces):
    corner = points.astype(float)[faces]
    found = []
    for i in range(3):
        u, v = corner[:, i - 1] - corner[:, i], corner[:, i - 2] - corner[:, i]
        cosine = (u * v).sum(axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        found.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.min(found, axis=0)


def same_shapes(faces, width):
    """Triangles of one shape and size at a time: (N, 2) places of their first corners, and the (3, 2) corners."""
    places = np.stack([faces % width, faces // width], axis=-1)
    shapes = places - places[:, :1]
    kinds, which = np.unique(shapes.reshape(-1, 6), axis=0, return_inverse=True)
    for number, kind in enumerate(kinds):
        yield places[which.ravel() == number, 0], kind.reshape(3, 2)


def pixels_of(shape):
    """Pixels of a triangle with its border, (P, 2), and the weights of its corners there, (P, 3)."""
    low, high = shape.min(axis=0), shape.max(axis=0)
    x, y = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    matrix = np.vstack([shape.T, np.ones(3)])
    weights = np.linalg.solve(matrix, np.vstack([pixels.T, np.ones(len(pixels))])).T
    within = weights.min(axis=1) > -1e-9
    return pixels[within], weights[within]


def check(values, error_px=ERROR):
    """Hold a mesh of these values against every promise; returns its faces and which pixels it covers."""
    height, width = values.shape
    faces, settled = bounded_triangles(open_backend(), values, error_px=error_px, max_jump_px=JUMP)
    covered = np.zeros(values.shape, bool)
    owners = np.zeros((4, height, width), int)
    for first, shape in same_shapes(faces, width):
        # Isosceles with a right angle, and counter-clockwise as seen, with y down.
        legs = shape[1:]
        assert legs[0] @ legs[1] == 0 and legs[0] @ legs[0] == legs[1] @ legs[1] <= LARGEST_SIDE**2
        assert legs[0, 0] * legs[1, 1] - legs[0, 1] * legs[1, 0] < 0
        pixels, weights = pixels_of(shape)
        corner = settled[first[:, None, 1] + shape[:, 1], first[:, None, 0] + shape[:, 0]]
        x, y = first[:, None, 0] + pixels[:, 0], first[:, None, 1] + pixels[:, 1]
        off = np.abs(corner @ weights.T - values[y, x])
        assert off.max() <= error_px + ROUNDED  # NaN, a pixel without a value, fails too
        covered[y, x] = True
        local = {tuple(pixel): number for number, pixel in enumerate(pixels.tolist())}
        for step in ((1, 0), (0, 1)):
            pairs = [(n, local.get((p[0] + step[0], p[1] + step[1]))) for p, n in local.items()]
            pairs = np.array([pair for pair in pairs if pair[1] is not None])
            assert np.abs(values[y, x][:, pairs[:, 0]] - values[y, x][:, pairs[:, 1]]).max() <= JUMP
        # A place in each quarter of a cell, cut by its diagonals, lies in one triangle at most.
        cells = pixels[(pixels < shape.max(axis=0)).all(axis=1)]
        matrix = np.vstack([shape.T, np.ones(3)])
        for quarter, place in enumerate(((0.5, 0.2), (0.8, 0.5), (0.5, 0.8), (0.2, 0.5))):
            inside = np.linalg.solve(matrix, np.vstack([(cells + place).T, np.ones(len(cells))])).min(axis=0) > 0
            at = first[:, None, :] + cells[inside]
            np.add.at(owners[quarter], (at[..., 1], at[..., 0]), 1)
    assert owners.max() <= 1
    check_edges(faces, width)
    lost = np.isfinite(values) & ~covered
    return faces, covered, lost


def check_edges(faces, width):
    """Each edge has one triangle on either side at most, and none has a corner within."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    assert len(np.unique(start.astype(np.int64) * (1 << 31) + end)) == len(start)
    used = np.zeros(int(faces.max()) + 1, bool) if len(faces) else np.zeros(0, bool)
    used[faces.ravel()] = True
    x, y = np.stack([start % width, end % width]), np.stack([start // width, end // width])
    steps = np.maximum(abs(x[1] - x[0]), abs(y[1] - y[0]))
    for k in range(1, int(steps.max(initial=1))):
        long = steps > k
        between = start[long] + (end[long] - start[long]) // steps[long] * k
        assert not used[between].any()


def reached_by_all(values):
    """(H, W): pixels that a triangle of the full lattice reaches. A pixel that none does stands alone."""
    reached = np.zeros(values.size, bool)
    reached[dense_triangles(values, JUMP)] = True
    return reached.reshape(values.shape)


def noisy(height, width, seed=7):
    """A slope with a jump, noise, and holes of all sizes."""
    rng = np.random.default_rng(seed)
    y, x = np.indices((height, width))
    values = 40 + 0.05 * x + 0.11 * y + rng.normal(0, 0.12, (height, width))
    values[:, width // 3 :] += 9
    values[rng.random(values.shape) < 0.01] = np.nan
    values[height // 2 : height // 2 + 7, width // 2 :] = np.nan
    return values.astype(np.float32)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2), (3, 2), (33, 65), (65, 33), (100, 31), (479, 631)])
def test_promises_hold_at_any_size(shape):
    values = noisy(*shape)
    faces, covered, lost = check(values)
    assert (len(faces) > 0) == (min(shape) > 3)
    dense = reached_by_all(values)
    assert (lost & dense).mean() < 0.001
    assert not (covered & ~dense).any()


@pytest.mark.parametrize("error_px", [0.01, 0.1, 1.0])
def test_promises_hold_at_any_error(error_px):
    check(noisy(70, 90), error_px)


def test_a_plane_takes_two_triangles_a_square():
    y, x = np.indices((2 * LARGEST_SIDE + 1, 3 * LARGEST_SIDE + 1))
    values = (50 + 0.3 * x - 0.2 * y).astype(np.float32)
    faces, covered, _ = check(values)
    assert len(faces) == 2 * 2 * 3
    assert covered.all()


def test_no_value_and_one_value():
    values = np.full((70, 80), np.nan, np.float32)
    assert not len(check(values)[0])
    values[33, 44] = 20
    assert not len(check(values)[0])
    _, points = triangulated(np.full(values.shape, 900.0))
    with pytest.raises(StageError, match="none make a part that covers 150 pixels"):
        build_mesh(values, points)


def test_steps_at_every_pixel_leave_nothing():
    y, x = np.indices((40, 40))
    values = (20 + 50 * ((x + y) % 2)).astype(np.float32)
    faces, _, _ = check(values)
    assert not len(faces)


def test_the_border_runs_along_an_outline():
    """A disc before a wall: its border lies within a pixel of the true circle, and the two do not touch."""
    y, x = np.indices((150, 170))
    away = np.hypot(x - 80, y - 70)
    values = np.where(away <= 50, 60 + 0.1 * x, 30).astype(np.float32)
    faces, covered, lost = check(values)
    assert not lost.any() and covered.all()
    on_disc = (away <= 50).ravel()[faces]
    assert (on_disc.all(axis=1) | ~on_disc.any(axis=1)).all()
    edges = np.concatenate([faces[on_disc[:, 0]][:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    alone, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    border = alone[count == 1]
    assert (away.ravel()[border] > 49).all()
    # Halves of the border's edges, too: it does not cut across.
    middle = np.stack([border % 170, border // 170], axis=-1).mean(axis=1) - (80, 70)
    assert (np.linalg.norm(middle, axis=1) > 48.9).all()


def test_points_are_where_the_disparities_put_them():
    """Corners move along their lines of sight, with the principal points apart as well."""
    apart = 12.5
    values, points = triangulated(plane(60, 90))
    rng = np.random.default_rng(2)
    values = (values + rng.normal(0, 0.05, values.shape)).astype(np.float32)
    depth = FOCAL * BASELINE / values
    y, x = np.indices(values.shape)
    cx, cy = (values.shape[1] - 1) / 2, (values.shape[0] - 1) / 2
    points = np.stack([(x - cx) * depth / FOCAL + BASELINE, (y - cy) * depth / FOCAL, depth], axis=-1)
    shifted = (values + apart).astype(np.float32)
    surface = build_mesh(shifted, points.astype(np.float32), centre=CENTRE, infinity_px=apart)
    column = (surface.vertices[:, 0] - BASELINE) / surface.vertices[:, 2] * FOCAL + cx
    row = surface.vertices[:, 1] / surface.vertices[:, 2] * FOCAL + cy
    np.testing.assert_allclose(column, np.rint(column), atol=1e-3)
    np.testing.assert_allclose(row, np.rint(row), atol=1e-3)
    own = values[np.rint(row).astype(int), np.rint(column).astype(int)]
    now = FOCAL * BASELINE / surface.vertices[:, 2]
    assert np.abs(now - own).max() <= ERROR
    # Noise went: a corner lies on the plane of 25 pixels.
    true = triangulated(plane(60, 90))[0][np.rint(row).astype(int), np.rint(column).astype(int)]
    assert np.std(now - true) < 0.5 * np.std(own - true)


def test_a_map_of_whole_pixels_stays_in_one_piece():
    depth = np.tile(np.linspace(600, 900, 160)[:, None], (1, 120))
    values = np.rint(triangulated(depth)[0])
    _, points = triangulated(FOCAL * BASELINE / values)
    surface = build_mesh(values, points, centre=CENTRE, smallest_part=0.9 * depth.size)
    assert len(surface.faces) < depth.size / 2


def test_motorcycle_keeps_every_promise(data):
    folder = data / "stereo" / "motorcycle"
    calibration = json.loads((folder / "calib.json").read_text())
    with np.load(folder / "motorcycle_disp.npz") as file:
        truth = np.where(np.isfinite(file["arr_0"]), file["arr_0"], np.nan).astype(np.float32)
    faces, _, lost = check(truth)
    assert len(faces) < len(dense_triangles(truth, JUMP)) / 6
    # Lines one pixel wide and single pixels beside jumps, of which the truth has many.
    assert lost.sum() < 0.01 * np.isfinite(truth).sum()
    assert (lost & reached_by_all(truth)).sum() < 0.001 * np.isfinite(truth).sum()
    focal, cx, cy = calibration["focal_px"], calibration["cx0"], calibration["cy"]
    depth = calibration["baseline_mm"] * focal / (truth + calibration["doffs_px"])
    y, x = np.indices(truth.shape)
    points = np.stack([(x - cx) * depth / focal, (y - cy) * depth / focal, depth], axis=-1).astype(np.float32)
    surface = build_mesh(truth, points, infinity_px=-calibration["doffs_px"])
    assert np.percentile(smallest_angles(surface.vertices, surface.faces), 1) >= 10
    towards = -(normals(surface.vertices, surface.faces) * surface.vertices[surface.faces[:, 0]]).sum(axis=1)
    assert (towards > 0).all()


@pytest.fixture(scope="module")
def pair(small_scene):
    return sg.rectify(*render_pair(small_scene), small_scene.rig)


@pytest.mark.parametrize("profile", ["fast", "precise"])
def test_no_slivers_from_a_matched_map(pair, profile):
    """Noise of single pixels makes slivers in space of the smallest triangles, where nothing is done about it."""
    disparity = sg.match(pair.left, pair.right, disparities=(16, 40), profile=profile, mask=pair.valid_right)
    points = sg.triangulate(disparity, pair)
    centre, infinity_px = (pair.baseline, 0.0, 0.0), pair.cx_left - pair.cx_right
    surface = build_mesh(disparity.values, points, centre=centre, infinity_px=infinity_px)
    dense = build_mesh(disparity.values, points, centre=centre, method="dense")
    assert len(surface.faces) < len(dense.faces) / 5
    assert np.percentile(smallest_angles(surface.vertices, surface.faces), 1) >= 10
    towards = (normals(surface.vertices, surface.faces) * (centre - surface.vertices[surface.faces[:, 0]])).sum(axis=1)
    assert (towards > 0).all()
    # It covers what the dense mesh covers, seen from the camera.
    seen, every = covered_share(surface, pair), covered_share(dense, pair)
    assert abs(seen - every) < 0.01


def covered_share(surface, pair):
    local = surface.vertices.astype(float) - (pair.baseline, 0, 0)
    return -signed_areas(local[:, :2] / local[:, 2:] * pair.focal_px, surface.faces).sum() / pair.valid_right.sum()


def test_parts_are_those_that_a_search_finds():
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    values = noisy(90, 110)
    values[np.random.default_rng(4).random(values.shape) < 0.5] = np.nan
    values[40:80, 5:70] = 30
    faces, _ = bounded_triangles(open_backend(), values, error_px=1.0, max_jump_px=JUMP)
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    joined = coo_matrix((np.ones(len(pairs)), pairs.T), (values.size, values.size))
    want = connected_components(joined, directed=False)[1][faces[:, 0]]
    part = number_parts(faces, values.shape)
    count = len(np.unique(want))
    assert count > 10 and len(np.unique(part)) == count and len(np.unique(np.stack([part, want]), axis=1).T) == count
    assert covered_pixels(faces, values.shape).max() >= 64
