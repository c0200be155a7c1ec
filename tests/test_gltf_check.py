"""Every GLB passes the Khronos validator without an error or a warning."""

import dataclasses
import json
import shutil
import struct
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import missing

import stereo_gpu as sg
from stereo_gpu.cli import main
from stereo_gpu.config import MeshOptions
from stereo_gpu.errors import InputError
from stereo_gpu.export import write_glb
from stereo_gpu.types import Mesh

TOOLS = Path(__file__).parents[1] / "tools"
FORMATS = ("png", "jpeg", "webp")


@pytest.fixture(scope="module")
def validate():
    """Status and words of the validator for files."""
    node = shutil.which("node")
    if node is None or not (TOOLS.parent / ".gltf_check" / "node_modules" / "gltf-validator").is_dir():
        missing("gltf-validator", "not here; run tools/gltf_check --install")

    def run(*paths):
        script = TOOLS / "gltf_check.mjs"
        done = subprocess.run([node, script, *paths], capture_output=True, text=True, timeout=100)
        return done.returncode, done.stdout + done.stderr

    return run


@pytest.fixture(scope="module")
def result(raw_folder):
    return sg.reconstruct(
        raw_folder / "left.png",
        raw_folder / "right.png",
        sg.Rig.load(raw_folder / "rig.json"),
        profile="fast",
        disparities=(16, 40),
        mesh=MeshOptions(faces=3000, smoothing=0, unwrap="view"),
    )


def test_models_of_a_pair_are_clean_in_every_format(result, validate, tmp_path):
    paths = [result.write_glb(tmp_path / f"{form}.glb", texture_format=form) for form in FORMATS]
    status, said = validate(*paths)
    assert status == 0, said
    assert said.count(": 0 errors, 0 warnings") == len(FORMATS), said
    assert "hint" not in said


def test_meshes_of_other_sizes_are_clean(validate, tmp_path):
    # 65,536 vertices are one too many for 16 bits; a single triangle and a texture of one texel are the least.
    x, y = np.meshgrid(np.arange(256), np.arange(256))
    corner = (x + 256 * y)[:-1, :-1].ravel()
    large = Mesh(
        vertices=np.stack([x, y, 500 + np.sin(x)], axis=2).reshape(-1, 3).astype(np.float32),
        faces=np.stack([corner, corner + 256, corner + 257], axis=1).astype(np.int32),
        uv=np.stack([x / 255, y / 255], axis=2).reshape(-1, 2).astype(np.float32),
        texture=np.zeros((8, 8, 3), np.uint8),
    )
    small = dataclasses.replace(
        large,
        vertices=large.vertices[:258],
        faces=large.faces[:1],
        uv=large.uv[:258],
        texture=np.zeros((1, 1, 3), np.uint8),
        unit="baselines",
    )
    status, said = validate(write_glb(tmp_path / "large.glb", large), write_glb(tmp_path / "small.glb", small))
    assert status == 0, said


def test_the_check_fails_on_what_is_wrong(result, validate, tmp_path):
    good = result.write_glb(tmp_path / "good.glb").read_bytes()
    (length,) = struct.unpack_from("<I", good, 12)
    document = json.loads(good[20 : 20 + length])
    document["accessors"][1]["max"][0] += 1  # an error: bounds that are not the vertices'
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    rest = good[20 + length :]
    bad = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest
    (tmp_path / "bad.glb").write_bytes(bad)
    status, said = validate(tmp_path / "good.glb", tmp_path / "bad.glb")
    assert status == 1 and "ACCESSOR_MAX_MISMATCH" in said
    assert validate(tmp_path / "none.glb")[0] == 1


def test_no_file_is_no_success(validate):
    done = subprocess.run([TOOLS / "gltf_check"], capture_output=True, text=True, timeout=100)
    assert done.returncode == 2 and "usage: tools/gltf_check" in done.stderr


def test_the_camera_sees_what_the_picture_shows(result, tmp_path):
    """Every vertex of the model, seen by the file's camera as glTF says, falls where the right picture has it."""
    path = result.write_glb(tmp_path / "model.glb")
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + length])
    node = next(node for node in document["nodes"] if "camera" in node)
    lens = document["cameras"][node["camera"]]["perspective"]
    vertices = sg.read_glb(path).vertices * [1, -1, -1] - node["translation"]
    tangents = vertices[:, :2] / -vertices[:, 2:]
    half_height = np.tan(lens["yfov"] / 2)
    pair = result.pair
    height, width = pair.right.shape[:2]
    # glTF looks through the middle of its picture, and the rectified camera through its principal point.
    reach = np.array([lens["aspectRatio"] * half_height, half_height])
    centre, size = np.array([pair.cx_right, pair.cy]), np.array([width, height])
    np.testing.assert_allclose(reach * pair.focal_px, np.maximum(centre + 0.5, size - 0.5 - centre), rtol=1e-6)
    assert (np.abs(tangents) * pair.focal_px <= reach * pair.focal_px).all()
    # The view's own texture coordinates say where in the picture each vertex is, up to one shift and scale.
    pixels = tangents * [pair.focal_px, -pair.focal_px] + centre
    fitted, _ = cv2.estimateAffine2D(result.mesh.uv.astype(np.float64), pixels, method=cv2.LMEDS)
    seen = result.mesh.uv @ fitted[:, :2].T + fitted[:, 2]
    assert np.percentile(np.abs(seen - pixels), 99) < 0.1
    assert lens["znear"] < -vertices[:, 2].max() and lens["zfar"] > -vertices[:, 2].min()


def test_the_command_takes_a_format(raw_folder, tmp_path, capsys):
    pair = [str(raw_folder / name) for name in ("left.png", "right.png")]
    out = tmp_path / "out"
    options = ["--rig", str(raw_folder / "rig.json"), "--profile", "fast", "--disparities", "16,40", "--unwrap", "view"]
    assert main(["reconstruct", *pair, *options, "--out", str(out), "--texture-format", "gif"]) == 2
    assert "'gif'" in capsys.readouterr().err and not out.exists()
    assert main(["reconstruct", *pair, *options, "--out", str(out), "--texture-format", "webp"]) == 0
    content = (out / "model.glb").read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + length])
    assert document["extensionsRequired"] == ["EXT_texture_webp"]
    assert [image["mimeType"] for image in document["images"]] == ["image/webp"]
    assert json.loads((out / "result.json").read_text())["options"]["texture_format"] == "webp"


def test_formats_that_are_unknown(result, tmp_path):
    for wrong in ({"texture_format": "gif"}, {"quality": 90}, {"texture_format": "jpeg", "quality": 0}):
        with pytest.raises(InputError, match=r"choose|give a whole number"):
            result.save(tmp_path / "out", **wrong)
    assert not (tmp_path / "out").exists()
