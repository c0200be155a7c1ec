"""Printed boards: measured in the files as a ruler would measure the paper."""

import io
import re

import boards
import cv2
import numpy as np
import pytest
from PIL import Image

import stereo_gpu as sg
from stereo_gpu.boards.board_print import choose_dots, rasterise
from stereo_gpu.boards.charuco import CharucoBoard
from stereo_gpu.boards.sheet import PAPERS, lay_out
from stereo_gpu.cli import main
from stereo_gpu.errors import InputError

PLAIN = sg.Board(10, 7, 26.0)
MARKED = CharucoBoard(10, 7, 26.0, 19.0)
TRUE_MM = 0.1  # what the issue allows a square
POINT = 25.4 / 72


def read_pdf(path):
    """Width, height and the black rectangles of a page of ours, mm from the top left corner, y down."""
    content = path.read_bytes()
    width, height = (float(value) * POINT for value in re.search(rb"/MediaBox \[0 0 (\S+) (\S+)\]", content).groups())
    rows = re.findall(rb"^(\S+) (\S+) (\S+) (\S+) re$", content, re.M)
    rectangles = np.array(rows, np.float64) * POINT
    rectangles[:, 1] = height - rectangles[:, 1] - rectangles[:, 3]
    return width, height, rectangles


def drawn(width, height, rectangles, dots=10):
    """The page with `dots` a mm."""
    page = np.full((round(height * dots), round(width * dots)), 255, np.uint8)
    ends = np.hstack([rectangles[:, :2], rectangles[:, :2] + rectangles[:, 2:]])
    for left, top, right, bottom in np.round(ends * dots).astype(int):
        page[top:bottom, left:right] = 0
    return page


def grid_mm(view, board, dots):
    """Corners of a view of the whole page, mm, as rows and columns."""
    columns, rows = board.corners
    return (view.corners.reshape(rows, columns, 2) + 0.5) / dots


def check_squares(board, grid):
    for axis, count in enumerate(board.corners):
        along = grid[..., axis] if axis == 0 else grid[..., axis].T
        np.testing.assert_allclose(np.abs(np.diff(along, axis=1)), board.square, atol=TRUE_MM)
        np.testing.assert_allclose(np.abs(along[:, -1] - along[:, 0]), board.square * (count - 1), atol=TRUE_MM)


@pytest.mark.parametrize("board", [PLAIN, MARKED], ids=["checkerboard", "ChArUco"])
@pytest.mark.parametrize("paper", ["a4", "letter", "fit"])
def test_a_pdf_has_true_size(board, paper, tmp_path):
    printed = sg.print_board(board, tmp_path / "board.pdf", paper=paper)
    width, height, rectangles = read_pdf(printed.path)
    if paper != "fit":
        np.testing.assert_allclose(sorted((width, height)), PAPERS[paper], atol=0.01)
    assert (printed.width_mm, printed.height_mm) == pytest.approx((width, height), abs=0.01)
    squares = rectangles[np.isclose(rectangles[:, 2:], board.square, atol=0.01).all(axis=1)]
    assert len(squares) == 35
    left, top = squares[:, :2].min(axis=0)
    right, bottom = (squares[:, :2] + squares[:, 2:]).max(axis=0)
    assert right - left == pytest.approx(260, abs=0.01)
    assert bottom - top == pytest.approx(182, abs=0.01)
    assert left == pytest.approx(width - right, abs=0.01)  # centred
    assert min(left, top) > 5 and height - bottom > 10  # white around it
    view = board.find(drawn(width, height, rectangles))
    check_squares(board, grid_mm(view, board, 10))


@pytest.mark.parametrize("board", [PLAIN, MARKED, sg.Board(5, 8, 1.0, "in")], ids=["checkerboard", "ChArUco", "inches"])
def test_a_png_has_true_size(board, tmp_path):
    printed = sg.print_board(board, tmp_path / "board.png", paper="a4")
    with Image.open(printed.path) as page:
        assert page.mode == "1"
        across, down = page.info["dpi"]
    assert across == down == pytest.approx(printed.dots_per_mm * 25.4, rel=1e-4)
    picture = sg.read_image(printed.path)
    view = board.find(picture)
    in_mm = sg.Board(board.columns, board.rows, board.square * (25.4 if board.unit == "in" else 1))
    check_squares(in_mm, grid_mm(view, board, across / 25.4))
    assert (printed.dots_per_mm * in_mm.square) % 1 == pytest.approx(0, abs=1e-6)  # whole dots


def test_markers_of_a_png_have_true_size_too():
    board = CharucoBoard(10, 7, 30.0, 22.0)
    sheet = lay_out(board, "a3")
    dots = choose_dots(board, sheet)
    # 105 dots a square and 11 a cell: nothing is rounded.
    assert dots * 30 % 105 == pytest.approx(0) and 8 < dots < 16
    page = rasterise(sheet, dots)
    found = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)).detectMarkers(page)
    sides = np.linalg.norm(np.diff(np.array(found[0])[:, 0], axis=1), axis=-1) / dots
    assert len(sides) == 35
    np.testing.assert_allclose(sides, 22.0, atol=2 / dots)  # the detector counts whole pixels


def test_the_ruler_and_the_words():
    sheet = lay_out(PLAIN, "a4")
    assert sheet.ruler_length == 100
    ticks = sheet.ruler[sheet.ruler[:, 2] < 1]
    np.testing.assert_allclose(np.diff(np.sort(ticks[:, 0])), 10.0)
    assert sheet.ruler[:, 1].min() > sheet.origin[1] + 182 + 2
    text = " ".join(words.text for words in sheet.words)
    assert "print at 100 %" in text and "10 x 7 squares of 26 mm" in text and "100 mm" in text
    assert "dictionary 5x5_250, markers of 19 mm" in " ".join(words.text for words in lay_out(MARKED, "a4").words)
    for board, paper in (
        (PLAIN, "a4"),
        (MARKED, "fit"),
        (sg.Board(4, 4, 12.0), "a5"),
        (sg.Board(4, 4, 1.0), "fit"),
        (sg.Board(5, 8, 25.0), "fit"),
    ):
        sheet = lay_out(board, paper)
        assert sheet.ruler_length <= board.columns * board.square
        assert (sheet.ruler[:, 1] + sheet.ruler[:, 3]).max() < sheet.height - 5
        for words in sheet.words:
            assert words.x > 5 and words.y < sheet.height - 4
            assert words.x + 0.5 * words.size * len(words.text) < sheet.width


def test_a_photo_of_the_print_calibrates(tmp_path):
    board = CharucoBoard(8, 6, 30.0, 22.0)
    printed = sg.print_board(board, tmp_path / "board.png")
    page, sheet = sg.read_image(printed.path), lay_out(board, "fit")
    left, top = (round(place * printed.dots_per_mm) for place in sheet.origin)
    size = round(30 * printed.dots_per_mm)
    drawing = page[top : top + 6 * size, left : left + 8 * size]
    assert {int(drawing[0, 0]), int(drawing[-1, 0])} == {0, 255}
    turn, shift = cv2.Rodrigues(np.array([0.02, -0.06, 0.01]))[0], np.array([-60.0, 1.5, 2.0])
    small = cv2.resize(drawing, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    taken = [], []
    for number, pose in enumerate(boards.poses(board, 5, seed=8)):
        taken[0].append(boards.photograph(small, board, boards.LEFT, *pose, seed=2 * number))
        second = boards.moved(*pose, turn, shift)
        taken[1].append(boards.photograph(small, board, boards.RIGHT, *second, seed=2 * number + 1))
    rig = sg.calibrate(*taken, board, coefficients=5)
    assert rig.baseline == pytest.approx(np.linalg.norm(shift), rel=0.01)


@pytest.mark.parametrize(
    ("board", "name", "paper", "told"),
    [
        (sg.Board(10, 7, 30.0), "b.pdf", "a4", "does not fit a4: the largest that fits are 26.5 mm"),
        (sg.Board(100, 100, 30.0), "b.pdf", "a5", "the largest that fits are 1 mm"),
        (PLAIN, "b.pdf", "a9", "paper 'a9': give one of a0, a1"),
        (PLAIN, "b.jpg", "a4", "name a file that ends in .pdf or .png"),
        (PLAIN, "b", "a4", "name a file that ends in .pdf or .png"),
        (sg.Board(10, 7, 3.0, "furlong"), "b.pdf", "a4", "board unit 'furlong' has no length on paper"),
        (sg.Board(200, 200, 30.0), "b.pdf", "fit", "5080 mm is the limit: take smaller squares"),
        (sg.Board(160, 160, 30.0), "b.png", "fit", "too many dots for a PNG: name a file that ends in .pdf"),
        (sg.Board(10, 7, 1e6), "b.pdf", "fit", "needs a page of 1e+07 x 7.00002e+06 mm"),
        (sg.Board(10, 7, 0.4), "b.pdf", "fit", "squares of 0.4 mm are too small to print: take 0.5 mm or more"),
        (CharucoBoard(10, 7, 0.5, 0.3), "b.png", "fit", "too small for the dots of a PNG"),
    ],
)
def test_what_cannot_be_printed(board, name, paper, told, tmp_path):
    with pytest.raises(InputError, match=re.escape(told)):
        sg.print_board(board, tmp_path / name, paper=paper)
    assert not list(tmp_path.iterdir())


def test_the_largest_square_told_does_fit():
    lay_out(sg.Board(10, 7, 26.5), "a4")
    lay_out(sg.Board(100, 100, 1.0), "a5")


def test_the_command(tmp_path, capsys):
    out = tmp_path / "board.pdf"
    given = ["board", "--board", "10x7", "--square", "26", "--marker", "19", "--dictionary", "4x4_50"]
    assert main([*given, "--out", str(out), "--paper", "a4"]) == 0
    told = capsys.readouterr().out
    assert "10x7 squares with markers of 4x4_50, 26 mm each, on a page of 297.0 x 210.0 mm" in told
    assert "10 squares must measure 260 mm" in told
    assert out.read_bytes().startswith(b"%PDF-")
    assert main([*given, "--out", str(tmp_path / "no" / "board.pdf")]) == 2
    assert "there is no folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--board", "10x7", "--square", "26", "--dictionary", "4x4_50"], "stands without --marker"),
        (["--board", "10", "--square", "26"], "such as 10x7"),
        (["--board", "10x7", "--square", "26", "--marker", "26"], "marker is 26"),
        (["--board", "10x7"], "--square"),
    ],
)
def test_the_command_refuses(given, told, tmp_path, capsys):
    assert main(["board", *given, "--out", str(tmp_path / "b.pdf")]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1


def test_the_pdf_is_one_that_readers_accept(tmp_path):
    content = sg.print_board(MARKED, tmp_path / "b.pdf").path.read_bytes()
    start = int(re.search(rb"startxref\n(\d+)\n%%EOF\n$", content)[1])
    assert content[start : start + 4] == b"xref"
    places = [int(place) for place in re.findall(rb"^(\d{10}) 00000 n $", content, re.M)]
    for number, place in enumerate(places, 1):
        assert content[place:].startswith(b"%d 0 obj\n" % number)
    length = int(re.search(rb"/Length (\d+)", content)[1])
    stream = content[content.index(b"stream\n") + 7 :]
    assert stream[length:].startswith(b"\nendstream")
    assert io.BytesIO(stream[:length]).readline() == b"0 g\n"
