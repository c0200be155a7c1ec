"""What two cameras cover together."""

import moving_boards
import pytest
from moving_boards import BOARD, pose, render

from stereo_gpu.boards.pair_coverage import PairCoverage, by_picture
from stereo_gpu.images import grey
from stereo_gpu.recording.quick_find import QuickFinder


@pytest.fixture(scope="module")
def views():
    """Left and right view of fifteen poses that fill both pictures."""
    return [
        tuple(QuickFinder(BOARD).find(grey(picture)) for picture in render(pose(number)))
        for number in range(len(moving_boards.SCENE.board_poses))
    ]


def test_progress_goes_up_until_it_is_done(views):
    coverage = PairCoverage(moving_boards.SIZE, BOARD)
    assert coverage.progress == 0 and not coverage.done
    assert coverage.missing() == (["no view of the board"],) * 2
    shares = []
    for number, pair in enumerate(views):
        assert coverage.is_new(*pair) or number > 10
        coverage.add(*pair)
        assert not coverage.is_new(*pair)
        shares.append(coverage.progress)
        assert coverage.done == (shares[-1] == 1)
        assert (coverage.missing() == ([], [])) <= (coverage.wanted_regions() == ([], []))
    assert shares == sorted(shares) and shares[-1] == 1
    assert coverage.next_step() == "hold it at another place or tilt"


def test_few_pairs_are_not_enough_however_much_they_cover(views):
    coverage = PairCoverage(moving_boards.SIZE, BOARD)
    for pair in views:
        coverage.add(*pair)
    coverage.pairs = 9
    assert coverage.missing() == ([], []) and not coverage.done
    assert 0.9 < coverage.progress < 1


def test_the_next_step_names_the_picture(views):
    coverage = PairCoverage(moving_boards.SIZE, BOARD)
    for pair in views[:4]:
        coverage.add(*pair)
    left, right = coverage.wanted_regions()
    assert {"top", "bottom"} <= set(left) & set(right)
    assert coverage.next_step() in {
        f"move it to the {name} of the {side} picture" for name in left for side in ("left", "right")
    }


def test_a_change_that_one_camera_sees_is_new(views):
    coverage = PairCoverage(moving_boards.SIZE, BOARD)
    coverage.add(*views[0])
    assert coverage.is_new(views[0][0], views[3][1]) and coverage.is_new(views[3][0], views[0][1])


def test_what_both_lack_is_said_once():
    assert by_picture((["a", "b"], ["b", "c"])) == [
        ("both pictures", ["b"]),
        ("left picture", ["a"]),
        ("right picture", ["c"]),
    ]
    assert by_picture(([], ["c"])) == [("right picture", ["c"])]
    assert by_picture(([], [])) == []
