import boards
import corner_pairs
import cv2
import pytest

from stereo_gpu.cli import main
from stereo_gpu.images import write_png
from stereo_gpu.rig import Rig

BOARD = ("--board", "9x7", "--square", "30")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six pairs; before the last three the right camera was turned by a degree."""
    folder = tmp_path_factory.mktemp("boards")
    for number, pose in enumerate(boards.poses(corner_pairs.BOARD, 6, seed=8), 1):
        rotation = corner_pairs.ROTATION if number <= 3 else corner_pairs.turned(1.0)
        right = boards.moved(*pose, rotation, corner_pairs.SHIFT)
        for side, lens, there in (("left", boards.LEFT, pose), ("right", boards.RIGHT, right)):
            write_png(folder / f"{side}{number}.png", boards.render(corner_pairs.BOARD, lens, *there, seed=number))
    return folder


def pictures(folder):
    return [str(folder / f"{side}*.png") for side in ("left", "right")]


def test_moved_cameras_offer_both_groups_and_either_works(capsys, folder, tmp_path):
    out = tmp_path / "rig.json"
    assert main(["calibrate", *pictures(folder), *BOARD, "--out", str(out)]) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert "the cameras moved" in told and "--pairs 1-3 or --pairs 4-6" in told
    assert list(tmp_path.iterdir()) == []
    assert main(["calibrate", *pictures(folder), *BOARD, "--out", str(out), "--pairs", "4-6"]) == 0
    shown = capsys.readouterr().out
    assert "3 of 3 pairs" in shown
    assert "T, mm" in shown and "+-" in shown
    assert "rig.html: the same with pictures" in shown
    rig = Rig.load(out)
    assert [view.left for view in rig.views] == ["left4.png", "left5.png", "left6.png"]
    assert cv2.norm(cv2.Rodrigues(rig.R @ corner_pairs.turned(1.0).T)[0]) < 0.01
    assert rig.deviations is not None
    assert b"</html>" in (tmp_path / "rig.html").read_bytes()


def test_no_report(capsys, folder, tmp_path):
    out = tmp_path / "rig.json"
    options = ("--pairs", "1-3", "--no-report", "--coefficients", "5")
    assert main(["calibrate", *pictures(folder), *BOARD, "--out", str(out), *options]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["rig.json"]
    assert "views left out" not in capsys.readouterr().out


def test_some_pairs_of_lists_that_are_none(capsys, folder, tmp_path):
    # A right picture is missing, so that from there on none belongs to the left one of its number.
    (tmp_path / "right").mkdir()
    for number in (1, 3, 4, 5, 6):
        (tmp_path / "right" / f"right{number}.png").write_bytes((folder / f"right{number}.png").read_bytes())
    given = (str(folder / "left*.png"), str(tmp_path / "right"))
    assert main(["calibrate", *given, *BOARD, "--out", str(tmp_path / "rig.json"), "--pairs", "1-5"]) == 2
    assert "6 left pictures but 5 right ones" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--pairs", "4-9"), "--pairs 4-9: there are 6 pairs; end earlier"),
        (("--pairs", "0-3"), "'0-3': give the first and the last pair, such as 1-6"),
        (("--pairs", "5-2"), "'5-2': give the first and the last pair"),
        (("--pairs", "all"), "'all': give the first and the last pair"),
        (("--pairs", "1-2"), "2 pairs: a calibration needs 3 or more"),
        (("--coefficients", "6"), "'6': give 5, 8, 12 or auto"),
        (("--out", "."), ". ends in none of .json"),
        (("--report", "rig.json"), "cannot be both the rig and its report"),
        (("--report", "nowhere/rig.html"), "there is no folder nowhere"),
    ],
)
def test_wrong_options(capsys, folder, tmp_path, monkeypatch, options, says):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *pictures(folder), *BOARD, "--out", "rig.json", *options]) == 2
    told = capsys.readouterr().err.splitlines()
    assert says in told[-1]
    assert list(tmp_path.iterdir()) == []
