import numpy as np
import pytest

from stereo_gpu.errors import InputError, StageError
from stereo_gpu.render import BACKGROUND, render
from stereo_gpu.render_points import render_points
from stereo_gpu.types import Mesh, Surface

WALL = np.array([[-100, -80, 500], [100, -80, 500], [-100, 80, 500], [100, 80, 500]], np.float32)
FACES = np.array([[0, 2, 1], [1, 2, 3]], np.int32)
UV = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)


def wall(texture):
    return Mesh(vertices=WALL, faces=FACES, uv=UV, texture=texture)


def bump(columns=120, lines=90):
    """A wall with a hill towards the cameras, 21,182 triangles."""
    x, y = np.meshgrid(np.linspace(-100, 100, columns), np.linspace(-75, 75, lines))
    z = 500 - 60 * np.exp(-(x**2 + y**2) / 1800)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    index = np.arange(columns * lines).reshape(lines, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    return Surface(vertices=vertices, faces=faces.astype(np.int32))


def is_background(picture):
    return (picture == BACKGROUND).all(axis=-1)


def test_front_view_shows_the_texture_upright():
    texture = np.zeros((64, 80, 3), np.uint8)
    texture[:32, :40] = (255, 0, 0)
    texture[:32, 40:] = (0, 255, 0)
    texture[32:, :40] = (0, 0, 255)
    texture[32:, 40:] = (255, 255, 0)
    picture = render(wall(texture), size=(160, 120))
    assert picture.shape == (120, 160, 3) and picture.dtype == np.uint8
    assert tuple(picture[30, 40]) == (255, 0, 0)
    assert tuple(picture[30, 120]) == (0, 255, 0)
    assert tuple(picture[90, 40]) == (0, 0, 255)
    assert tuple(picture[90, 120]) == (255, 255, 0)
    assert not is_background(picture)[20:100, 20:140].any()
    assert is_background(picture)[:, :2].all()


def test_texture_is_perspective_correct():
    # A wall that runs away to the right: its middle in space is not its middle in the picture.
    slanted = WALL.copy()
    slanted[[1, 3], 2] = 1500
    texture = np.zeros((10, 200, 3), np.uint8)
    texture[:, 100:] = 255
    mesh = Mesh(vertices=slanted, faces=FACES, uv=UV, texture=texture)
    row = render(mesh, size=(400, 300))[150].astype(int)
    inside = np.flatnonzero(~is_background(row))
    step = inside[np.argmax(row[inside, 0] > 127)]
    share = (step - inside[0]) / (inside[-1] - inside[0])
    # x / z runs from -0.2 to 1/15 and is 0 in the middle of the wall
    assert share == pytest.approx(0.2 / (0.2 + 1 / 15), abs=0.02)


def test_yaw_walks_right_and_pitch_rises():
    # A near post before a far wall: seen from the right it moves left, seen from above it moves down.
    post = np.array([[-3, -3, 420], [3, -3, 420], [-3, 3, 420], [3, 3, 420]], np.float32)
    vertices = np.concatenate([WALL, post])
    faces = np.concatenate([FACES, FACES + 4])
    uv = np.concatenate([np.full((4, 2), 0.25), np.full((4, 2), 0.75)]).astype(np.float32)
    texture = np.full((2, 2, 3), 200, np.uint8)
    texture[1, 1] = (255, 0, 0)
    mesh = Mesh(vertices=vertices, faces=faces, uv=uv, texture=texture)

    def centre(**view):
        picture = render(mesh, size=(200, 150), **view).astype(int)
        y, x = np.nonzero((picture[..., 0] > 220) & (picture[..., 1] < 100))
        assert len(x) > 4
        return x.mean(), y.mean()

    front, right, above = centre(), centre(yaw=25), centre(pitch=25)
    assert front == pytest.approx((99.5, 74.5), abs=1.5)
    assert right[0] < front[0] - 10 and right[1] == pytest.approx(front[1], abs=3)
    assert above[1] > front[1] + 10 and above[0] == pytest.approx(front[0], abs=3)


def test_plain_is_lit_from_the_upper_left_and_has_no_cracks():
    picture = render(bump(), size=(321, 241))
    grey = picture.mean(axis=2)
    assert not is_background(picture)[14:-14, 14:-14].any()
    assert grey[100, 140] > grey[140, 180] + 15  # the hill's two flanks


def test_wire_draws_dark_edges():
    surface = bump(12, 9)
    plain, wire = (render(surface, size=(320, 240), shading=shading) for shading in ("plain", "wire"))
    darker = plain.mean(axis=2) - wire.mean(axis=2) > 25
    assert 0.05 < darker.mean() < 0.5
    assert (is_background(plain) == is_background(wire)).all()


def test_outliers_do_not_shrink_the_model():
    surface = bump()
    strays = np.array([[9e4, 9e4, 1e5], [9e4, 9.01e4, 1e5], [9.01e4, 9e4, 1e5]], np.float32)
    last = len(surface.vertices)
    faces = np.concatenate([surface.faces, [[last, last + 1, last + 2]]]).astype(np.int32)
    dirty = Surface(vertices=np.concatenate([surface.vertices, strays]), faces=faces)
    covered = [(~is_background(render(model, size=(160, 120)))).mean() for model in (surface, dirty)]
    assert covered[0] > 0.8
    assert covered[1] == pytest.approx(covered[0], abs=0.02)


def test_faces_with_nan_are_left_out():
    surface = bump(12, 9)
    vertices = surface.vertices.copy()
    vertices[54] = np.nan
    clean = render(surface, size=(80, 60))
    holed = render(Surface(vertices=vertices, faces=surface.faces), size=(80, 60))
    assert is_background(holed).sum() > is_background(clean).sum()


def test_points_keep_colour_and_depth_order():
    random = np.random.default_rng(3)
    x, y = np.stack(np.meshgrid(np.arange(200) - 100, np.arange(200) - 100)).reshape(2, -1).astype(float)
    x, y = x + random.uniform(-0.2, 0.2, 40_000), y + random.uniform(-0.2, 0.2, 40_000)
    far = np.stack([x, y, np.full_like(x, 600)], -1)
    near = np.stack([x / 4, y / 4, np.full_like(x, 400)], -1)
    points = np.concatenate([near, far, [[np.nan] * 3]]).astype(np.float32)
    colours = np.repeat(np.array([[250, 10, 10], [10, 10, 250], [0, 255, 0]], np.uint8), [40_000, 40_000, 1], 0)
    picture = render_points(points, colours, size=(200, 200))
    assert tuple(picture[100, 100]) == (250, 10, 10)
    assert tuple(picture[30, 30]) == (10, 10, 250)
    assert not is_background(picture)[20:180, 20:180].any()


def test_points_as_a_lattice():
    points = bump().vertices.reshape(90, 120, 3)
    picture = render_points(points, np.full((90, 120, 3), 77, np.uint8), size=(60, 45))
    assert tuple(picture[22, 30]) == (77, 77, 77)


@pytest.mark.parametrize("size", [(1, 1), (17, 400)])
def test_odd_sizes(size):
    assert render(bump(12, 9), size=size, yaw=40).shape == (size[1], size[0], 3)


def test_errors():
    surface = bump(12, 9)
    with pytest.raises(InputError, match="needs a Mesh"):
        render(surface, shading="texture")
    with pytest.raises(InputError, match="'shiny' is unknown"):
        render(surface, shading="shiny")
    with pytest.raises(InputError, match="at least 1"):
        render(surface, size=(0, 10))
    with pytest.raises(StageError, match="none of 0 faces"):
        render(Surface(vertices=surface.vertices, faces=np.empty((0, 3), np.int32)))
    with pytest.raises(StageError, match="none of 176 faces"):
        render(Surface(vertices=-surface.vertices, faces=surface.faces))
    with pytest.raises(InputError, match="one colour a point"):
        render_points(surface.vertices, np.zeros((3, 3), np.uint8))
    with pytest.raises(StageError, match="none of 5 points"):
        render_points(np.full((5, 3), np.nan, np.float32), np.zeros((5, 3), np.uint8))
