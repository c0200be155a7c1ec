"""Pictures with epipolar lines: lines go through their points, bend with the lens, and end at the border."""

import numpy as np
import pytest
import two_views

from stereo_gpu.epipolar.figure import draw_epipolar_curves, draw_epipolar_lines
from stereo_gpu.errors import PictureError

WHITE = np.full((480, 640), 255, np.uint8)


def colours_at(picture, points):
    """The colours next to each point, (N, M, 3)."""
    x, y = np.rint(points).astype(int).T
    return np.stack([picture[y + dy, x + dx] for dy in range(-5, 6) for dx in range(-5, 6)], axis=1)


def coloured(picture):
    """(H, W) whether something was drawn."""
    return np.ptp(picture.astype(int), axis=2) > 100


@pytest.mark.parametrize("lens", [0.0, -0.25])
def test_every_point_lies_on_its_line(lens):
    rig = two_views.rig((lens, 0.0, 0.0, 0.0, 0.0))
    points = two_views.see(rig, two_views.room(400))
    inside = np.logical_and(*(((p > 20) & (p < [619, 459])).all(axis=1) for p in points))
    left, right = (side[inside] for side in points)
    drawn = draw_epipolar_curves(WHITE, WHITE, rig, left, right, count=6)
    if lens == 0:
        lines = draw_epipolar_lines(WHITE, WHITE, two_views.fundamental(rig), left, right, count=6)
        for one, other in zip(drawn, lines, strict=True):
            assert (np.abs(one.astype(int) - other).max(axis=2) > 30).mean() < 0.002
    for picture in drawn:
        assert picture.shape == (480, 640, 3) and picture.dtype == np.uint8
        seen = coloured(picture)
        # Each of six lines crosses the picture from the left to the right border.
        assert 4 <= np.diff(np.pad(seen[:, 2].astype(int), 1)).clip(0).sum() <= 6
        assert 4 <= np.diff(np.pad(seen[:, -3].astype(int), 1)).clip(0).sum() <= 6


def test_points_and_lines_of_one_colour():
    rig = two_views.rig()
    left, right = two_views.see(rig, two_views.room(1, seed=4))
    marked = draw_epipolar_lines(WHITE, WHITE, two_views.fundamental(rig), left, right)
    shades = []
    for picture, point in zip(marked, (left[0], right[0]), strict=True):
        y, x = np.nonzero(coloured(picture))
        shades.append(np.unique(picture[np.ptp(picture.astype(int), axis=2) > 160], axis=0)[0])
        slope, level = np.polyfit(x, y, 1)
        assert abs(slope * point[0] + level - point[1]) < 1.5
    assert (shades[0] == shades[1]).all()


def test_any_picture_and_no_points():
    F = two_views.fundamental(two_views.rig())
    none = np.zeros((0, 2))
    colour = np.full((50, 60, 3), 4000, np.uint16)
    one, other = draw_epipolar_lines(colour, WHITE, F, none, none)
    assert one.shape == (50, 60, 3) and other.shape == (480, 640, 3)
    assert not coloured(one).any() and not coloured(other).any()
    # A line outside of the picture is not drawn, and neither is one that is none.
    points = np.array([[10.0, 5000.0]])
    drawn = draw_epipolar_lines(WHITE, WHITE, np.array([[0, 0, 0], [0, 0, -1.0], [0, 1, 0]]), points, points)
    assert not coloured(drawn[0]).any()
    draw_epipolar_lines(WHITE, WHITE, np.zeros((3, 3)), left := np.array([[10.0, 20.0]]), left)
    with pytest.raises(PictureError, match="right is 2 x 2 px"):
        draw_epipolar_lines(WHITE, WHITE[:2, :2], F, none, none)


def test_without_points_nothing_is_drawn():
    nothing = np.zeros((0, 2))
    for drawn in draw_epipolar_curves(WHITE, WHITE, two_views.rig(), nothing, nothing):
        assert not coloured(drawn).any()
    for drawn in draw_epipolar_lines(WHITE, WHITE, np.eye(3), nothing, nothing):
        assert not coloured(drawn).any()
