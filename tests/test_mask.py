import cv2
import numpy as np
import pytest

from stereo_gpu.errors import InputError, PictureError
from stereo_gpu.images import write_png
from stereo_gpu.mask import Stroke, mask_from_depth, mask_from_file, mask_from_rectangle, mask_from_strokes


def scene(scale=1, colour=True):
    """A ball on a darker ground, and the truth."""
    random = np.random.default_rng(2)
    truth = np.zeros((120 * scale, 160 * scale), np.uint8)
    cv2.circle(truth, (80 * scale, 60 * scale), 30 * scale, 1, -1)
    ball, ground = ((200, 90, 60), (60, 90, 120)) if colour else (170, 80)
    shape = (*truth.shape, 3) if colour else truth.shape
    picture = np.where(truth.reshape(*truth.shape, *[1] * (len(shape) - 2)) > 0, ball, ground)
    return np.clip(picture + random.normal(0, 8, shape), 0, 255).astype(np.uint8), truth


def overlap(mask, truth):
    return (mask & truth).sum() / (mask | truth).sum()


@pytest.mark.parametrize("colour", [True, False], ids=["colour", "grey"])
@pytest.mark.parametrize("scale", [1, 7])
def test_the_rectangle_finds_the_ball(colour, scale):
    picture, truth = scene(scale, colour)
    rectangle = tuple(scale * value for value in (42, 22, 76, 76))
    mask = mask_from_rectangle(picture, rectangle)
    assert mask.shape == truth.shape
    assert mask.dtype == np.uint8
    assert set(np.unique(mask)) == {0, 1}
    assert overlap(mask, truth) > 0.93


def test_the_rectangle_gives_the_same_mask_twice():
    picture, _ = scene()
    cv2.setRNGSeed(99)
    first = mask_from_rectangle(picture, (42, 22, 76, 76))
    cv2.setRNGSeed(7)
    np.testing.assert_array_equal(first, mask_from_rectangle(picture, (42, 22, 76, 76)))


def test_sixteen_bits_give_nearly_the_same():
    picture, truth = scene()
    assert overlap(mask_from_rectangle(picture.astype(np.uint16) * 16, (42, 22, 76, 76)), truth) > 0.95


@pytest.mark.parametrize(
    ("rectangle", "told"),
    [
        ((0, 0, 160, 120), "leaves no background"),
        ((100, 20, 80, 40), "leaves the picture of 160 x 120 px"),
        ((-1, 20, 80, 40), "leaves the picture"),
        ((10, 20, 0, 40), "is 0 x 40 px"),
        ((10, 20, 40), "whole px"),
        ((10, 20, 40.5, 40), "whole px"),
        ((10, 20, float("nan"), 40), "whole px"),
        ("here", "whole px"),
        (None, "whole px"),
    ],
)
def test_rectangles_that_are_none(rectangle, told):
    with pytest.raises(InputError, match=told):
        mask_from_rectangle(scene()[0], rectangle)


def test_nothing_that_stands_out():
    with pytest.raises(InputError, match="around the whole object, or give a mask"):
        mask_from_rectangle(np.full((90, 120, 3), 100, np.uint8), (30, 30, 40, 30))


def test_iterations_that_are_none():
    with pytest.raises(InputError, match="iterations is 0"):
        mask_from_rectangle(scene()[0], (42, 22, 76, 76), iterations=0)


@pytest.mark.parametrize("white", [1, 255, 65535])
def test_a_mask_from_a_file(tmp_path, white):
    wanted = scene()[1]
    painted = wanted.astype(np.uint16 if white > 255 else np.uint8) * white
    write_png(tmp_path / "mask.png", painted)
    np.testing.assert_array_equal(mask_from_file(tmp_path / "mask.png", (160, 120)), wanted)
    write_png(tmp_path / "red.png", np.dstack([painted, 0 * painted, 0 * painted]))
    np.testing.assert_array_equal(mask_from_file(tmp_path / "red.png", (160, 120)), wanted)


def test_mask_files_that_do_not_fit(tmp_path):
    write_png(tmp_path / "mask.png", np.zeros((120, 160), np.uint8))
    with pytest.raises(PictureError, match="is black"):
        mask_from_file(tmp_path / "mask.png", (160, 120))
    with pytest.raises(PictureError, match="is 160 x 120 px, the rectified picture is 120 x 160"):
        mask_from_file(tmp_path / "mask.png", (120, 160))
    with pytest.raises(PictureError, match="no such file"):
        mask_from_file(tmp_path / "none.png", (160, 120))


def test_a_mask_from_depth():
    z = np.array([[100.0, 200.0, 300.0], [np.nan, 250.0, -50.0]], np.float32)
    expected = [[0, 1, 1], [0, 1, 0]]
    mask = mask_from_depth(z, 200, 300)
    assert mask.dtype == np.uint8
    assert mask.tolist() == expected
    points = np.dstack([z * 0, z * 0 + 250, z])
    assert mask_from_depth(points, 200, 300).tolist() == expected
    assert mask_from_depth(z, 0, np.inf).tolist() == [[1, 1, 1], [0, 1, 0]]


@pytest.mark.parametrize("ends", [(300, 200), (200, 200), (np.nan, 200), (100, np.nan), (-200, -100)])
def test_ranges_that_are_none(ends):
    with pytest.raises(InputError, match="depth range"):
        mask_from_depth(np.zeros((3, 3), np.float32), *ends)


def test_depths_of_another_shape():
    with pytest.raises(InputError, match="depth has shape"):
        mask_from_depth(np.zeros((3, 3, 2), np.float32), 1, 2)


def stroke(radius, *points):
    return Stroke(radius=radius, points=points)


BALL = [stroke(4, (70, 60), (90, 60))]
GROUND = [stroke(4, (20, 20), (140, 20)), stroke(4, (20, 110), (140, 110))]


@pytest.mark.parametrize("colour", [True, False], ids=["colour", "grey"])
@pytest.mark.parametrize("scale", [1, 7])
@pytest.mark.parametrize(
    "marks",
    [
        {"wanted": BALL},
        {"unwanted": GROUND},
        {"wanted": BALL, "unwanted": GROUND},
        {"rectangle": (42, 22, 76, 76), "wanted": BALL},
        {"rectangle": (0, 0, 160, 120), "unwanted": GROUND},
    ],
    ids=lambda marks: "+".join(marks),
)
def test_strokes_find_the_ball(colour, scale, marks):
    picture, truth = scene(scale, colour)
    scaled = {
        name: tuple(scale * value for value in mark)
        if name == "rectangle"
        else [stroke(scale * s.radius, *((scale * x, scale * y) for x, y in s.points)) for s in mark]
        for name, mark in marks.items()
    }
    mask = mask_from_strokes(picture, **scaled)
    assert mask.dtype == np.uint8 and set(np.unique(mask)) == {0, 1}
    assert overlap(mask, truth) > 0.93
    cv2.setRNGSeed(99)
    np.testing.assert_array_equal(mask, mask_from_strokes(picture, **scaled))


def test_strokes_are_law():
    picture, _ = scene()
    mask = mask_from_strokes(
        picture,
        rectangle=(42, 22, 76, 76),
        wanted=[stroke(3, (10, 60), (150, 60)), stroke(0.5, (5, 5))],  # far beyond the ball, and outside the rectangle
        unwanted=[stroke(5, (80, 20), (80, 100))],
    )
    assert mask[5, 5] == 1 and (mask[60, 10:74] == 1).all() and (mask[60, 87:150] == 1).all()
    assert not mask[20:100, 76:85].any()  # unwanted wins
    assert mask[59, 20] == 1 and mask[30, 5] == 0


def test_without_a_rectangle_what_lies_apart_is_left_out():
    picture, _ = scene()
    both = np.concatenate([picture, picture], axis=1)
    mask = mask_from_strokes(both, wanted=BALL)
    assert mask[60, 80] == 1 and not mask[:, 160:].any()


def test_a_rectangle_alone_is_that_of_the_other_function():
    picture, _ = scene()
    rectangle = (42, 22, 76, 76)
    np.testing.assert_array_equal(
        mask_from_strokes(picture, rectangle=rectangle, iterations=5), mask_from_rectangle(picture, rectangle)
    )


@pytest.mark.parametrize(
    ("marks", "told"),
    [
        ({}, "nothing is marked"),
        ({"rectangle": (0, 0, 160, 120), "wanted": BALL}, "leave no background"),
        ({"rectangle": (42, 22, 76, 76), "unwanted": [stroke(160, (80, 60))]}, "leave nothing of the object"),
        ({"wanted": [stroke(0, (3, 3))]}, "wanted: a stroke of radius 0"),
        ({"wanted": [stroke(float("nan"), (3, 3))]}, "radius nan"),
        ({"unwanted": [stroke(2, (3, float("inf")))]}, "finite points"),
        ({"unwanted": [stroke(2)]}, "unwanted: a stroke"),
        ({"wanted": [stroke(2, (1, 1))] * 2001}, "2001 strokes, the limit is 2000"),
        ({"rectangle": (42, 22, 760, 76), "wanted": BALL}, "leaves the picture"),
    ],
)
def test_marks_that_are_none(marks, told):
    with pytest.raises(InputError, match=told):
        mask_from_strokes(scene()[0], **marks)


def test_strokes_that_leave_the_picture_are_cut_off():
    picture, truth = scene()
    far = [stroke(4, (70, 60), (90, 60)), stroke(3, (-1e12, -1e12))]
    assert overlap(mask_from_strokes(picture, wanted=far, unwanted=GROUND), truth) > 0.93
