"""The whole job on a small pair: what comes out, with every option, and what it is held against."""

import dataclasses
import hashlib
import json

import cv2
import numpy as np
import pytest
import trimesh

import stereo_gpu as sg
from stereo_gpu.advice import find_warnings
from stereo_gpu.errors import InputError, StageError
from stereo_gpu.pfm import read_pfm
from stereo_gpu.pipeline import STAGES
from stereo_gpu.rig_check import Verdict
from stereo_gpu.scene_truth import measure_surface
from stereo_gpu.texture import project
from stereo_gpu.types import Validity

QUICK = {"profile": "fast", "disparities": (20, 44), "mesh": sg.MeshOptions(faces=4000, unwrap="view")}
DEPTH_PERCENT = 0.5  # median at 320 x 240, where a pixel of disparity is 2.5 % of the depth
COVERAGE = 0.95
BOX = (30, 30, 205, 155)  # around the two objects


@pytest.fixture(scope="module")
def pictures(raw_folder):
    return sg.read_image(raw_folder / "left.png"), sg.read_image(raw_folder / "right.png")


@pytest.fixture(scope="module")
def made(small_scene, raw_folder):
    """One reconstruction from files."""
    stages, shown, after = [], {}, {}

    def show(name, thing):
        shown[name] = thing
        after[name] = stages[-1]

    result = sg.reconstruct(
        raw_folder / "left.png",
        str(raw_folder / "right.png"),
        small_scene.rig,
        profile="fast",
        mesh=sg.MeshOptions(faces=4000),
        progress=stages.append,
        show=show,
    )
    assert tuple(stages) == STAGES
    # Each thing is handed over as soon as it is there, and is what the result holds.
    assert after == {
        "pair": "rectify",
        "wanted": "mask",
        "disparity": "close",
        "points": "triangulate",
        "surface": "mesh",
        "smoothed": "decimate",
        "mesh": "texture",
    }
    assert shown.pop("wanted") is result.mask
    assert all(thing is getattr(result, name) for name, thing in shown.items())
    return result


def test_the_surface_is_where_it_should_be(small_scene, made):
    error = measure_surface(small_scene, made.pair, made.points, vertices=made.mesh.vertices)
    assert error["depth_median_percent"] < DEPTH_PERCENT
    assert error["coverage"] > COVERAGE
    assert error["mesh_median_mm"] < 2.0


def test_range_was_found(small_scene, made):
    smallest, count = made.options["disparities"]
    good = made.disparity.values[made.disparity.validity == 0]
    assert made.options["disparities_found"] is True
    assert 0 <= smallest < np.percentile(good, 0.1) and np.percentile(good, 99.9) < smallest + count
    assert count < 120
    assert made.warnings == []


def test_every_file_is_there_and_can_be_loaded(made, raw_folder, tmp_path):
    written = made.save(tmp_path / "new" / "out")
    assert sorted(path.name for path in written) == sorted(path.name for path in (tmp_path / "new" / "out").iterdir())
    out = tmp_path / "new" / "out"
    scene = trimesh.load(out / "model.glb")
    (model,) = scene.geometry.values()
    assert len(model.faces) == len(made.mesh.faces)
    depth = np.median(made.mesh.vertices[:, 2])
    assert np.median(-model.vertices[:, 2]) == pytest.approx(depth / 1000, rel=1e-3)  # metres, z to the viewer
    assert len(trimesh.load(out / "model.obj", process=False).faces) == len(made.mesh.faces)
    assert len(trimesh.load(out / "cloud.ply").vertices) == np.isfinite(made.points[..., 2]).sum()
    np.testing.assert_array_equal(read_pfm(out / "disparity.pfm"), made.disparity.values)
    assert cv2.imread(str(out / "disparity.png")).shape[0] >= 240
    assert b"VTKFile" in (out / "surface.vtp").read_bytes()[:200]
    page = (out / "report.html").read_text("utf-8")
    for shown in (
        "Originals",
        "Check",
        "Rectified",
        "Masked",
        "Disparity",
        "Cloud",
        "Mesh",
        "Smoothed",
        "Textured",
        "Turned",
        "srcdoc",
    ):
        assert shown in page
    record = json.loads((out / "result.json").read_text())
    assert record["inputs"]["left"] == {
        "name": "left.png",
        "sha256": hashlib.sha256((raw_folder / "left.png").read_bytes()).hexdigest(),
    }
    assert record["package"].startswith("stereo-gpu ")
    assert record["backend"] == made.disparity.backend and record["device"] == made.disparity.device
    assert set(STAGES) <= set(record["seconds"])
    assert record["counts"]["triangles"] == len(made.mesh.faces)
    assert record["counts"]["with_disparity"] == np.isfinite(made.disparity.values).sum()
    assert record["options"]["profile"] == "fast" and record["options"]["reference"] == "right"
    assert record["options"]["mesh.unwrap_used"] == "xatlas"
    assert record["geometry"]["baseline"] == pytest.approx(100.0, abs=0.1) and record["geometry"]["unit"] == "mm"
    assert record["vertical_px"] < 0.5
    assert record["check"]["verdict"] == "good" and record["check"]["vertical_px"] == record["vertical_px"]
    assert record["warnings"] == []


def test_saving_again_replaces_and_keeps_what_is_not_ours(made, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "result.json").write_text("old")
    made.save(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert json.loads((tmp_path / "result.json").read_text())["options"]


def test_a_failing_save_leaves_all_as_it_was(made, tmp_path):
    (tmp_path / "result.json").mkdir()
    (tmp_path / "model.glb").write_text("old")
    with pytest.raises(InputError, match=r"result\.json: it is a folder"):
        made.save(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["model.glb", "result.json"]
    assert (tmp_path / "model.glb").read_text() == "old"
    unknown = dataclasses.replace(made, mesh=dataclasses.replace(made.mesh, unit="cubit"))
    with pytest.raises(InputError, match="cubit"):
        unknown.save(tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()


def test_both_references_make_the_same_surface(small_scene, pictures):
    errors = {}
    for reference in ("left", "right"):
        result = sg.reconstruct(*pictures, small_scene.rig, reference=reference, **QUICK)
        assert result.disparity.reference == reference
        errors[reference] = measure_surface(small_scene, result.pair, result.points, reference=reference)
        assert errors[reference]["depth_median_percent"] < DEPTH_PERCENT
        assert errors[reference]["coverage"] > COVERAGE
        # Colours come from the view of reference: the texture is a cut-out of it.
        assert result.picture is (result.pair.left if reference == "left" else result.pair.right)


def test_a_rectified_pair_gives_the_same_as_its_raw_one(small_scene, pictures):
    raw = sg.reconstruct(*pictures, small_scene.rig, **QUICK)
    result = sg.reconstruct_rectified(raw.pair, **QUICK)
    np.testing.assert_array_equal(result.disparity.values, raw.disparity.values)
    np.testing.assert_array_equal(result.mesh.vertices, raw.mesh.vertices)
    np.testing.assert_array_equal(result.mesh.texture, raw.mesh.texture)
    assert result.raw_left is raw.pair.left
    assert "rectify" not in result.seconds


def test_depth_cuts_the_wall_away(small_scene, pictures):
    result = sg.reconstruct(*pictures, small_scene.rig, depth=(600, 950), **QUICK)
    depths = result.points[..., 2][np.isfinite(result.points[..., 2])]
    assert depths.min() >= 600 and depths.max() <= 950
    assert result.options["depth"] == (600, 950)
    assert (result.disparity.validity & sg.Validity.MASKED).any()
    with pytest.raises(InputError, match="points were found from"):
        sg.reconstruct(*pictures, small_scene.rig, depth=(1, 2), **QUICK)


def test_rectangle_cuts_the_objects_out(small_scene, pictures):
    result = sg.reconstruct(*pictures, small_scene.rig, rectangle=BOX, **QUICK)
    x, y, width, height = BOX
    outside = result.mask.copy()
    outside[y : y + height, x : x + width] = 0
    assert not outside.any()
    assert not np.isfinite(result.disparity.values[result.mask == 0]).any()
    error = measure_surface(small_scene, result.pair, result.points)
    assert error["coverage"] > COVERAGE


def test_mask_leaves_the_rest_out(small_scene, pictures):
    mask = np.zeros((240, 320), np.uint8)
    mask[60:180, 40:200] = 255
    result = sg.reconstruct(*pictures, small_scene.rig, mask=mask, **QUICK)
    assert not np.isfinite(result.disparity.values[mask == 0]).any()
    assert np.isfinite(result.disparity.values[mask != 0]).mean() > 0.9
    assert len(result.options["mask"]) == 64
    with pytest.raises(InputError, match=r"mask has shape \(100, 320\)"):
        sg.reconstruct(*pictures, small_scene.rig, mask=mask[:100], **QUICK)
    with pytest.raises(InputError, match="leaves no pixel"):
        sg.reconstruct(*pictures, small_scene.rig, mask=mask * 0, **QUICK)


def test_grey_and_16_bit_pictures(small_scene, pictures):
    eight = sg.reconstruct(*(p[..., 1].copy() for p in pictures), small_scene.rig, **QUICK)
    deep = sg.reconstruct(*(p[..., 1].astype(np.uint16) * 16 for p in pictures), small_scene.rig, **QUICK)
    for result in (eight, deep):
        assert result.mesh.texture.dtype == np.uint8 and result.mesh.texture.shape[2] == 3
        assert measure_surface(small_scene, result.pair, result.points)["depth_median_percent"] < DEPTH_PERCENT
    assert deep.mesh.texture.max() > 128
    # The cloud is as bright as the model: by the raw picture, whatever part of it is left when it is rectified.
    dim = dataclasses.replace(deep, pair=dataclasses.replace(deep.pair, right=deep.pair.right // 2))
    assert np.median(np.abs(dim._colours() - deep._colours() / 2)) <= 1  # what was saturated is so no more
    mesh = deep.mesh
    column, row = (mesh.uv * mesh.texture.shape[1::-1]).astype(int).T
    x, y, _ = project(mesh.vertices, deep.pair, deep.disparity.reference).round().astype(int).T
    assert np.median(np.abs(deep._colours()[y, x] - mesh.texture[row, column].astype(int))) <= 1


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ({"profile": "best"}, "profile = 'best'"),
        ({"reference": "up"}, "reference = 'up'"),
        ({"window": 8}, "window = 8"),
        ({"disparities": (3, 0)}, "empty range"),
        ({"disparities": "all"}, "disparities = 'all'"),
        ({"depth": (5, 5)}, "depth = 5,5"),
        ({"depth": (float("nan"), 5)}, "depth = nan,5"),
        ({"rectangle": (0, 0, 999, 9)}, "rectangle"),
        ({"mesh": sg.MeshOptions(faces=-1)}, "faces = -1"),
        ({"mesh": sg.MeshOptions(max_jump_px=float("nan"))}, "max_jump_px = nan"),
        ({"mesh": sg.MeshOptions(smoothing=10**9)}, "smoothing"),
        ({"mesh": sg.MeshOptions(unwrap="origami")}, "unwrap = 'origami'"),
        ({"mesh": sg.MeshOptions(unwrap_seconds=0)}, "unwrap_seconds = 0"),
    ],
)
def test_wrong_options(small_scene, pictures, option, says):
    with pytest.raises(InputError, match=says):
        sg.reconstruct(*pictures, small_scene.rig, **option)


def test_wrong_pictures(small_scene, pictures, tmp_path):
    left, right = pictures
    for pair, says in (
        ((tmp_path / "no.png", right), "no such file"),
        ((left[:-1], right), "320 x 239"),
        ((left[..., 0], right), "grey"),
        ((left.astype(np.float32), right), "float32"),
        ((left[:, :200], right[:, :200]), "calibrated for 320 x 240"),
        ((right, left), "swapped"),
    ):
        with pytest.raises(InputError, match=says):
            sg.reconstruct(*pair, small_scene.rig, **QUICK)


def test_a_unit_that_no_model_can_have_is_refused_before_any_work(small_scene, pictures):
    stages = []
    with pytest.raises(InputError, match="'furlong' of a model: its rig must have one of mm"):
        sg.reconstruct(*pictures, dataclasses.replace(small_scene.rig, unit="furlong"), progress=stages.append, **QUICK)
    assert stages == ["read", "rig"]


def test_a_rig_that_does_not_fit_warns_and_then_is_refused(small_scene, pictures):
    rigs = {}
    for degrees in (0.2, 0.6):
        turn = cv2.Rodrigues(np.array([np.radians(degrees), 0, 0]))[0]
        rigs[degrees] = dataclasses.replace(small_scene.rig, R=turn @ small_scene.rig.R, T=turn @ small_scene.rig.T)
    doubtful = sg.reconstruct(*pictures, rigs[0.2], **QUICK)
    assert 0.5 < doubtful.checked.vertical_px <= 2 and doubtful.checked.verdict is Verdict.DOUBTFUL
    assert any("shifted down by" in told and "--refine" in told for told in doubtful.warnings)
    with pytest.raises(InputError, match=r"rows differ by 3\.\d\d px .* shifted down by 3\.\d px .* --ignore-check"):
        sg.reconstruct(*pictures, rigs[0.6], **QUICK)
    forced = sg.reconstruct(*pictures, rigs[0.6], ignore_check=True, **QUICK)
    assert forced.checked.verdict is Verdict.BAD and any("shifted down by 3" in told for told in forced.warnings)
    refined = sg.refine_rig(*pictures, rigs[0.6]).rig
    assert sg.reconstruct(*pictures, refined, **QUICK).warnings == []


def test_few_features_warn_and_go_on(small_scene, pictures):
    """A pair of which only a patch has texture: the check says that it knows nothing, and matching goes on."""
    blank = []
    for picture, start in zip(pictures, (120, 90), strict=True):
        only = np.full_like(picture, 128)
        only[100:124, start : start + 40] = picture[100:124, start : start + 40]
        blank.append(only)
    result = sg.reconstruct(*blank, small_scene.rig, **QUICK)
    assert result.checked.verdict is Verdict.UNKNOWN
    assert result.record()["check"]["verdict"] == "unknown" and result.record()["vertical_px"] is None
    assert any("Nothing can be said of the rig" in told for told in result.warnings)


def test_nothing_to_make_a_mesh_of(small_scene):
    flat = np.full((240, 320), 90, np.uint8)
    for profile in ("fast", "precise"):
        with pytest.raises(StageError, match="no mesh"):
            sg.reconstruct(flat, flat, small_scene.rig, **{**QUICK, "profile": profile})


def test_precise_is_nearer_to_the_truth_than_fast(small_scene, pictures):
    errors = {}
    for profile in ("fast", "precise"):
        result = sg.reconstruct(*pictures, small_scene.rig, **{**QUICK, "profile": profile})
        errors[profile] = measure_surface(small_scene, result.pair, result.points)
    assert errors["precise"]["surface_median_mm"] < errors["fast"]["surface_median_mm"]
    assert errors["precise"]["coverage"] > COVERAGE


def test_warnings_say_what_is_wrong(made):
    well = made.checked
    assert well.verdict is Verdict.GOOD
    assert find_warnings(well, made.disparity, None) == []
    told = dataclasses.replace(well, verdict=Verdict.DOUBTFUL, says="rows differ by 1.50 px")
    assert find_warnings(told, made.disparity, None) == ["Rows differ by 1.50 px."]
    tight = dataclasses.replace(made.disparity, smallest=34, disparities=8)
    low, high = find_warnings(well, tight, None)
    assert "at the smallest one" in low and "at the largest one" in high
    sparse = dataclasses.replace(
        made.disparity, values=np.where(made.disparity.values > 45, made.disparity.values, np.nan)
    )
    assert any("of the wanted pixels have a disparity" in told for told in find_warnings(well, sparse, None))
    validity = made.disparity.validity.copy()
    validity[::2] |= np.uint8(Validity.FILLED | Validity.OCCLUDED)
    filled = dataclasses.replace(made.disparity, validity=validity, values=np.nan_to_num(made.disparity.values, nan=40))
    assert any("of the wanted pixels were measured" in told for told in find_warnings(well, filled, None))


def test_motorcycle_in_millimetres(data):
    folder = data / "stereo" / "motorcycle"
    known = json.loads((folder / "calib.json").read_text())
    left, right = (sg.read_image(folder / f"motorcycle_{side}.png") for side in ("left", "right"))
    pair = sg.RectifiedPair.from_geometry(
        left,
        right,
        focal_px=known["focal_px"],
        baseline=known["baseline_mm"],
        cx_left=known["cx0"],
        cx_right=known["cx0"] + known["doffs_px"],
        cy=known["cy"],
    )
    result = sg.reconstruct_rectified(pair, profile="fast", reference="left", mesh=sg.MeshOptions(faces=20_000))
    true = np.load(folder / "motorcycle_disp.npz")["arr_0"]
    depth = known["baseline_mm"] * known["focal_px"] / (true + known["doffs_px"])
    both = np.isfinite(true) & np.isfinite(result.points[..., 2])
    assert both.sum() > 0.9 * np.isfinite(true).sum()
    assert np.median(np.abs(result.points[..., 2][both] / depth[both] - 1)) < 0.004
    # A mesh in mm, in front of the camera, where the scene is: 2.1 to 5 m away.
    assert len(result.mesh.faces) > 15_000
    low, high = np.percentile(result.mesh.vertices[:, 2], [1, 99])
    assert 2000 < low < high < 5200


def test_numpy_numbers_and_open_depths_are_recorded(small_scene, pictures, tmp_path):
    options = {
        **QUICK,
        "window": np.int64(7),
        "disparities": tuple(np.array([20, 60])),
        "depth": (np.float32(10), np.inf),
    }
    sg.reconstruct(*pictures, small_scene.rig, **options).save(tmp_path / "out")
    record = json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))
    assert record["options"]["depth"] == [10.0, None]
    assert record["options"]["disparities"] == [20, 60]
    assert record["options"]["window"] == 7
