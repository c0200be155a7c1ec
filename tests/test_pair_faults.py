"""What can be wrong with the pairs as a whole: each fault is made, and must be named with its way out."""

import dataclasses
import re

import boards
import corner_pairs
import numpy as np
import pytest

from stereo_gpu.boards.board import Board, BoardView
from stereo_gpu.boards.board_pairs import find_pairs
from stereo_gpu.calibrate import calibrate
from stereo_gpu.calibration.fit import fit_pairs
from stereo_gpu.calibration.movement import out_of_step
from stereo_gpu.errors import CalibrationError, PictureError
from stereo_gpu.images import read_image, write_png


def fit(pairs):
    return fit_pairs(pairs, corner_pairs.SIZES, corner_pairs.BOARD, 5)


def paired(lefts, rights):
    """The left views of some pairs with the right views of others."""
    return [
        dataclasses.replace(one, names=(one.names[0], other.names[1]), views=[one.views[0], other.views[1]])
        for one, other in zip(lefts, rights, strict=False)
    ]


def mirrored(view):
    """What the finder gives on the mirrored picture: it lists rows from their other ends, so as to go clockwise."""
    columns, rows = corner_pairs.BOARD.corners
    corners = view.corners.copy()
    corners[:, 0] = boards.SIZE[0] - 1 - corners[:, 0]
    return BoardView.whole(np.ascontiguousarray(corners.reshape(rows, columns, 2)[:, ::-1].reshape(-1, 2)))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_good_pairs_are_all_used(seed):
    found = fit(corner_pairs.pairs(seed=seed))
    assert [pair.reason for pair in found.pairs] == [""] * 12
    assert found.move is None
    np.testing.assert_allclose(found.bundle.T, corner_pairs.SHIFT, atol=1.5)


@pytest.mark.parametrize("shift", [1, -1, 2, -3])
def test_lists_that_are_shifted(shift):
    pairs = corner_pairs.pairs(12)
    shifted = paired(pairs, pairs[shift:]) if shift > 0 else paired(pairs[-shift:], pairs)
    with pytest.raises(CalibrationError, match="the lists are shifted by") as caught:
        fit(shifted)
    told = str(caught.value)
    one, other = re.search(r"left(\d\d)\.png belongs with right(\d\d)\.png", told).groups()
    assert one == other
    number = abs(shift)
    early, late = ("left", "right") if shift > 0 else ("right", "left")
    first, last = ("picture", "last") if number == 1 else (f"{number} pictures", f"last {number}")
    assert f"leave out the first {first} of the {early} camera and the {last} of the {late} one" in told


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_camera_that_mirrors(side):
    pairs = corner_pairs.pairs(10)
    at = ("left", "right").index(side)
    for pair in pairs:
        pair.views[at] = mirrored(pair.views[at])
    with pytest.raises(CalibrationError, match=f"the {side} camera's pictures are mirrored, the other's are not"):
        fit(pairs)


@pytest.mark.parametrize("first", [3, 6, 9])
@pytest.mark.parametrize("degrees", [0.3, 1.0, 5.0, 20.0])
def test_cameras_that_moved(first, degrees):
    before = corner_pairs.pairs(12, seed=4)
    after = corner_pairs.pairs(12, seed=4, rotation=corner_pairs.turned(degrees), shift=corner_pairs.SHIFT + degrees)
    with pytest.raises(CalibrationError, match="the cameras moved") as caught:
        fit(before[:first] + after[first:])
    assert f"between left{first:02d}.png and left{first + 1:02d}.png" in str(caught.value)
    assert f"--pairs 1-{first} or --pairs {first + 1}-12" in str(caught.value)


@pytest.mark.parametrize("first", [3, 6, 8])
def test_cameras_that_were_exchanged_on_the_way(first):
    pairs = corner_pairs.pairs(12, seed=5)
    for pair in pairs[:first]:
        pair.views.reverse()
    with pytest.raises(CalibrationError, match=f"between left{first:02d}.png and left{first + 1:02d}.png"):
        fit(pairs)


def test_cameras_that_moved_within_some_of_the_pairs():
    before = corner_pairs.pairs(12, seed=4)[3:]
    after = corner_pairs.pairs(12, seed=4, rotation=corner_pairs.turned(1.0))[3:]
    with pytest.raises(CalibrationError, match="pairs 4 to 8 agree on one rig, 9 to 12 on another") as caught:
        fit(before[:5] + after[5:])
    assert "--pairs 4-8 or --pairs 9-12" in str(caught.value)


def test_cameras_that_moved_a_little_raise_a_doubt():
    before = corner_pairs.pairs(12, seed=4)
    after = corner_pairs.pairs(12, seed=4, rotation=corner_pairs.turned(0.06))
    move = fit(before[:5] + after[5:]).move
    assert move is not None and move.first == 5
    assert move.degrees == pytest.approx(0.06, abs=0.03)


@pytest.mark.parametrize("count", [6, 8, 14])
def test_cameras_out_of_step_did_not_move(count):
    # The board went on by a millimetre or so until the right camera took its picture.
    random = np.random.default_rng(count)
    truth = corner_pairs.truth(count, seed=count)
    later = dataclasses.replace(truth, translations=truth.translations + random.normal(0, 1.5, (count, 3)))
    left, right = corner_pairs.corners_of(truth, 1)[0], corner_pairs.corners_of(later, 2)[1]
    found = fit(corner_pairs.as_pairs((left, right)))
    assert found.move is None
    assert out_of_step(found.normal) > 0.5
    assert out_of_step(fit(corner_pairs.pairs(count, seed=count)).normal) < 0.2


def test_pairs_in_any_other_order():
    pairs = corner_pairs.pairs(9)
    with pytest.raises(CalibrationError, match="do not agree on one rig"):
        fit(paired(pairs, [pairs[number] for number in (4, 8, 1, 6, 3, 0, 7, 2, 5)]))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_boards_that_were_never_tilted(seed):
    with pytest.raises(CalibrationError, match="focal length of the left camera is not determined") as caught:
        fit(corner_pairs.pairs(12, seed=seed, tilt=0.0))
    assert "never tilted left or right" in str(caught.value)
    assert "tilted by 30 degrees" in str(caught.value)


def test_a_few_wrong_corners_cost_their_pair():
    pairs = corner_pairs.pairs(12)
    pairs[4].views[1].corners[[3, 7, 20]] += 4
    found = fit(pairs)
    assert [number for number, pair in enumerate(found.pairs) if pair.reason] == [4]
    assert "does not fit the right camera" in found.pairs[4].reason
    assert "3 of 48 corners are off by up to" in found.pairs[4].reason
    np.testing.assert_allclose(found.bundle.T, corner_pairs.SHIFT, atol=1.5)


def test_a_board_that_moved_between_the_two_pictures_costs_its_pair():
    pairs = corner_pairs.pairs(12)
    pairs[7].views[1] = BoardView.whole(pairs[7].views[1].corners + np.float32(1.5))
    found = fit(pairs)
    assert [number for number, pair in enumerate(found.pairs) if pair.reason] == [7]
    assert "left and right do not fit together" in found.pairs[7].reason


def test_pairs_given_are_not_changed():
    pairs = corner_pairs.pairs(12)
    pairs[4].views[1].corners[0] += 9
    fit(pairs)
    assert all(not pair.reason for pair in pairs)


@pytest.fixture(scope="module")
def pictures():
    rendered = []
    for number, pose in enumerate(boards.poses(corner_pairs.BOARD, 6, seed=8)):
        right = boards.moved(*pose, corner_pairs.ROTATION, corner_pairs.SHIFT)
        rendered.append(
            [
                boards.render(corner_pairs.BOARD, lens, *there, seed=number)
                for lens, there in ((boards.LEFT, pose), (boards.RIGHT, right))
            ]
        )
    return [list(side) for side in zip(*rendered, strict=True)]


def test_both_cameras_that_mirror_look_like_swapped_ones(pictures):
    flipped = [[np.ascontiguousarray(picture[:, ::-1]) for picture in side] for side in pictures]
    with pytest.raises(CalibrationError, match="left and right look swapped, or both cameras mirror their pictures"):
        calibrate(*flipped, corner_pairs.BOARD)


def test_mixed_sizes_name_the_files(pictures, tmp_path):
    left = [write_png(tmp_path / f"left{number}.png", picture) for number, picture in enumerate(pictures[0])]
    write_png(left[2], pictures[0][2][:-2])
    write_png(left[5], pictures[0][5][:, 3:])
    with pytest.raises(PictureError) as caught:
        calibrate(left, pictures[1], corner_pairs.BOARD)
    assert str(caught.value) == (
        "the left pictures differ in size: 4 of 6 are 480 x 360 px, but left2.png is 480 x 358, left5.png is 477 x 360:"
        " leave these out, or take all pictures of a camera in one size"
    )


@pytest.fixture(scope="module")
def real(data):
    """The boards found in real pairs; and in the same right pictures, mirrored."""
    folder, board = data / "calibration" / "board_10x7", Board(10, 7, 30.0)
    left, right = (sorted(folder.glob(f"{side}*.jpg"))[:6] for side in ("left", "right"))
    found, sizes = find_pairs(left, right, board, None)
    flipped = [board.find(np.ascontiguousarray(read_image(path)[:, ::-1])) for path in right]
    return board, found, sizes, flipped


def test_faults_of_real_pairs(real):
    board, found, sizes, flipped = real
    assert all(not pair.reason for pair in fit_pairs(found, sizes, board, 5).pairs)
    with pytest.raises(CalibrationError, match="shifted by one picture"):
        fit_pairs(paired(found, found[1:]), sizes, board, 5)
    one = [dataclasses.replace(pair, views=[pair.views[0], other]) for pair, other in zip(found, flipped, strict=True)]
    with pytest.raises(CalibrationError, match="the right camera's pictures are mirrored"):
        fit_pairs(one, sizes, board, 5)
