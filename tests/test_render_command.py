import cv2
import numpy as np
import pytest
import trimesh
from PIL import Image
from test_turntable import quarters

import stereo_gpu as sg
from stereo_gpu.cli import main
from stereo_gpu.export import write_glb
from stereo_gpu.render import BACKGROUND


@pytest.fixture
def model(tmp_path):
    return str(write_glb(tmp_path / "model.glb", quarters()))


def drawn(path):
    return cv2.imread(str(path))[..., ::-1]


def test_a_picture_is_the_one_that_render_draws(capsys, tmp_path, model):
    out = tmp_path / "view.png"
    assert main(["render", model, "--yaw", "-15", "--pitch", "5", "--size", "160x120", "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}: yaw -15, pitch 5 degrees\n"
    want = sg.render(quarters(), size=(160, 120), yaw=-15, pitch=5, supersample=3)
    # The model is in millimetres, its file in metres.
    assert np.abs(drawn(out).astype(int) - want).max() <= 1


def test_a_large_picture_has_fewer_samples(tmp_path, model):
    out = tmp_path / "view.png"
    assert main(["render", model, "--size", "6000x6", "--out", str(out)]) == 0
    assert drawn(out).shape == (6, 6000, 3)


def test_several_angles_are_numbered(capsys, tmp_path, model):
    out = tmp_path / "view.png"
    arguments = ["render", model, "--yaw=-20,0", "--yaw", "20", "--size", "40x30", "--shading", "wire"]
    assert main([*arguments, "--out", str(out)]) == 0
    pictures = [drawn(tmp_path / f"view-{number}.png") for number in (1, 2, 3)]
    assert not out.exists() and len(capsys.readouterr().out.splitlines()) == 3
    shown = [(np.abs(p.astype(int) - BACKGROUND).max(axis=2) > 9) for p in pictures]
    assert not np.array_equal(shown[0], shown[2])
    assert np.abs(shown[0].astype(int) - shown[2][:, ::-1]).mean() < 0.05  # the other side mirrored


def test_a_film(capsys, tmp_path, model):
    out = tmp_path / "turn.webp"
    options = ["--turntable", str(out), "--seconds", "0.4", "--fps", "10", "--size", "40x30"]
    assert main(["render", model, *options]) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{out}: 0.4 s, ") and "4 of 4 pictures drawn" in said.err
    with Image.open(out) as film:
        assert film.n_frames == 4 and film.size == (40, 30)
    assert main(["render", model, "--turntable", str(out), "--seconds", "0.2", "--fps", "10"]) == 0
    with Image.open(out) as film:
        assert film.size == (640, 480)


def test_a_model_of_another_program_is_seen_from_the_front(tmp_path):
    # A red box about the origin, as most programs place a model.
    box = trimesh.creation.box((2, 1, 1))
    red = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), material=red)
    box.export(tmp_path / "box.glb")
    out = tmp_path / "view.png"
    arguments = [str(tmp_path / "box.glb"), "--size", "80x60", "--yaw", "0", "--pitch", "0", "--out", str(out)]
    assert main(["render", *arguments]) == 0
    picture = drawn(out)
    assert picture[30, 40].tolist() == [255, 0, 0]
    rows, columns = np.nonzero((picture == (255, 0, 0)).all(axis=2))
    assert np.ptp(columns) > 70 and np.ptp(rows) == pytest.approx(np.ptp(columns) / 2, abs=3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["MODEL", "--size", "2x9", "--out", "view.png"], "each at least 3"),
        (["MODEL", "--size", "20000x9", "--out", "view.png"], "draw no side of more than 16384 px"),
        (["MODEL"], "nothing to write: name a picture with --out"),
        (["missing.glb", "--out", "view.png"], "missing.glb cannot be read"),
        (["TEXT", "--out", "view.png"], "is no GLB"),
        (["MODEL", "--out", "view.jpg"], "unknown ending '.jpg' of a picture: take .png"),
        (["MODEL", "--out", "missing/view.png"], "there is no folder missing"),
        (["MODEL", "--turntable", "turn.avi"], "unknown ending '.avi' of a turntable"),
        (["MODEL", "--turntable", "missing/turn.gif"], "there is no folder missing"),
        (["MODEL", "--turntable", "turn.gif", "--yaw", "1,2"], "2 angles for one film"),
        (["MODEL", "--turntable", "turn.gif", "--swing", "-3"], "0 to 180, or 360"),
        (["MODEL", "--out", "view.png", "--yaw", "left"], "'left': give degrees from -360 to 360"),
        (["MODEL", "--out", "view.png", "--yaw", "nan"], "'nan': give degrees"),
        (["MODEL", "--out", "view.png", "--yaw", "1,2,3", "--pitch", "1,2"], "give one of them once"),
        (["MODEL", "--out", "view.png", "--size", "big"], "give width x height"),
        (["MODEL", "--out", "view.png", "--shading", "shiny"], "'shiny' is unknown"),
    ],
)
def test_wrong_input_is_one_line(capsys, tmp_path, monkeypatch, model, arguments, says):
    text = tmp_path / "text.glb"
    text.write_text("no model")
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    names = {"MODEL": model, "TEXT": str(text)}
    assert main(["render", *(names.get(argument, argument) for argument in arguments)]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before
