"""tools/evaluate: what it prints and writes, and what it says of input that is wrong."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_gpu.images import write_png
from stereo_gpu.pfm import write_pfm

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
evaluate = pytest.importorskip("evaluate", reason="needs the checkout's tools")

SHAPE = (60, 90)
SHIFT = 6


@pytest.fixture
def files(tmp_path):
    """A truth of two planes, a map that is wrong by 3 px in a tenth of the rows and has no value in another tenth."""
    truth = np.full(SHAPE, 5, np.float32)
    truth[:, 50:] = 9
    values = truth.copy()
    values[:6] += 3
    values[6:12] = np.nan
    write_pfm(tmp_path / "map.pfm", values)
    write_pfm(tmp_path / "truth.pfm", truth)
    confidence = np.ones(SHAPE, np.float32)
    confidence[:6] = 0.25
    np.save(tmp_path / "confidence.npy", confidence)
    mask = np.full(SHAPE, 255, np.uint8)
    mask[:, :10] = 128
    write_png(tmp_path / "mask.png", mask)
    write_png(tmp_path / "small.png", mask[1:])
    write_png(tmp_path / "ones.png", np.ones(SHAPE, np.uint8))
    write_png(tmp_path / "nothing.png", np.zeros(SHAPE, np.uint16))
    np.save(tmp_path / "nan.npy", np.full(SHAPE, np.nan))
    return tmp_path


def run(*arguments):
    """The exit status, whether argparse ends the program or main returns."""
    try:
        return evaluate.main([str(argument) for argument in arguments])
    except SystemExit as ended:
        return ended.code


def test_scores_of_a_map(files, capsys):
    assert run(files / "map.pfm", files / "truth.pfm", "--json", files / "scores.json") == 0
    printed = capsys.readouterr().out
    for words in (["nonocc", "all", "disc"], ["pixels", "5400"], ["coverage", "90.00"], ["bad-1.0", "20.00", "11.11"]):
        assert all(word in printed for word in words)
    stored = json.loads((files / "scores.json").read_text("utf-8"))
    scores = stored["scores"]["all"]
    assert scores["counted"] == 5400 and scores["coverage"] == 0.9
    assert scores["bad_2.0"] == pytest.approx(0.2) and scores["bad_2.0_given"] == pytest.approx(1 / 9)
    assert scores["bad_4.0"] == pytest.approx(0.1) and scores["bad_4.0_given"] == 0
    assert scores["mean"] == pytest.approx(1 / 3) and scores["a50"] == 0 and scores["a90"] == 3
    # 5 columns lie left of the right picture, 4 behind the near plane.
    assert stored["scores"]["nonocc"]["counted"] == 81 * 60
    assert any("computed" in note for note in stored["notes"])


def test_masks_from_files(files):
    masks = [f"--{name}={files / 'mask.png'}" for name in ("nonocc", "all", "disc")]
    assert run(files / "map.pfm", files / "truth.pfm", *masks, "--json", files / "scores.json") == 0
    stored = json.loads((files / "scores.json").read_text("utf-8"))
    assert [scores["counted"] for scores in stored["scores"].values()] == [80 * 60] * 3
    assert stored["notes"] == []


def test_truth_of_the_other_view(files):
    """A truth that says 5 everywhere agrees with what is not nearer."""
    write_pfm(files / "other.pfm", np.full(SHAPE, 5, np.float32))
    given = ("--truth-other", files / "other.pfm", "--json", files / "scores.json")
    assert run(files / "map.pfm", files / "truth.pfm", *given) == 0
    assert json.loads((files / "scores.json").read_text("utf-8"))["scores"]["nonocc"]["counted"] == 45 * 60


def test_sparse_truth_gets_no_computed_masks(files):
    levels = np.zeros(SHAPE, np.uint16)
    levels[::3, ::2] = 5 * 256
    write_png(files / "kitti.png", levels)
    assert run(files / "map.pfm", files / "kitti.png", "--json", files / "scores.json") == 0
    stored = json.loads((files / "scores.json").read_text("utf-8"))
    assert list(stored["scores"]) == ["all"] and "17% of the pixels" in stored["notes"][0]


def test_confidence_and_pictures(files, capsys):
    given = ("--confidence", files / "confidence.npy", "--pictures", files / "out", "--json", files / "scores.json")
    assert run(files / "map.pfm", files / "truth.pfm", *given) == 0
    assert "AUSE" in capsys.readouterr().out
    curve = json.loads((files / "scores.json").read_text("utf-8"))["sparsification"]["bad"]
    assert curve["ause"] == pytest.approx(0, abs=1e-12) and curve["random_area"] == pytest.approx(1 / 9)
    pictures = {path.stem: cv2.imread(str(path)) for path in (files / "out").iterdir()}
    assert set(pictures) == {
        "confidence", "disparity", "errors_all", "errors_nonocc", "masks", "sparsification", "truth"
    }  # fmt: skip
    errors, masks = pictures["errors_all"][..., ::-1], pictures["masks"][..., ::-1]
    from stereo_gpu.evaluation import figures
    from stereo_gpu.figures import NO_VALUE

    assert (errors[:6, :90] == figures.ERROR_COLOURS[3]).all()  # 2 to 4 px
    assert (errors[6:12, :90] == NO_VALUE).all() and (errors[12:60, :90] == figures.ERROR_COLOURS[0]).all()
    assert (pictures["errors_nonocc"][:60, :5, ::-1] == figures.UNKNOWN).all()
    assert (masks[:60, :5] == figures.OCCLUDED).all() and (masks[:60, 46:50] == figures.OCCLUDED).all()
    assert (masks[:60, 50:54] == figures.NEAR_JUMP).all() and (masks[:60, 60:90] == figures.VISIBLE).all()


def test_matches_a_pair_itself(tmp_path, backend):
    picture = np.random.default_rng(2).integers(0, 256, (SHAPE[0], SHAPE[1] + SHIFT), np.uint8)
    picture = cv2.GaussianBlur(picture, (0, 0), 1.0)
    write_png(tmp_path / "left.png", picture[:, : SHAPE[1]])
    write_png(tmp_path / "right.png", picture[:, SHIFT:])
    for reference in ("left", "right"):
        write_png(tmp_path / "truth.png", np.full(SHAPE, 4 * SHIFT, np.uint8))
        pair = [f"--{name}={tmp_path / name}.png" for name in ("left", "right", "truth")]
        given = ("--truth-scale=4", "--profile=fast", "--disparities=0,16", f"--reference={reference}")
        assert run(*pair, *given, f"--backend={backend.name}", f"--json={tmp_path / 'scores.json'}") == 0
        stored = json.loads((tmp_path / "scores.json").read_text("utf-8"))
        assert stored["scores"]["nonocc"]["counted"] == (SHAPE[1] - SHIFT) * SHAPE[0]
        assert stored["scores"]["nonocc"]["bad_1.0"] < 0.05 and stored["scores"]["nonocc"]["a50"] < 0.2
        assert stored["disparities"] == [0, 16] and stored["backend"] == backend.name and "sparsification" in stored


def test_self_test(data, capsys):
    assert run("--self-test") == 0
    printed = capsys.readouterr().out
    assert "2.99 / 8.16 / 9.62 %, as published" in printed and "2.09 / 2.33 / 9.31 %, as published" in printed


def test_self_test_tells_a_figure_that_is_off(data, capsys, monkeypatch):
    monkeypatch.setitem(evaluate.PUBLISHED, "teddy", (4, (2.98, 8.16, 9.62)))
    assert run("--self-test") == 1
    assert "published: 2.98" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["gone.pfm", "truth.pfm"], "gone.pfm: No such file"),
        (["map.pfm", "gone.png"], "gone.png: there is no such file"),
        (["map.pfm", "mask.png"], "mask.png has 8 bits"),
        (["mask.png", "truth.pfm", "--scale=0"], "scale = 0.0"),
        (["small.png", "truth.pfm", "--scale=4"], "small.png is 90 x 59 px, the truth is 90 x 60 px"),
        (["map.pfm", "nothing.png"], "nothing.png knows the truth of none"),
        (["map.pfm", "nan.npy"], "nan.npy knows the truth of none"),
        (["map.pfm", "truth.pfm", "--nonocc", "small.png"], "small.png is 90 x 59 px"),
        (["map.pfm", "truth.pfm", "--disc", "ones.png"], "ones.png is 1 at most"),
        (["map.pfm", "truth.pfm", "--truth-other", "small.png", "--truth-scale=4"], "small.png is 90 x 59 px"),
        (["map.pfm", "truth.pfm", "--confidence", "small.png"], "small.png is 90 x 59 px"),
        (["map.pfm", "truth.pfm", "--reference", "middle"], "reference = 'middle'"),
        (["map.pfm", "truth.pfm", "--json", "gone/a.json"], "there is no folder"),
        (["map.pfm", "truth.pfm", "--pictures", "map.pfm"], "map.pfm"),
        (["map.pfm"], "give MAP and TRUTH, or"),
        ([], "give MAP and TRUTH, or"),
        (["--self-test", "map.pfm", "truth.pfm"], "give MAP and TRUTH, or"),
        (["--left", "mask.png", "--right", "mask.png"], "give MAP and TRUTH, or"),
        (["map.pfm", "truth.pfm", "--left", "mask.png"], "give MAP and TRUTH, or"),
        (["map.pfm", "truth.pfm", "--truth", "nan.npy"], "are two truths"),
        (["map.pfm", "truth.pfm", "--scale", "four"], "'four'"),
        (["map.pfm", "truth.pfm", "--window", "wide"], "'wide'"),
        (["map.pfm", "truth.pfm", "--disparities", "64"], "'64'"),
        (["--left=mask.png", "--right=mask.png", "--truth=truth.pfm", "--scale=4"], "--scale belongs to a MAP"),
        (["--left=mask.png", "--right=small.png", "--truth=truth.pfm"], "right is 90 x 59 px"),
        (["--left=small.png", "--right=small.png", "--truth=truth.pfm"], "small.png is 90 x 59 px"),
        (["--left=mask.png", "--right=mask.png", "--truth=truth.pfm", "--profile=best"], "profile = 'best'"),
    ],
)
def test_wrong_input_is_one_line_and_status_2(files, capsys, monkeypatch, arguments, says):
    monkeypatch.chdir(files)
    assert run(*arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("evaluate: error: ")
    assert says in printed.err and printed.err.count("\n") == 1


def test_self_test_without_data(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("STEREO_GPU_DATA", str(tmp_path))
    assert run("--self-test") == 2
    assert "set STEREO_GPU_DATA" in capsys.readouterr().err


def test_a_map_without_values_is_scored(files, capsys):
    assert run(files / "nan.npy", files / "truth.pfm") == 0
    printed = capsys.readouterr().out
    assert "0.00 %" in printed and "100.00 %" in printed and "nan" not in printed.partition("\n")[2]
