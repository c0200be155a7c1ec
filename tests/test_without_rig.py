"""Reconstruction of a pair that has no rig, and what one known length does to its scale."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.cli import main
from stereo_gpu.errors import InputError
from stereo_gpu.scene_render import render_pair

DEPTH_SHARE = 0.04  # a turn of 0.1 degrees, half a pixel here, is 2 % of the scene's disparities
QUICK = {"profile": "fast", "mesh": sg.MeshOptions(faces=4000, unwrap="view")}


@pytest.fixture(scope="module")
def scene(small_scene):
    """The built-in scene, seen by two equal cameras whose lens has k1 alone and its axis in the middle."""
    matrix = np.array([[325.0, 0, 159.5], [0, 325, 119.5], [0, 0, 1]])
    camera = sg.Camera(matrix, np.array([-0.2, 0, 0, 0, 0]), (320, 240))
    return dataclasses.replace(small_scene, rig=dataclasses.replace(small_scene.rig, left=camera, right=camera))


@pytest.fixture(scope="module")
def pictures(scene):
    return render_pair(scene)


@pytest.fixture(scope="module")
def made(scene, pictures):
    focal = float(scene.rig.left.matrix[0, 0])
    return sg.reconstruct(*pictures, focal_px=focal, baseline=scene.rig.baseline, **QUICK)


def depth_at(result, rig, place):
    """Depth of a place in the raw right picture."""
    pair, camera = result.pair, rig.right
    matrix = np.array([[pair.focal_px, 0, pair.cx_right], [0, pair.focal_px, pair.cy], [0, 0, 1]])
    x, y = cv2.undistortPoints(
        np.array([[place]], np.float64), camera.matrix, camera.distortion, R=pair.rotation_right, P=matrix
    ).ravel()
    return float(np.nanmedian(result.points[round(y) - 3 : round(y) + 4, round(x) - 3 : round(x) + 4, 2]))


def test_depths_are_those_of_the_true_rig(scene, pictures, made):
    truth = sg.reconstruct(*pictures, scene.rig, **QUICK)
    places = [(x, y) for x in (80, 120, 160, 200) for y in (80, 120, 160)]
    ratios = [depth_at(made, made.found.rig, place) / depth_at(truth, scene.rig, place) for place in places]
    assert abs(np.median(ratios) - 1) < DEPTH_SHARE
    assert made.pair.unit == "mm" and made.pair.baseline == pytest.approx(scene.rig.baseline)
    assert len(made.warnings) == 1 and "made from" in made.warnings[0]


def test_without_anything_known_lengths_are_in_baselines_and_it_says_so(pictures, tmp_path):
    result = sg.reconstruct(*pictures, **QUICK)
    assert (result.pair.unit, result.pair.baseline) == ("baselines", pytest.approx(1))
    told = " ".join(result.warnings)
    assert "320 px, is guessed" in told and "--baseline or --distance" in told
    result.save(tmp_path)
    record = json.loads((tmp_path / "result.json").read_text("utf-8"))
    assert record["geometry"]["unit"] == "baselines"
    assert record["rig_from_pair"]["focal_source"].startswith("guessed")
    assert "Epipolar lines" in (tmp_path / "report.html").read_text("utf-8")


def test_a_known_distance_scales_all_that_comes_out(pictures, made):
    ends = (100.0, 100.0), (165.0, 130.0)
    lengths = []
    for length in (100.0, 250.0):
        distance = sg.KnownDistance(*ends, length)
        result = sg.reconstruct(*pictures, focal_px=made.found.focal.px, distance=distance, **QUICK)
        assert result.pair.unit == "mm"
        lengths.append((result.pair.baseline, float(np.nanmedian(result.points[..., 2])), np.ptp(result.mesh.vertices)))
    # Decimation breaks ties by rounding, so that the outermost vertex may be another one.
    assert (np.abs(np.array(lengths[1]) / lengths[0] - 2.5) < (1e-3, 1e-3, 0.05)).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"baseline": 0.0}, "above 0"),
        ({"baseline": float("nan")}, "above 0"),
        ({"focal_px": 3.0}, "focal length = 3 px"),
        ({"baseline": 100.0, "distance": sg.KnownDistance((1, 2), (3, 4), 5)}, "one sets the scale"),
        ({"distance": sg.KnownDistance((-50, 2), (150, 100), 5)}, "outside of the pictures of"),
    ],
)
def test_what_cannot_be_known_is_refused(pictures, options, words):
    with pytest.raises(InputError, match=words):
        sg.reconstruct(*pictures, **QUICK, **options)


def test_a_rig_says_its_own(scene, pictures):
    with pytest.raises(InputError, match="baseline is given beside a rig"):
        sg.reconstruct(*pictures, scene.rig, baseline=100.0, **QUICK)


def test_swapped_pictures_are_named(pictures):
    with pytest.raises(InputError, match="look swapped"):
        sg.reconstruct(*pictures[::-1], **QUICK)


def test_the_command_line_needs_no_rig(pictures, tmp_path, capsys):
    for name, picture in zip(("left", "right"), pictures, strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture[..., ::-1])
    files = [str(tmp_path / f"{name}.png") for name in ("left", "right")]
    command = ["reconstruct", *files, "--out", str(tmp_path / "out"), "--profile", "fast", "--unwrap", "view"]
    assert main([*command, "--distance", "100,100,165,130,120"]) == 0
    assert (tmp_path / "out" / "model.glb").exists()
    assert "guessed" in capsys.readouterr().err
    assert main([*command, "--distance", "200,200"]) == 2
    assert "5 numbers" in capsys.readouterr().err


def test_the_cup_needs_no_rig(data):
    folder = data / "rigs" / "cup" / "test_images"
    result = sg.reconstruct(folder / "leftPic.jpg", folder / "rightPic.jpg", **QUICK)
    assert result.found.matched.vertical_px < 0.5
    assert result.checked.vertical_px < 0.5
