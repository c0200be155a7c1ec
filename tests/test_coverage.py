"""Where boards were, how they leaned, and what is said to be missing."""

import boards
import cv2
import numpy as np
import pytest

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.coverage import Coverage, Tilt, missing_in_both
from stereo_gpu.boards.placement import place

BOARD = Board(columns=10, rows=7, square=30.0)
SIZE = boards.SIZE


def seen(x=0.5, y=0.5, distance=600.0, lean_x=0.0, lean_y=0.0, camera=boards.LEFT, turned=0.0):
    """The board's corners: its middle at a share of the picture, leaning by degrees as `Placement` counts them."""
    # A turn about y by a positive angle brings x > 0 nearer (z smaller); one about x by a positive angle y > 0 farther.
    around_y = cv2.Rodrigues(np.array([0, np.radians(lean_x), 0]))[0]
    around_x = cv2.Rodrigues(np.array([-np.radians(lean_y), 0, 0]))[0]
    rotation = around_y @ around_x @ cv2.Rodrigues(np.array([0, 0, np.radians(turned)]))[0]
    matrix = camera[0]
    pixel = np.array([x * SIZE[0], y * SIZE[1], 1.0])
    middle = BOARD.points.astype(np.float64).mean(axis=0)
    translation = distance * np.linalg.solve(matrix, pixel) - rotation @ middle
    return BoardView.whole(boards.project(BOARD, camera, cv2.Rodrigues(rotation)[0], translation).astype(np.float32))


@pytest.mark.parametrize(
    ("lean_x", "lean_y", "tilts"),
    [
        (0, 0, {Tilt.FLAT}),
        (4, -5, {Tilt.FLAT}),
        (30, 0, {Tilt.RIGHT}),
        (-30, 0, {Tilt.LEFT}),
        (0, 30, {Tilt.DOWN}),
        (0, -30, {Tilt.UP}),
        (25, -25, {Tilt.RIGHT, Tilt.UP}),
    ],
)
def test_a_lean_is_told_with_its_direction(lean_x, lean_y, tilts):
    coverage = Coverage(SIZE, BOARD)
    coverage.add(seen(lean_x=lean_x, lean_y=lean_y))
    assert coverage.tilts == tilts


def test_the_nearer_edge_gives_the_tilt_its_name():
    grid = seen(lean_x=30).corners.reshape(6, 9, 2)
    left, right = (np.linalg.norm(grid[-1, column] - grid[0, column]) for column in (0, -1))
    assert right > 1.15 * left
    grid = seen(lean_y=-30).corners.reshape(6, 9, 2)
    upper, lower = (np.linalg.norm(grid[row, -1] - grid[row, 0]) for row in (0, -1))
    assert upper > 1.1 * lower


def test_angles_are_right_within_what_the_guess_allows():
    for angle in (-50, -30, -15, 15, 30, 50):
        placement = place(seen(lean_x=angle), BOARD, SIZE)
        assert placement.lean_degrees == pytest.approx(abs(angle), abs=5)
        assert np.sign(placement.lean_x) == np.sign(angle)
        assert abs(placement.lean_y) < 0.06


def test_a_board_turned_in_its_plane_leans_alike():
    straight, turned, over = (place(seen(lean_x=30, turned=angle), BOARD, SIZE) for angle in (0, 90, 180))
    assert turned.lean_x == pytest.approx(straight.lean_x, abs=0.08)
    assert over.lean_x == pytest.approx(straight.lean_x, abs=1e-2)
    assert abs(turned.lean_y) < 0.1


def test_place_and_size():
    placement = place(seen(x=0.6, y=0.4), BOARD, SIZE)
    assert (placement.x, placement.y) == pytest.approx((0.6, 0.4), abs=0.02)
    # 240 x 150 mm at 600 mm with 420 px: 168 x 105 px of 480 x 360
    assert placement.size == pytest.approx(np.sqrt(168 * 105 / (480 * 360)), rel=0.05)
    assert place(seen(distance=300), BOARD, SIZE).size == pytest.approx(2 * placement.size, rel=0.12)


def test_a_part_of_a_board_has_the_size_of_the_whole():
    whole = seen(lean_x=20)
    grid = np.arange(54, dtype=np.int32).reshape(6, 9)
    part = whole.only(grid[:, 4:].reshape(-1))
    assert place(part, BOARD, SIZE).size == pytest.approx(place(whole, BOARD, SIZE).size, rel=0.15)
    assert place(whole.only(grid[0]), BOARD, SIZE) is None  # a row is a line
    assert place(whole.only(grid[:2, :2].reshape(-1)), BOARD, SIZE) is None  # too few


def test_cells_count_views():
    coverage = Coverage(SIZE, BOARD)
    assert coverage.cells.shape == (6, 8)
    assert coverage.share == 0
    assert coverage.missing() == ["no view of the board"]
    assert coverage.progress() == 0
    # A pixel's centre is a whole number: the picture goes from -0.5 to 479.5.
    corners = np.float32([[-0.4, -0.4], [479.4, 359.4], [59.4, 10], [59.6, 10]])
    coverage.add(BoardView(corners, np.int32([0, 1, 2, 3])))
    expected = np.zeros((6, 8), int)
    expected[0, 0] = expected[5, 7] = expected[0, 1] = 1
    assert np.array_equal(coverage.cells, expected)
    assert coverage.share == pytest.approx(3 / 48)
    coverage.add(BoardView(corners[:1], np.int32([0])))
    assert coverage.cells[0, 0] == 2 and coverage.views == 2


def test_corners_outside_the_picture_count_at_its_edge():
    coverage = Coverage(SIZE, BOARD)
    coverage.add(BoardView(np.float32([[-5, 100], [500, 400]]), np.int32([0, 1])))
    assert coverage.cells.sum() == 2 and coverage.cells[5, 7] == 1


def test_new_places_and_tilts_are_new_and_the_same_again_is_not():
    coverage = Coverage(SIZE, BOARD)
    assert coverage.is_new(seen())
    coverage.add(seen())
    assert not coverage.is_new(seen())
    assert not coverage.is_new(seen(x=0.52, y=0.51, lean_x=4))
    for other in (seen(x=0.28), seen(y=0.72), seen(lean_x=35), seen(lean_y=-35), seen(distance=330)):
        assert coverage.is_new(other)
        coverage.add(other)
        assert not coverage.is_new(other)


def test_a_step_into_empty_cells_is_new():
    coverage = Coverage(SIZE, BOARD)
    coverage.add(seen(x=0.4, distance=450))
    closer_to_the_edge = seen(x=0.29, distance=450)
    change = place(closer_to_the_edge, BOARD, SIZE).x - coverage.placements[0].x
    assert -0.15 < change < -0.05  # little by itself, but a column of cells gets its first corners
    assert coverage.is_new(closer_to_the_edge)
    coverage.add(seen(x=0.2, distance=450))
    assert not coverage.is_new(closer_to_the_edge)


def test_a_thin_part_of_a_board_is_new_where_no_corner_was():
    coverage = Coverage(SIZE, BOARD)
    coverage.add(seen())
    row = BoardView(np.float32([[20 + 60 * n, 20] for n in range(5)]), np.arange(5, dtype=np.int32))
    assert coverage.is_new(row)
    coverage.add(row)
    assert not coverage.is_new(row)
    assert len(coverage.placements) == 1  # a line has no lean


def test_what_is_missing_is_said_in_words():
    coverage = Coverage(SIZE, BOARD)
    coverage.add(seen())
    assert coverage.missing() == [
        "the board was never tilted left or right",
        "the board was never tilted up or down",
        "no corner near the left edge of the picture",
        "no corner near the right edge of the picture",
        "no corner near the top edge of the picture",
        "no corner near the bottom edge of the picture",
        "the board was always at about the same distance: bring it closer",
    ]
    assert coverage.next_step() == "tilt it left or right"
    before = coverage.progress()
    coverage.add(seen(x=0.25, lean_x=30))
    assert before < coverage.progress() < 1
    coverage.add(seen(y=0.3, x=0.3, lean_y=30, distance=400))
    assert "the board was never tilted left or right" not in coverage.missing()
    assert "the board was never tilted up or down" not in coverage.missing()
    assert "no corner near the left edge of the picture" not in coverage.missing()
    assert not any("distance" in line for line in coverage.missing())
    assert "no corner near the bottom edge of the picture" in coverage.missing()
    coverage.add(seen(x=0.77, y=0.75))
    coverage.add(seen(x=0.8))
    assert coverage.missing() == [
        "no corner near the top right of the picture",
        "no corner near the bottom left of the picture",
    ]
    assert coverage.next_step() == "move it to the top right"


def full(size=SIZE):
    """Views after which nothing is missing."""
    coverage = Coverage(size, BOARD)
    for x in (0.22, 0.5, 0.78):
        for y in (0.22, 0.5, 0.78):
            coverage.add(seen(x=x, y=y, lean_x=110 * (x - 0.5), lean_y=110 * (y - 0.5)))
    coverage.add(seen(distance=350))
    return coverage


def test_nothing_is_missing_in_the_end():
    coverage = full()
    assert coverage.missing() == []
    assert coverage.next_step() == ""
    assert coverage.progress() == 1
    assert coverage.share >= 0.6
    assert coverage.tilts == set(Tilt)


def test_a_side_that_the_other_camera_cannot_see_is_not_asked_for():
    left, right = full(), full()
    left.cells[:, :2] = 0  # as where the cameras stand far apart
    right.cells[:, 6:] = 0
    assert left.missing() and right.missing()
    assert missing_in_both(left, right) == ([], [])
    right.cells[:, :2] = 0  # a board that never came to the left at all
    assert "no corner near the left edge of the picture" in missing_in_both(left, right)[0]
    left.cells[:2] = 0
    assert any("top" in line for line in missing_in_both(left, right)[0])


def test_real_boards(data):
    """What was seen of both cameras' 13 views: enough, but for the sides that one camera alone sees."""
    from stereo_gpu.images import grey, read_image
    from stereo_gpu.recording.quick_find import QuickFinder

    coverages = []
    for side in ("left", "right"):
        coverage = Coverage((640, 480), BOARD)
        for file in sorted((data / "calibration" / "board_10x7").glob(f"{side}*.jpg")):
            coverage.add(QuickFinder(BOARD).find(grey(read_image(file))))
        coverages.append(coverage)
    assert all(coverage.views == 13 and coverage.share >= 0.6 for coverage in coverages)
    assert coverages[1].missing() == ["no corner near the right edge of the picture"]
    assert missing_in_both(*coverages) == ([], [])
