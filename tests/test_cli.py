"""The command line: what it leaves when all goes well, and one line and nothing else when input is wrong."""

import dataclasses
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_gpu.cli import main
from stereo_gpu.commands.pictures import split_pictures
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image, write_png
from stereo_gpu.pfm import read_pfm
from stereo_gpu.progress import Progress
from stereo_gpu.rig import Rig

WRONG_INPUT, OTHER_FAILURE = 2, 1
BOARD = ("--board", "10x7", "--square", "30")
RESULT = {
    *("model.glb", "model.obj", "model.mtl", "model.png", "model.ply", "cloud.ply", "surface.vtp"),
    *("disparity.pfm", "disparity.png", "report.html", "result.json"),
}


@pytest.fixture(scope="module")
def wrong(raw_folder, tmp_path_factory):
    """Files with every fault that pictures and rigs come with; names say which."""
    folder = tmp_path_factory.mktemp("wrong")
    left = read_image(raw_folder / "left.png")
    packed = (raw_folder / "left.png").read_bytes()
    (folder / "cut.png").write_bytes(packed[: len(packed) // 2])
    jpeg = cv2.imencode(".jpg", left)[1].tobytes()
    (folder / "cut.jpg").write_bytes(jpeg[: len(jpeg) // 2])
    (folder / "junk.png").write_bytes(np.random.default_rng(1).bytes(4000))
    (folder / "empty.png").write_bytes(b"")
    write_png(folder / "lower.png", left[:-5])
    cv2.imwrite(str(folder / "dot.png"), left[:1, :1])  # write_png refuses it
    write_png(folder / "grey.png", left[..., 1].copy())
    write_png(folder / "deep.png", left.astype(np.uint16) * 257)
    write_png(folder / "black.png", np.zeros_like(left))
    write_png(folder / "wide.png", np.tile(left[:40], (1, 63, 1))[:, :20000])
    rig = (raw_folder / "rig.json").read_text()
    (folder / "cut.json").write_text(rig[: len(rig) // 2])
    (folder / "nan.json").write_text(rig.replace('"T": [', '"T": [NaN, ', 1))
    (folder / "other.json").write_text(rig.replace("320,", "640,").replace("240\n", "480\n"))
    return folder


def refused(capsys, *arguments, status=WRONG_INPUT, says=()):
    """Run; there must be one line on standard error after the stages' names, and nothing on standard output."""
    assert main([str(argument) for argument in arguments]) == status
    shown = capsys.readouterr()
    lines = [line for line in shown.err.splitlines() if line.startswith("stereo-gpu: error: ")]
    assert len(lines) == 1, shown.err
    assert shown.err.endswith(lines[0] + "\n")
    assert shown.out == ""
    assert "Traceback" not in shown.err and "fault of ours" not in shown.err
    for part in says:
        assert part in lines[0]
    return lines[0]


@pytest.fixture
def untouched(tmp_path, monkeypatch):
    """An empty working folder that must be empty at the end, too."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not list(tmp_path.rglob("*"))


PICTURE_FAULTS = {
    "missing.png": "no such file",
    "junk.png": "cannot be decoded",
    "cut.png": "cut off",
    "cut.jpg": "cut off",
    "empty.png": "empty",
    "lower.png": "320 x 235",
    "dot.png": "1 x 1",
    "grey.png": "in colour",
    "deep.png": "uint16",
    "wide.png": "20000 x 40",
    ".": "is a folder",
}


@pytest.mark.parametrize("name", PICTURE_FAULTS)
@pytest.mark.parametrize("command", ["check", "rectify", "match", "reconstruct"])
def test_a_faulty_picture_is_refused(capsys, untouched, wrong, raw_folder, command, name):
    rig = () if command == "match" else ("--rig", raw_folder / "rig.json")
    pair = (wrong / name, raw_folder / "right.png")
    refused(capsys, command, *pair, *rig, "--out", "new", says=[PICTURE_FAULTS[name]])
    refused(capsys, command, *pair[::-1], *rig, "--out", "new", says=[PICTURE_FAULTS[name]])


@pytest.mark.parametrize("command", ["rectify", "match", "reconstruct"])
def test_left_given_for_right_is_refused(capsys, untouched, raw_folder, command):
    rig = () if command == "match" else ("--rig", raw_folder / "rig.json")
    pair = (raw_folder / "right.png", raw_folder / "left.png")
    refused(capsys, command, *pair, *rig, "--out", "new", says=["swapped", "left camera's picture first"])


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("missing.json", "check the path"),
        ("cut.json", "cut off"),
        ("nan.json", "T has"),
        ("other.json", "calibrated for 640 x 480"),
        ("junk.png", "of no known format"),
        (".", "is a folder"),
    ],
)
@pytest.mark.parametrize("command", ["check", "rectify", "reconstruct"])
def test_a_faulty_rig_is_refused(capsys, untouched, wrong, raw_folder, command, name, says):
    pair = (raw_folder / "left.png", raw_folder / "right.png")
    refused(capsys, command, *pair, "--rig", wrong / name, "--out", "new", says=[says])


MATCHING_FAULTS = [
    (("--disparities", "0,0"), "empty range"),
    (("--disparities", "5,-4"), "empty range"),
    (("--disparities", "0,99999"), "at most"),
    (("--disparities", "5000,16"), "outside of a picture 320 px wide"),
    (("--disparities", "nan,16"), "2 numbers"),
    (("--disparities", "-8,64"), "equals sign"),
    (("--window", "4"), "must be odd"),
    (("--window", "33"), "from 3 to 31"),
    (("--window", "nan"), "or auto"),
    (("--tile", "4"), "tile = 4"),
    (("--reference", "up"), "left or right"),
    (("--profile", "best"), "paper, fast, precise"),
    (("--mask", "missing.png"), "no such file"),
]
MODEL_FAULTS = [
    (("--depth", "5,1"), "nearest"),
    (("--depth", "nan,5"), "nearest"),
    (("--depth=-9,-5"), "nearest"),
    (("--depth", "7"), "2 numbers"),
    (("--rectangle", "300,200,100,100"), "leaves the picture"),
    (("--rectangle", "1,2,0,0"), "0 x 0"),
    (("--rectangle", "1,2,3"), "4 numbers"),
    (("--faces", "-3"), "faces = -3"),
    (("--smoothing", "-1"), "smoothing = -1"),
    (("--mesh", "net"), "invalid choice"),
    (("--mesh-error", "0"), "above 0 (--mesh-error)"),
    (("--mesh-error", "nan"), "error_px = nan"),
    (("--close-holes", "-5"), "--close-holes all"),
    (("--close-holes", "some"), "none or all"),
    (("--smallest-part", "-1"), "smallest_part = -1"),
    (("--decimate-error", "0"), "or leave it out"),
    (("--unwrap", "origami"), "invalid choice"),
    (("--texture-format", "bmp"), "invalid choice"),
]


@pytest.mark.parametrize(("option", "says"), MATCHING_FAULTS)
def test_a_wrong_option_of_match_is_refused(capsys, untouched, raw_folder, option, says):
    pair = (raw_folder / "left.png", raw_folder / "right.png")
    refused(capsys, "match", *pair, "--out", "new", *option, says=[says])


@pytest.mark.parametrize(("option", "says"), MATCHING_FAULTS + MODEL_FAULTS)
def test_a_wrong_option_of_reconstruct_is_refused(capsys, untouched, raw_folder, option, says):
    pair = (raw_folder / "left.png", raw_folder / "right.png")
    option = (option,) if isinstance(option, str) else option
    refused(capsys, "reconstruct", *pair, "--rig", raw_folder / "rig.json", "--out", "new", *option, says=[says])


@pytest.mark.parametrize(("name", "says"), [("lower.png", "320 x 235"), ("black.png", "black"), ("cut.png", "cut")])
def test_a_mask_that_does_not_fit_is_refused(capsys, untouched, wrong, raw_folder, name, says):
    pair = (raw_folder / "left.png", raw_folder / "right.png")
    for rest in (("match",), ("reconstruct", "--rig", raw_folder / "rig.json")):
        refused(capsys, rest[0], *pair, *rest[1:], "--out", "new", "--mask", wrong / name, says=[says])


def test_depths_where_nothing_is_are_refused(capsys, untouched, raw_folder):
    pair = (raw_folder / "left.png", raw_folder / "right.png")
    given = ("--rig", raw_folder / "rig.json", "--out", "new", "--disparities", "15,40", "--depth", "1,2")
    refused(capsys, "reconstruct", *pair, *given, says=["depth = 1,2", "points were found from"])


@pytest.mark.parametrize("command", ["demo", "match", "reconstruct", "rectify", "bench"])
def test_an_unknown_backend_is_no_wrong_input(capsys, untouched, raw_folder, command):
    pair = () if command in ("demo", "bench") else (raw_folder / "left.png", raw_folder / "right.png")
    rig = ("--rig", raw_folder / "rig.json") if command in ("reconstruct", "rectify") else ()
    out = () if command == "bench" else ("--out", "new")
    given = (command, *pair, *rig, *out, "--backend", "abacus")
    refused(capsys, *given, status=OTHER_FAILURE, says=["'abacus'", "warp:cpu"])


@pytest.mark.parametrize("command", ["demo", "capture", "match", "reconstruct", "rectify", "calibrate"])
def test_a_folder_that_cannot_be_written_is_refused_before_any_work(capsys, tmp_path, raw_folder, command):
    (tmp_path / "file").write_text("kept")
    pair = (raw_folder / "left.png", raw_folder / "right.png")
    given = {
        "demo": (),
        "capture": (0, 1),
        "match": pair,
        "reconstruct": (*pair, "--rig", raw_folder / "rig.json"),
        "rectify": (*pair, "--rig", raw_folder / "rig.json"),
        "calibrate": (*pair[:1] * 3, *pair[1:] * 3, *BOARD),
    }[command]
    for out in (tmp_path / "file" / "new", Path("/proc/new/deeper")):
        refused(capsys, command, *given, "--out", out, says=[str(out if command != "calibrate" else out.parent)])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--board", "ten", "--square", "30"), "10x7"),
        (("--board", "0x7", "--square", "30"), "board columns is 0"),
        (("--board", "10x7", "--square", "0"), "square is 0"),
        (("--board", "10x7", "--square", "-1"), "square is -1"),
        (("--board", "10x7", "--square", "nan"), "square is nan"),
        (("--board", "10x7"), "--square"),
        ((*BOARD, "--coefficients", "7"), "5, 8, 12"),
    ],
)
def test_a_wrong_board_is_refused(capsys, untouched, raw_folder, arguments, says):
    pictures = [raw_folder / "left.png"] * 3 + [raw_folder / "right.png"] * 3
    refused(capsys, "calibrate", *pictures, *arguments, "--out", "rig.json", says=[says])


def test_board_pictures_that_do_not_fit_are_refused(capsys, untouched, wrong, raw_folder, tmp_path_factory):
    left, right = raw_folder / "left.png", raw_folder / "right.png"
    empty = tmp_path_factory.mktemp("empty")
    for pictures, says in (
        ([left] * 3 + [right] * 2, "5 pictures cannot be pairs"),
        ([empty / "none"], "none is no folder: name"),
        ([left, right], "needs 3 or more"),
        ([empty, empty], "holds no picture"),
        ([empty / "*.png", empty / "*.png"], "no picture matches"),
        ([wrong / "cut.png"] * 3 + [right] * 3, "cut off"),
        ([wrong / "dot.png"] * 3 + [right] * 3, "1 x 1"),
        ([wrong / "wide.png"] * 6, "0 of 3 pairs show a whole board of 10x7 squares"),
        ([left] * 3 + [right, right, wrong / "lower.png"], "320 x 235"),
    ):
        refused(capsys, "calibrate", *pictures, *BOARD, "--out", "rig.json", says=[says])


def test_a_folder_that_cannot_be_read(tmp_path, monkeypatch):
    def refuse(_folder):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    for given in ([str(tmp_path)], [str(tmp_path)] * 2):
        with pytest.raises(InputError, match="cannot be read: Permission denied"):
            split_pictures(given)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "COMMAND"),
        (("fly",), "'fly'"),
        (("match",), "--out"),
        (("capture", "a", "b", "--out", "new", "--count", "0"), "count = 0"),
        (("capture", "a", "b", "--out", "new", "--interval", "nan"), "interval = nan"),
        (("capture", "a.avi", "b.avi", "--out", "new"), "'a.avi' cannot be opened"),
        (("bench", "--size", "64,64"), "3 numbers"),
        (("bench", "--size", "64,64,15"), "multiple of 16"),
        (("bench", "--size", "0,0,16"), "size 0 x 0"),
        (("bench", "--window", "4"), "window 4"),
        (("devices", "all"), "all"),
    ],
)
def test_wrong_arguments_are_refused(capsys, untouched, arguments, says):
    refused(capsys, *arguments, says=[says])


def test_calibrate_writes_a_rig(capsys, tmp_path, data):
    folder = data / "calibration" / "board_10x7"
    sides = [sorted(folder.glob(f"{side}*"))[:6] for side in ("left", "right")]
    out = tmp_path / "rig.json"
    assert main(["calibrate", *map(str, sides[0] + sides[1]), *BOARD, "--out", str(out)]) == 0
    shown = capsys.readouterr()
    assert "6 of 6 pairs" in shown.out and "12 of 12 pictures searched" in shown.err
    rig = Rig.load(out)
    assert rig.left.size == (640, 480)
    assert 95 < rig.baseline < 105
    assert sorted(path.name for path in tmp_path.iterdir()) == ["rig.html", "rig.json"]


def test_check_says_and_draws_what_it_found(capsys, tmp_path, raw_folder):
    pair, rig = [str(raw_folder / f"{side}.png") for side in ("left", "right")], str(raw_folder / "rig.json")
    assert main(["check", *pair, "--rig", rig, "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith("good: rows differ by 0.") and "the rig is good" in shown.out and shown.err == ""
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["check.json", "check.png"]
    record = json.loads((tmp_path / "out" / "check.json").read_text())
    assert record["verdict"] == "good" and record["vertical_px"] < 0.25
    assert read_image(tmp_path / "out" / "check.png").shape[1] > 960


def test_check_refines_a_drift_and_saves_where_told(capsys, tmp_path, raw_folder):
    pair, rig = [str(raw_folder / f"{side}.png") for side in ("left", "right")], Rig.load(raw_folder / "rig.json")
    turn = cv2.Rodrigues(np.array([np.radians(0.5), 0, 0]))[0]
    dataclasses.replace(rig, R=turn @ rig.R, T=turn @ rig.T).save(tmp_path / "old.json")
    given = ["check", *pair, "--rig", str(tmp_path / "old.json")]
    assert main(given) == OTHER_FAILURE
    shown = capsys.readouterr()
    assert shown.out.startswith("bad: ") and "does not fit this pair: rows differ by 2." in shown.err
    assert main([*given, "--refine"]) == 0
    shown = capsys.readouterr()
    assert "refined: the right camera turned by 0.5" in shown.out and "--save new.json" in shown.out
    assert [path.name for path in tmp_path.iterdir()] == ["old.json"]
    assert main([*given, "--refine", "--save", str(tmp_path / "new.json")]) == 0
    refined = Rig.load(tmp_path / "new.json")
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(refined.R @ rig.R.T)[0])) < 0.1
    assert refined.baseline == pytest.approx(rig.baseline, rel=1e-12)
    assert main(["check", *pair, "--rig", str(tmp_path / "new.json")]) == 0


def test_what_check_cannot_do_is_refused(capsys, tmp_path, raw_folder):
    pair, rig = [raw_folder / f"{side}.png" for side in ("left", "right")], ("--rig", raw_folder / "rig.json")
    refused(capsys, "check", *pair, *rig, "--save", tmp_path / "new.json", says=["--refine"])
    refused(capsys, "check", *pair, *rig, "--refine", "--save", tmp_path / "no" / "new.json", says=["no folder"])
    refused(capsys, "check", *pair, *rig, "--out", "/proc/new", says=["/proc/new"])
    assert not list(tmp_path.iterdir())
    assert main(["check", *map(str, pair[::-1]), *map(str, rig), "--refine", "--out", str(tmp_path / "out")]) == 2
    shown = capsys.readouterr()
    assert "cannot be refined" in shown.err and "look swapped" in shown.err
    assert (tmp_path / "out" / "check.png").is_file()  # what was found is drawn all the same


def test_a_pair_that_does_not_fit_its_rig(capsys, tmp_path, raw_folder):
    """`reconstruct` refuses it, and goes on when told to; `rectify` warns."""
    pair, rig = [str(raw_folder / f"{side}.png") for side in ("left", "right")], Rig.load(raw_folder / "rig.json")
    turn = cv2.Rodrigues(np.array([np.radians(0.5), 0, 0]))[0]
    dataclasses.replace(rig, R=turn @ rig.R, T=turn @ rig.T).save(tmp_path / "old.json")
    given = [*pair, "--rig", str(tmp_path / "old.json"), "--out", str(tmp_path / "out")]
    quick = ["--profile", "fast", "--disparities", "20,44", "--faces", "2000", "--unwrap", "view"]
    refused(capsys, "reconstruct", *given, *quick, says=["shifted down by", "--ignore-check"])
    assert not (tmp_path / "out").exists()
    assert main(["reconstruct", *given, *quick, "--ignore-check"]) == 0
    assert "warning: Rows differ by 2." in capsys.readouterr().err
    record = json.loads((tmp_path / "out" / "result.json").read_text())
    assert record["check"]["verdict"] == "bad" and record["check"]["fault"] == "shifted"
    assert main(["rectify", *given]) == 0
    assert "warning: rows differ by 2." in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["colour", "grey", "deep", "alpha"])
def test_rectify_takes_every_kind_of_picture(capsys, tmp_path, raw_folder, kind):
    for side in ("left", "right"):
        picture = cv2.imread(str(raw_folder / f"{side}.png"))
        changed = {
            "colour": picture,
            "grey": picture[..., 1],
            "deep": picture.astype(np.uint16) * 16,
            "alpha": np.dstack([picture, picture[..., 0]]),
        }[kind]
        cv2.imwrite(str(tmp_path / f"{side}.png"), changed)
    pair, rig = [str(tmp_path / f"{side}.png") for side in ("left", "right")], str(raw_folder / "rig.json")
    assert main(["rectify", *pair, "--rig", rig, "--out", str(tmp_path / "out")]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["left.png", "right.png"]
    rectified = read_image(tmp_path / "out" / "left.png")
    assert rectified.dtype == (np.uint16 if kind == "deep" else np.uint8)
    assert rectified.shape == ((240, 320) if kind == "grey" else (240, 320, 3))
    assert "baseline 100.0" in capsys.readouterr().out


def test_match_warns_of_a_pair_that_is_not_rectified(capsys, tmp_path, raw_folder):
    lowered = np.roll(cv2.imread(str(raw_folder / "right.png")), 3, axis=0)
    cv2.imwrite(str(tmp_path / "right.png"), lowered)
    pair = [str(raw_folder / "left.png"), str(tmp_path / "right.png")]
    assert main(["match", *pair, "--disparities", "0,64", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().err
    assert "warning: rows differ by" in told and "stereo-gpu rectify" in told


@pytest.mark.parametrize("command", ["check", "rectify"])
def test_sizes_that_differ_are_not_blamed_on_the_rig(capsys, tmp_path, raw_folder, command):
    cv2.imwrite(str(tmp_path / "left.png"), cv2.imread(str(raw_folder / "left.png"))[:100, :100])
    given = [tmp_path / "left.png", raw_folder / "right.png", "--rig", raw_folder / "rig.json", "--out", tmp_path / "o"]
    refused(capsys, command, *given, says=["left is 100 x 100 px", "two pictures of one size"])


def test_match_writes_the_map(capsys, tmp_path, raw_folder):
    rig, pair = str(raw_folder / "rig.json"), [str(raw_folder / f"{side}.png") for side in ("left", "right")]
    assert main(["rectify", *pair, "--rig", rig, "--out", str(tmp_path)]) == 0
    pair = [str(tmp_path / f"{side}.png") for side in ("left", "right")]
    assert main(["match", *pair, "--disparities", "20,44", "--out", str(tmp_path / "map")]) == 0
    assert sorted(path.name for path in (tmp_path / "map").iterdir()) == ["disparity.pfm", "disparity.png"]
    values = read_pfm(tmp_path / "map" / "disparity.pfm")
    assert values.shape == (240, 320)
    assert np.isfinite(values).mean() > 0.8
    assert "searched 20 to 63 px" in capsys.readouterr().out


def test_reconstruct_leaves_every_file(capsys, tmp_path, raw_folder):
    pair = [str(raw_folder / f"{side}.png") for side in ("left", "right")]
    given = ["--rig", str(raw_folder / "rig.json"), "--disparities", "20,44", "--faces", "2000", "--unwrap", "view"]
    out = tmp_path / "a" / "b"
    assert main(["reconstruct", *pair, *given, "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == RESULT
    record = json.loads((out / "result.json").read_text())
    assert record["options"]["mesh.faces"] == 2000 and record["options"]["mesh.unwrap_used"] == "view"
    shown = capsys.readouterr()
    assert "report.html" in shown.out
    stages = [line.removeprefix("stereo-gpu: ") for line in shown.err.splitlines()]
    assert stages[0] == "read" and stages[-1] == "save"


def test_a_full_disk_at_the_end_leaves_nothing(capsys, tmp_path, raw_folder):
    pair = [raw_folder / f"{side}.png" for side in ("left", "right")]
    given = ("--rig", raw_folder / "rig.json", "--disparities", "20,44", "--unwrap", "view")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))  # the nearest thing to a full disk
    try:
        refused(capsys, "reconstruct", *pair, *given, "--out", tmp_path / "new" / "deep", says=["File too large"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not list(tmp_path.iterdir())


def test_a_fault_of_ours_is_one_line_and_a_traceback_only_when_asked(capsys, monkeypatch):
    def broken():
        raise ZeroDivisionError("a\nb")

    monkeypatch.setattr("stereo_gpu.backends.devices", broken)
    assert main(["devices"]) == OTHER_FAILURE
    assert capsys.readouterr().err == (
        "stereo-gpu: error: ZeroDivisionError: a b (this is a fault of ours: run again with --debug)\n"
    )
    with pytest.raises(ZeroDivisionError):
        main(["devices", "--debug"])


def test_interrupted(capsys, monkeypatch):
    def interrupt():
        raise KeyboardInterrupt

    monkeypatch.setattr("stereo_gpu.backends.devices", interrupt)
    assert main(["devices"]) == 130
    assert "interrupted" in capsys.readouterr().err


def test_devices_and_doctor_tell_what_runs_here(capsys):
    assert main(["devices"]) == 0
    assert "warp:cpu" in capsys.readouterr().out
    assert main(["doctor"]) == 0
    shown = capsys.readouterr().out
    assert "ok    a device that computes" in shown and "numpy" in shown


def test_help_starts_fast_and_imports_nothing_heavy():
    code = (
        "import sys; from stereo_gpu.cli import main; main(['--help']);"
        "heavy = {'warp', 'pyopencl', 'trimesh', 'xatlas', 'PIL', 'fast_simplification'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "reconstruct" in done.stdout


def test_a_reader_that_has_had_enough_is_no_error():
    command = [sys.executable, "-c", "from stereo_gpu.cli import main; raise SystemExit(main(['devices']))"]
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert done.returncode == 0
    assert done.stderr == ""


def test_names_that_are_no_text(tmp_path, raw_folder):
    odd = os.fsdecode(b"l\xff <\xc3\xa4>.png")
    (tmp_path / odd).write_bytes((raw_folder / "left.png").read_bytes())
    pair = [str(tmp_path / odd), str(raw_folder / "right.png")]
    given = ["--rig", str(raw_folder / "rig.json"), "--profile", "fast", "--disparities", "20,44", "--unwrap", "view"]
    code = "import sys; from stereo_gpu.cli import main; raise SystemExit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "reconstruct", *pair, *given, "--out", str(tmp_path / "\u00e4")]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "\u00e4" / "result.json").read_text())
    assert record["inputs"]["left"]["name"] == "l\ufffd <\u00e4>.png"
    assert "l\ufffd &lt;\u00e4&gt;.png" in (tmp_path / "\u00e4" / "report.html").read_text("utf-8")


def test_the_bar_is_drawn_on_a_terminal_only(capsys, monkeypatch):
    with Progress(["read", "match"]) as progress:
        progress.step("match")
        for done in range(1, 31):
            progress.searched(done, 30)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "stereo-gpu: match"
    assert len(lines) == 11 and lines[-1] == "stereo-gpu: 30 of 30 pictures searched"
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with Progress(["read", "match"]) as progress:
        progress.step("match")
    shown = capsys.readouterr().err
    assert "[############............] match" in shown
    assert shown.endswith("\r\x1b[K")


def test_pictures_are_told_apart(tmp_path):
    for name in ("l2.png", "l10.jpg", "r1.png", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    left, right = split_pictures([str(tmp_path / "l*"), str(tmp_path / "r*")])
    assert [path.name for path in left] == ["l10.jpg", "l2.png"] and [path.name for path in right] == ["r1.png"]
    left, right = split_pictures([str(tmp_path), str(tmp_path)])
    assert len(left) == len(right) == 3
    assert split_pictures(list("abcd")) == ([Path("a"), Path("b")], [Path("c"), Path("d")])
