import json

import numpy as np
import pytest
from surfaces import BASELINE, CENTRE, FOCAL, ball, normals, plane, seen, signed_areas, triangulated

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.mesh import build_mesh


def build(depth, **options):
    return build_mesh(*triangulated(depth), method="dense", centre=CENTRE, **options)


def dense(values, points, smallest_part=0, **options):
    return build_mesh(values, points, method="dense", min_angle_deg=0, smallest_part=smallest_part, **options)


def grid(values):
    """A disparity map of these few values, with points at a fixed depth so that only the values matter."""
    values = np.array(values, np.float32)
    _, points = triangulated(np.full(values.shape, 500.0))
    return values, points


def test_plane_is_one_sheet_that_faces_the_cameras():
    surface = build(plane(41, 63))
    assert surface.vertices.dtype == np.float32 and surface.faces.dtype == np.int32
    assert surface.vertices.shape == (41 * 63, 3)
    assert surface.faces.shape == (2 * 40 * 62, 3)
    # Counter-clockwise as seen: negative with y down, and each triangle is half a pixel.
    np.testing.assert_allclose(signed_areas(seen(surface.vertices), surface.faces), -0.5, atol=1e-2)
    normal = normals(surface.vertices, surface.faces)
    assert (normal[:, 2] < 0).all()
    assert (normal @ normal[0] > 0.999).all()


def test_no_triangle_joins_the_ball_to_the_wall():
    surface = build(ball(), min_angle_deg=0)
    depth = surface.vertices[surface.faces][..., 2]
    on_wall = depth > 1400
    assert (on_wall.all(axis=1) | ~on_wall.any(axis=1)).all()
    assert on_wall.any() and not on_wall.all()


def test_the_diagonal_with_the_smaller_step_is_taken():
    values, points = grid([[10.0, 10.9], [9.5, 10.1]])
    falling = dense(values, points).faces
    assert all({0, 3} <= set(face) for face in falling.tolist())
    rising = dense(values[:, ::-1], points).faces
    assert all({1, 2} <= set(face) for face in rising.tolist())


@pytest.mark.parametrize("missing", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_three_corners_make_one_triangle(missing):
    values, points = grid([[10.0, 10.0], [10.0, 10.0]])
    values[missing] = np.nan
    surface = dense(values, points)
    assert surface.faces.shape == (1, 3) and surface.vertices.shape == (3, 3)
    assert normals(surface.vertices, surface.faces)[0, 2] < 0


def test_one_value_apart_leaves_the_other_three_joined():
    values, points = grid([[10.0, 10.0], [10.0, 20.0]])
    assert len(dense(values, points).vertices) == 3


def test_crumbs_go_and_pieces_stay():
    depth = plane(40, 60)
    hole = np.full(depth.shape, np.nan)
    hole[2:12, 2:12] = depth[2:12, 2:12]  # covers 9 x 9 px, 162 triangles
    hole[20:24, 20:24] = depth[20:24, 20:24]  # 3 x 3 px, 18
    assert len(build(hole, smallest_part=9).faces) == 180
    assert len(build(hole, smallest_part=9.5).faces) == 162
    with pytest.raises(StageError, match="none make a part that covers 82 pixels"):
        build(hole, smallest_part=82)


def test_a_crumb_that_hangs_by_a_corner_goes():
    values, points = grid(np.full((30, 40), np.nan))
    values[2:15, 2:15] = 8  # 12 x 12 px
    values[14:17, 14:17] = 12  # 2 x 2, from the other one's last corner on; no triangle joins 8 and 12
    values[14, 14] = 10
    assert len(dense(values, points).faces) == 2 * (12 * 12 + 2 * 2)
    surface = dense(values, points, smallest_part=5)
    assert len(surface.faces) == 2 * 12 * 12


def test_pieces_are_those_that_a_search_finds():
    rng = np.random.default_rng(3)
    values, points = grid(rng.uniform(10, 13, (23, 31)))
    values[rng.random(values.shape) < 0.2] = np.nan
    every = dense(values, points, max_jump_px=1.5)
    # Plain search: give faces that share a side the lower number of both until nothing changes.
    label = np.arange(len(every.faces))
    owners = {}
    for number, face in enumerate(every.faces.tolist()):
        for side in ((0, 1), (1, 2), (2, 0)):
            owners.setdefault(frozenset(face[i] for i in side), []).append(number)
    while True:
        before = label.copy()
        for numbers in owners.values():
            label[numbers] = label[numbers].min()
        if (before == label).all():
            break
    sizes = np.bincount(label)
    assert len(np.unique(label)) > 5
    for least in (2, 5, 20):
        kept = dense(values, points, max_jump_px=1.5, smallest_part=least / 2)  # a triangle covers half a pixel
        assert len(kept.faces) == sizes[sizes >= least].sum()


def test_points_without_meaning_are_left_out():
    depth = plane(40, 60)
    values, points = triangulated(depth)
    points[5, 5, 2] = 1e7
    points[9, 9, 2] = -800
    points[13, 13, 0] = np.inf
    values[17, 17] = np.inf
    surface = build_mesh(values, points, method="dense", centre=CENTRE)
    assert len(surface.vertices) == depth.size - 4
    assert np.isfinite(surface.vertices).all() and np.abs(surface.vertices).max() < 2000


def test_slivers_seen_edge_on_are_dropped():
    depth = plane(40, 60, tilt=0)
    depth[:, 30:] = np.maximum(depth[:, 30:] - 60 * np.arange(30), 300)  # steep: 60 mm in about 2 mm
    steep = build(depth, max_jump_px=100, min_angle_deg=5, smallest_part=0)
    loose = build(depth, max_jump_px=100, min_angle_deg=0, smallest_part=0)
    assert len(loose.faces) == 2 * 39 * 59
    cosine = np.abs(normals(steep.vertices, steep.faces)[:, 2])
    assert len(steep.faces) < len(loose.faces) and cosine.min() > np.sin(np.radians(4))


def profile(*steps):
    """Disparities that are constant along columns, with these steps between the middle ones; and their points.

    One px a pixel is seen at 3.7 degrees here, 0.4 at 9.2 and 0.25 at 14.6.
    """
    values = np.full((40, 60), 26.0, np.float32)
    for number, step in enumerate(steps):
        values[:, 30 - len(steps) // 2 + number :] += step
    return triangulated(FOCAL * BASELINE / values.astype(float))


def columns_without_faces(surface):
    """How many of the 59 columns of cells are empty."""
    column = np.rint(seen(surface.vertices)[:, 0] + 29.5).astype(int)
    return 59 - len(np.unique(column[surface.faces].min(axis=1)))


@pytest.mark.parametrize("method", ["dense", "bounded"])
def test_a_step_goes_with_its_flanks(method):
    def build(*steps):
        return build_mesh(*profile(*steps), method=method, error_px=0.01, centre=CENTRE)

    assert columns_without_faces(build(0.4, 0.4, 0.4)) == 0
    assert columns_without_faces(build(0.4, 1.2, 0.4)) == 3
    assert columns_without_faces(build(0.25, 1.2, 0.25)) == 1
    # As a whole the surface leans by more than half a pixel: its steepest faces go alone.
    lean = [0.6] * 50
    assert columns_without_faces(build(*lean)) == 0
    lean[25] = 2.0
    assert columns_without_faces(build(*lean)) == 1


@pytest.mark.parametrize(
    "option",
    [{"method": "sparse"}, {"error_px": 0}, {"max_jump_px": 0}, {"min_angle_deg": 90}, {"farthest": 0.5}],
)
def test_options_out_of_range(option):
    with pytest.raises(InputError, match=next(iter(option))):
        build_mesh(*triangulated(plane()), centre=CENTRE, **option)


def test_nothing_to_mesh():
    values, points = triangulated(plane())
    with pytest.raises(StageError, match="widen the disparity range or the mask"):
        build_mesh(np.full_like(values, np.nan), points)
    with pytest.raises(InputError, match="do not fit"):
        build_mesh(values[1:], points)


def test_motorcycle_in_millimetres(data):
    """Middlebury's truth, meshed with a sixth of the triangles, is still that truth."""
    folder = data / "stereo" / "motorcycle"
    calibration = json.loads((folder / "calib.json").read_text())
    focal, cx, cy = calibration["focal_px"], calibration["cx0"], calibration["cy"]
    with np.load(folder / "motorcycle_disp.npz") as file:
        truth = np.where(np.isfinite(file["arr_0"]), file["arr_0"], np.nan).astype(np.float32)
    depth = calibration["baseline_mm"] * focal / (truth + calibration["doffs_px"])
    x, y = np.meshgrid(np.arange(truth.shape[1]), np.arange(truth.shape[0]))
    points = np.stack([(x - cx) * depth / focal, (y - cy) * depth / focal, depth], axis=-1).astype(np.float32)
    dense = build_mesh(truth, points, method="dense")
    surface = build_mesh(truth, points, infinity_px=-calibration["doffs_px"])
    assert len(surface.faces) < len(dense.faces) / 6
    column, row = (surface.vertices[:, i] / surface.vertices[:, 2] * focal + c for i, c in ((0, cx), (1, cy)))
    np.testing.assert_allclose(column, np.rint(column), atol=1e-3)
    true = depth[np.rint(row).astype(int), np.rint(column).astype(int)]
    step = true**2 / (calibration["baseline_mm"] * focal)  # mm for a pixel of disparity
    assert (np.abs(surface.vertices[:, 2] - true) < 0.26 * step).all()
    assert np.median(np.abs(surface.vertices[:, 2] / true - 1)) < 0.001
    assert surface.vertices[:, 2].min() > 1500 and surface.vertices[:, 2].max() < 10_000
