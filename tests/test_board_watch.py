"""Which pairs of a moving board are taken, and what is said of the others."""

import json
import shutil

import cv2
import moving_boards
import numpy as np
import pytest
from moving_boards import BOARD, between, frame, pose, render

from stereo_gpu.boards.board import Board
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.capture import capture
from stereo_gpu.cli import main
from stereo_gpu.errors import InputError
from stereo_gpu.images import read_image, write_png
from stereo_gpu.recording.board_watch import BoardChooser

HELD = 10  # frames at 30 a second: longer than a quarter of a second


class Watch:
    """A chooser, and what it said of each frame."""

    def __init__(self, board=BOARD, **options):
        self.looks = []
        self.chooser = BoardChooser(board, shows=[self.looks.append], **options)
        self.number = 0

    def see(self, pictures, times=1):
        """Show the pictures; which of these frames were taken, counted from 1."""
        taken = []
        for count in range(1, times + 1):
            self.number += 1
            if self.chooser.choose(frame(self.number, pictures)):
                taken.append(count)
        return taken


def carry(watch, start, end, frames=4, blur=9):
    return [watch.see(render(between(start, end, (step + 0.5) / frames), blur)) for step in range(frames)]


def test_a_held_board_is_taken_once_and_a_carried_one_never():
    watch = Watch()
    assert watch.chooser.status == "waiting for the first pictures"
    assert not watch.chooser.done
    [taken] = watch.see(render(pose(0)), HELD)
    assert taken >= 8  # a quarter of a second
    assert watch.looks[taken - 2].status == "hold still"
    assert watch.looks[taken - 1].taken and watch.looks[taken - 1].status.startswith("taken: now tilt it")
    assert watch.chooser.status == "already have one here: tilt it left or right"
    assert carry(watch, pose(0), pose(3)) == [[]] * 4
    assert watch.see(render(pose(3)), HELD) == [taken]
    assert carry(watch, pose(3), pose(0)) == [[]] * 4
    assert watch.see(render(pose(0)), HELD) == []  # an old place
    assert "already have one here" in watch.chooser.status
    assert carry(watch, pose(0), pose(5)) == [[]] * 4
    assert watch.see(render(pose(5)), HELD) == [taken]
    assert watch.chooser.coverage.pairs == 3


def open_writers(folder):
    return {
        side: cv2.VideoWriter(str(folder / f"{side}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30, moving_boards.SIZE)
        for side in ("left", "right")
    }


def test_the_command_says_what_is_missing_and_a_second_run_goes_on(tmp_path, capsys):
    for name, numbers in (("first", (0, 4)), ("second", (4, 7))):
        (tmp_path / name).mkdir()
        writers = open_writers(tmp_path / name)
        for pictures in map(render, map(pose, numbers)):
            for writer, picture in zip(writers.values(), pictures, strict=True):
                for _ in range(HELD):
                    writer.write(picture[..., ::-1])
        for writer in writers.values():
            writer.release()
    told = []
    for name in ("first", "second"):
        films = [str(tmp_path / name / f"{side}.avi") for side in ("left", "right")]
        options = ["--board", "10x7", "--square", "30", "--page", "0", "--out", str(tmp_path / "out")]
        assert main(["capture", *films, *options]) == 0
        told.append(capsys.readouterr())
    assert "open http://127.0.0.1:" in told[0].err
    assert "pair 2: left0002.png, right0002.png" in told[0].out
    assert "missing: 8 of at least 10 pairs" in told[0].out
    assert "missing in both pictures: " in told[0].out and "no corner near the top of the picture" in told[0].out
    assert "2 pairs with the board are in" in told[1].err
    assert "pair 3: left0003.png" in told[1].out and "pair 4" not in told[1].out  # the fourth pose again
    assert "missing: 7 of at least 10 pairs" in told[1].out
    assert sorted(path.name for path in (tmp_path / "out").glob("right*")) == [f"right000{n}.png" for n in (1, 2, 3)]


def test_in_the_end_the_next_command_is_told(tmp_path, capsys):
    out = tmp_path / "my pairs"
    out.mkdir()
    for number in range(1, 13):  # of an earlier run
        for side, picture in zip(("left", "right"), render(pose(number - 1)), strict=True):
            write_png(out / f"{side}{number:04d}.png", picture)
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        shutil.copy(out / f"{side}0001.png", tmp_path / side / "1.png")
    folders = [str(tmp_path / side) for side in ("left", "right")]
    assert main(["capture", *folders, "--board", "10x7", "--square", "30", "--no-page", "--out", str(out)]) == 0
    told = capsys.readouterr()
    assert "12 pairs with the board are in" in told.err and "open http" not in told.err
    assert "0 pairs taken" in told.out and "ended: no more pairs were wanted" in told.out and "missing" not in told.out
    assert f"go on with: stereo-gpu calibrate '{out}' --board 10x7 --square 30 --out rig.json" in told.out


def test_films_of_a_moving_board_give_exactly_the_right_pairs(tmp_path):
    writers = open_writers(tmp_path)
    windows, number = [], 0

    def film(pictures, times):
        nonlocal number
        number += times
        for writer, picture in zip(writers.values(), pictures, strict=True):
            for _ in range(times):
                writer.write(picture[..., ::-1])

    for start, end, new in ((0, 4, True), (4, 0, True), (0, 7, False), (7, 7, True)):
        windows += [(number, number + HELD)] if new else []
        film(render(pose(start)), HELD)
        for step in range(3):
            film(render(between(pose(start), pose(end), (step + 0.5) / 3), 9), 1)
    for writer in writers.values():
        writer.release()
    chooser = BoardChooser(BOARD)
    recording = capture(
        tmp_path / "left.avi", tmp_path / "right.avi", tmp_path / "out", chooser=chooser, interval=0, count=None
    )
    assert recording.taken == 3
    lines = [json.loads(line) for line in (tmp_path / "out" / "pairs.jsonl").read_text().splitlines()]
    for line, (first, last) in zip(lines, windows, strict=True):
        assert first < line["frame"] <= last
    sharp = read_image(tmp_path / "out" / "right0002.png")
    assert BOARD.find(sharp) is not None


def test_a_slow_drift_is_not_still():
    watch = Watch()
    for step in range(12):
        assert watch.see(render(pose(0, (0.5 * step, 0)))) == []  # 0.7 px a frame
    assert watch.chooser.status == "hold still"
    assert watch.see(render(pose(0, (6, 0))), HELD) != []


def test_a_blurred_board_waits_until_it_is_sharp():
    watch = Watch()
    soft = tuple(cv2.GaussianBlur(picture, (0, 0), 3) for picture in render(pose(0)))
    assert watch.see((render(pose(0))[0], soft[1]), HELD) == []
    assert watch.chooser.status.startswith("the right picture is too blurred (edges 7.")
    assert watch.see(render(pose(0)), HELD) != []


def test_a_camera_that_never_gets_sharp_is_taken_as_it_is():
    watch = Watch()
    soft = tuple(cv2.GaussianBlur(picture, (0, 0), 2) for picture in render(pose(0)))
    [taken] = watch.see(soft, 45)
    assert taken > 30


def test_both_cameras_must_see_the_board():
    watch = Watch()
    left, right = render(pose(0))
    empty = np.full_like(right, 120)
    assert watch.see((left, empty), HELD) == []
    assert watch.chooser.status == "the right camera does not see the board: move it to where both look"
    assert watch.see((empty, right), HELD) == []
    assert watch.chooser.status.startswith("the left camera does not see the board")
    assert watch.see((empty, empty)) == []
    assert watch.chooser.status == "show the board of 10x7 squares to both cameras"


def test_a_part_of_a_board_with_markers_counts():
    board = CharucoBoard(10, 7, 30.0, 21.0)
    watch = Watch(board)
    half = render(pose(0, (170, 0)), drawing=moving_boards.charuco())  # its right part lies outside of both pictures
    [taken] = watch.see(half, HELD)
    assert 8 <= taken <= HELD
    assert all(6 <= len(view.ids) < 50 for view in watch.looks[-1].views)
    assert watch.see(tuple(cv2.blur(picture, (9, 1)) for picture in half)) == []
    for step in range(4):
        assert watch.see(render(pose(3, (2 * step, 0)), drawing=moving_boards.charuco())) == []
    assert watch.chooser.status == "hold still"


def test_another_board_is_named():
    watch = Watch(Board(columns=12, rows=9, square=30.0))
    assert watch.see(render(pose(0)), 25) == []
    assert "say 10x7" in watch.chooser.status


def test_a_part_of_a_larger_board_is_not_taken_for_the_whole():
    watch = Watch(Board(columns=8, rows=6, square=30.0), still=False)
    assert watch.see(render(pose(0)), 25) == []
    assert "say 10x7" in watch.chooser.status


def test_it_is_done_when_nothing_is_missing():
    watch = Watch(still=False)
    for number in range(15):
        if not watch.chooser.done:
            watch.see(render(pose(number)))
    looks = watch.looks
    assert [look.pairs for look in looks] == list(range(1, len(looks) + 1))  # all new
    assert 10 <= len(looks) < 15
    assert [look.done for look in looks] == [False] * (len(looks) - 1) + [True]
    assert looks[-1].progress == 1 and looks[-1].missing == ([], []) and looks[-1].wanted == ([], [])
    assert looks[-1].status == "taken: that is enough"
    progress = [look.progress for look in looks]
    assert progress == sorted(progress) and progress[0] < 0.5
    assert "no corner near the top of the picture" in looks[3].missing[0] and "top" in looks[3].wanted[0]


def test_grey_and_large_pictures():
    watch = Watch(still=False)
    sharp = render(pose(0), soft=0.3)
    large = [cv2.resize(picture[..., 0], None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC) for picture in sharp]
    assert watch.see(large) == [1]
    corners = watch.looks[0].views[0].corners
    known = BOARD.find(large[0]).corners
    assert min(np.abs(corners - known).max(), np.abs(corners - known[::-1]).max()) < 2  # 1 px of the shrunk picture


def test_pictures_that_change_their_size_are_refused():
    watch = Watch()
    watch.see(render(pose(0)))
    with pytest.raises(InputError, match="changed from 640 x 480 to 320 x 240 px"):
        watch.see([picture[::2, ::2] for picture in render(pose(0))])


@pytest.fixture(scope="module")
def real_pairs(data):
    folder = data / "calibration" / "board_10x7"
    return [
        (read_image(left), read_image(left.with_name(left.name.replace("left", "right"))))
        for left in sorted(folder.glob("left*.jpg"))
    ]


def test_real_boards(real_pairs):
    """All 13 pairs twice: as the pictures of a folder, and the first ones as if a hand held them."""
    watch = Watch(still=False)
    taken = [len(watch.see(pair)) for pair in real_pairs]
    assert sum(taken) >= 10  # some are held nearly alike
    assert watch.chooser.coverage.missing() == ([], [])
    assert watch.chooser.done
    assert [watch.see(pair) for pair in real_pairs] == [[]] * 13
    held = Watch()
    assert [len(held.see(pair, HELD)) for pair in real_pairs[:2]] == taken[:2]


def test_a_part_of_a_real_larger_board_is_refused(real_pairs):
    watch = Watch(Board(columns=9, rows=7, square=30.0), still=False)
    assert [watch.see(pair) for pair in real_pairs[:2]] == [[]] * 2
    assert watch.chooser.status == "found 9x6 inner corners = 10x7 squares: say 10x7"
