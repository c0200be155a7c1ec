"""Meshes against the truth, with the bars that docs/accuracy.md's section on meshes is held to."""

import numpy as np
import pytest
from surfaces import BASELINE, CENTRE, FOCAL, plane, triangulated

from stereo_gpu.backends import open_backend
from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import InputError
from stereo_gpu.evaluation.cup import cup_rig, plane_residual, wall_residual
from stereo_gpu.evaluation.mesh_tables import cup_errors, cup_table, mesh_table, pair_errors
from stereo_gpu.evaluation.meshes import (
    BOUNDED,
    DECIMATED,
    DENSE,
    SMOOTHED,
    depth_map,
    measure_on_scene,
    mesh_steps,
)
from stereo_gpu.mesh import build_mesh
from stereo_gpu.pipeline import reconstruct
from stereo_gpu.types import RectifiedPair, View


@pytest.mark.parametrize("profile", ["fast", "precise"])
def test_no_step_leaves_the_scene(small_scene, raw_folder, profile):
    """At 320 x 240; a quarter of a pixel of disparity is twice as much there as in the page's tables."""
    bare = MeshOptions(faces=0, smoothing=0, unwrap="view")
    pictures = raw_folder / "left.png", raw_folder / "right.png"
    result = reconstruct(*pictures, small_scene.rig, profile=profile, disparities=(20, 36), mesh=bare)
    errors = measure_on_scene(mesh_steps(open_backend(None), result), result, small_scene)
    dense, bounded = errors[DENSE], errors[BOUNDED]
    assert bounded.mean <= 1.1 * dense.mean
    for name in (SMOOTHED, DECIMATED):
        assert errors[name].mean <= 1.03 * bounded.mean
        assert errors[name].nearest <= 1.06 * bounded.nearest
        assert errors[name].coverage > bounded.coverage - 0.015
    assert errors[SMOOTHED].median < dense.median


def test_no_step_leaves_motorcycle(data):
    errors = pair_errors(data, "fast", None)
    for name, each in errors.items():
        assert each.mean <= 1.03 * errors[DENSE].mean, name
        assert each.inliers <= 1.03 * errors[DENSE].inliers, name
    assert errors[SMOOTHED].median < errors[BOUNDED].median < errors[DENSE].median
    assert errors[DECIMATED].faces <= 20_000 < errors[BOUNDED].faces < errors[DENSE].faces / 5


def test_the_table_gets_no_rougher_and_the_cup_rounder(data):
    errors = cup_errors(data, "precise", None)
    for name, each in errors.items():
        assert each.table <= 1.05 * errors[DENSE].table < 0.5, name
    assert errors[SMOOTHED].wall < errors[BOUNDED].wall < errors[DENSE].wall < 1
    assert errors[DECIMATED].wall < 0.9 * errors[DENSE].wall


def test_depth_is_the_mesh_s_at_each_pixel():
    depth = plane()
    surface = build_mesh(*triangulated(depth), method="dense", centre=CENTRE)
    height, width = depth.shape
    black = np.zeros((height, width), np.uint8)
    pair = RectifiedPair.from_geometry(
        black,
        black,
        focal_px=FOCAL,
        baseline=BASELINE,
        cx_left=(width - 1) / 2,
        cx_right=(width - 1) / 2,
        cy=(height - 1) / 2,
    )
    np.testing.assert_allclose(depth_map(surface, pair, View.RIGHT), depth, rtol=1e-5)


def test_residuals_are_those_that_were_put_in():
    rng = np.random.default_rng(2)
    angle, along = rng.uniform(-1.2, 1.2, 3000), rng.uniform(-30, 30, 3000)
    off = rng.normal(0, 0.5, 3000)
    radius = 58 + 0.2 * along - 0.004 * along**2 + off
    wall = np.column_stack([radius * np.sin(angle), along, 400 - radius * np.cos(angle)])
    assert wall_residual(wall) == pytest.approx(0.5, rel=0.05)
    flat = np.column_stack([rng.uniform(-50, 50, (3000, 2)), off])
    tilted = flat @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    assert plane_residual(tilted) == pytest.approx(0.5, rel=0.05)


def test_tables_say_what_was_measured(data):
    from stereo_gpu.evaluation.cup import CupErrors
    from stereo_gpu.evaluation.meshes import MeshErrors

    each = MeshErrors(faces=12345, coverage=0.5, mean=1, median=2, p95=3, inliers=4, nearest=5)
    assert mesh_table("t", {"dense": each})[-1] == "| dense | 12,345 | 50.00 % | 1.00 | 2.00 | 3.00 | 4.00 | 5.00 |"
    assert cup_table("t", {"dense": CupErrors(faces=7, table=0.25, wall=1)})[-1] == "| dense | 7 | 0.25 | 1.00 |"


def test_a_missing_rig_is_named(tmp_path):
    with pytest.raises(InputError, match=r"published_opencv\.yml is missing: set STEREO_GPU_DATA"):
        cup_rig(tmp_path)
