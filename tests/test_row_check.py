"""The quick check of a rig finds it good only where it is, and the pipeline goes on to the full one where not."""

import dataclasses

import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import InputError
from stereo_gpu.rig_check import Verdict
from stereo_gpu.row_check import GOOD_PX, check_rows
from stereo_gpu.scene import project

RANGE = (16, 44)
QUICK = {"profile": "fast", "disparities": RANGE, "mesh": MeshOptions(faces=2000, unwrap="view")}


@pytest.fixture(scope="module")
def raw(raw_folder):
    return tuple(sg.read_image(raw_folder / f"{side}.png") for side in ("left", "right"))


def turned(rig, degrees):
    """The rig whose right camera is believed to look lower than it does."""
    turn = cv2.Rodrigues(np.radians([degrees, 0, 0]))[0]
    return dataclasses.replace(rig, R=turn @ rig.R, T=turn @ rig.T)


def rows(raw, rig, reference="right", swap=False):
    left, right = raw[::-1] if swap else raw
    pair = sg.rectify(left, right, rig)
    return check_rows(
        pair, sg.match(pair.left, pair.right, disparities=RANGE, profile="fast", reference=reference), rig
    )


@pytest.mark.parametrize("reference", ["left", "right"])
def test_a_good_rig_is_good(raw, small_scene, reference):
    checked = rows(raw, small_scene.rig, reference)
    assert checked.verdict is Verdict.GOOD and "the rig is good" in checked.says
    assert checked.vertical_px < 0.15 and abs(checked.bias_px) < 0.05
    assert checked.matches > 50 and len(checked.vertical) >= 0.75 * checked.matches
    assert checked.record()["vertical_px"] == checked.vertical_px


@pytest.mark.parametrize("reference", ["left", "right"])
def test_the_error_has_the_sign_and_size_of_the_full_check(raw, small_scene, reference):
    bad = turned(small_scene.rig, 0.15)
    checked, full = rows(raw, bad, reference), sg.check_rig(*raw, bad)
    assert checked.verdict is Verdict.UNKNOWN and "check_rig" in checked.says
    assert checked.vertical_px > GOOD_PX
    assert np.sign(checked.bias_px) == np.sign(full.bias_px)
    # What does not lie on one row is not matched well, so that the map hides some of it.
    assert 0.4 < checked.bias_px / full.bias_px < 1.1


@pytest.mark.parametrize("degrees", [0.2, 0.5, 2.0])
def test_no_wrong_rig_is_good(raw, small_scene, degrees):
    assert rows(raw, turned(small_scene.rig, degrees)).verdict is Verdict.UNKNOWN


def test_swapped_pictures_and_pictures_of_nothing_are_not_good(raw, small_scene):
    assert rows(raw, small_scene.rig, swap=True).verdict is Verdict.UNKNOWN
    blank = np.full_like(raw[0], 128)
    checked = rows((blank, blank), small_scene.rig)
    assert checked.verdict is Verdict.UNKNOWN and checked.matches == 0


def test_places_are_told_in_the_raw_pictures(raw, small_scene):
    checked, rig = rows(raw, small_scene.rig), small_scene.rig
    # Both raw places must come from one point in space: triangulated, it lies where both cameras see it.
    rays = [
        cv2.undistortPoints(points[:, None], camera.matrix, camera.distortion)[:, 0].T
        for points, camera in ((checked.points_left, rig.left), (checked.points_right, rig.right))
    ]
    space = cv2.triangulatePoints(np.eye(3, 4), np.column_stack([rig.R, rig.T]), *rays)
    points = (space[:3] / space[3]).T
    off = np.linalg.norm(project(rig.left, points) - checked.points_left, axis=1)
    assert np.median(off) < 0.2 and 300 < np.median(points[:, 2]) < 1200


def test_the_pipeline_checks_rows_and_then_in_full_where_they_are_not_good(raw, small_scene):
    result = sg.reconstruct(*raw, small_scene.rig, check="rows", **QUICK)
    assert "places of the map" in result.checked.says and result.checked.verdict is Verdict.GOOD
    assert not result.warnings and result.options["check"] == "rows"
    with pytest.raises(InputError, match="rows differ by"):
        sg.reconstruct(*raw, turned(small_scene.rig, 1.0), check="rows", **QUICK)
    told = sg.reconstruct(*raw, turned(small_scene.rig, 0.3), check="rows", ignore_check=True, **QUICK)
    assert "features" in told.checked.says and any("Rows differ by" in warning for warning in told.warnings)


def test_a_check_that_was_not_made_is_told(raw, small_scene):
    result = sg.reconstruct(*raw, small_scene.rig, check="never", **QUICK)
    assert result.checked.verdict is Verdict.UNKNOWN and "check" not in result.seconds
    assert any("was not checked" in warning for warning in result.warnings)
    with pytest.raises(InputError, match="check = 'perhaps': give full, rows or never"):
        sg.reconstruct(*raw, small_scene.rig, check="perhaps", **QUICK)
