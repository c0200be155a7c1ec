import cv2
import numpy as np
import pytest

from stereo_gpu.backends import open_backend
from stereo_gpu.errors import InputError, MemoryLimitError, StageError
from stereo_gpu.render import BACKGROUND, bring_in_front, render
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


# Of a cube: outward direction, colour, and how to walk there.
SIDES = [
    ((0, 0, -1), (200, 40, 40), {}),
    ((1, 0, 0), (40, 200, 40), {"yaw": 90}),
    ((0, 0, 1), (40, 40, 200), {"yaw": 180}),
    ((-1, 0, 0), (200, 200, 40), {"yaw": -90}),
    ((0, -1, 0), (200, 40, 200), {"pitch": 90}),
    ((0, 1, 0), (40, 200, 200), {"pitch": -90}),
]


def cube():
    """A cube of 100 at a depth of 500, its faces counter-clockwise from outside, each of a colour."""
    vertices, faces, uv = [], [], []
    for number, (outward, _, _) in enumerate(SIDES):
        out = np.array(outward, float)
        right = np.array([0, 1, 0]) if outward[1] == 0 else np.array([0, 0, 1])
        up = np.cross(out, right)
        corners = [out + a * right + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        vertices += [50 * corner + (0, 0, 500) for corner in corners]
        faces += [[4 * number, 4 * number + 1, 4 * number + 2], [4 * number, 4 * number + 2, 4 * number + 3]]
        uv += [[(number + 0.5) / 6, 0.5]] * 4
    texture = np.array([[colour for _, colour, _ in SIDES]], np.uint8)
    return Mesh(
        vertices=np.array(vertices, np.float32),
        faces=np.array(faces, np.int32),
        uv=np.array(uv, np.float32),
        texture=texture,
    )


@pytest.mark.parametrize(("outward", "colour", "view"), SIDES)
def test_a_cube_shows_the_side_that_it_is_seen_from(outward, colour, view):
    picture = render(cube(), size=(90, 90), **view)
    shown = ~is_background(picture)
    assert (picture[45, 45] == colour).all()
    # The camera turns about a point of the cube's front, so that another side may show beside this one.
    inside = cv2.erode(shown.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert (picture[inside] == colour).all(axis=1).mean() > (0.85 if outward == (0, 1, 0) else 0.999)
    assert np.ptp(np.nonzero(shown)[0]) == pytest.approx(90 / 1.08, abs=2)
    clay = render(Surface(vertices=cube().vertices, faces=cube().faces), size=(90, 90), **view)
    assert (is_background(clay) == ~shown).all()


def test_a_cube_from_above_its_corner_shows_three_sides():
    picture = render(cube(), size=(120, 120), yaw=40, pitch=30)
    share = [(picture == colour).all(axis=2).mean() for _, colour, _ in SIDES]
    assert min(share[0], share[1], share[4]) > 0.08
    assert share[2] == share[3] == share[5] == 0


def test_a_face_seen_from_behind_is_darker_and_keeps_its_texture():
    flat = Surface(vertices=WALL, faces=FACES)
    turned = Surface(vertices=WALL, faces=FACES[:, ::-1])
    front, back = (render(surface, size=(40, 30))[15, 20].astype(int) for surface in (flat, turned))
    assert (front > back + 60).all()
    texture = np.random.default_rng(4).integers(0, 256, (12, 16, 3)).astype(np.uint8)
    mesh = wall(texture)
    other = Mesh(vertices=WALL, faces=FACES[:, ::-1], uv=UV, texture=texture)
    np.testing.assert_array_equal(render(mesh, size=(40, 30)), render(other, size=(40, 30)))


def test_charts_laid_apart_show_no_seam():
    # A wall of one picture, cut in two charts, one of which lies on its side, each grown by 4 texels.
    y, x = np.mgrid[:64, :64]
    photo = np.stack([3 * x + 20, 200 - 2 * y, x + y], -1).astype(np.uint8)
    atlas = np.zeros((80, 160, 3), np.uint8)
    grown = np.pad(photo, ((4, 4), (4, 4), (0, 0)), mode="edge")
    atlas[4:76, 4:44] = grown[:, :40]  # columns up to 36, of which 32 are its own
    atlas[4:44, 60:132] = np.rot90(grown[:, 32:])  # columns from 28 on, turned to the left
    x = np.array([-100, 0, 0, 100] * 2, np.float32)
    vertices = np.stack([x, np.repeat([-80, 80], 4), np.full(8, 500)], -1).astype(np.float32)
    faces = np.array([[0, 4, 1], [1, 4, 5], [2, 6, 3], [3, 6, 7]], np.int32)
    places = [[8, 8], [40, 8], [64, 40], [64, 8], [8, 72], [40, 72], [128, 40], [128, 8]]
    uncut = np.stack([(x + 100) / 200, np.repeat([0, 1], 4)], -1).astype(np.float32)
    whole = Mesh(vertices=vertices, faces=faces, uv=uncut, texture=photo)
    cut = Mesh(vertices=vertices, faces=faces, uv=(np.array(places) / (160, 80)).astype(np.float32), texture=atlas)
    for view in ({}, {"yaw": 35.0, "pitch": 20.0}):
        for size in ((200, 160), (50, 40)):  # magnified, and from the second level
            one, two = (render(mesh, size=size, **view).astype(int) for mesh in (whole, cut))
            assert np.abs(one - two).max() <= 8
            assert np.abs(one - two).mean() < 1


def test_every_device_draws_the_same_picture(backend):
    mesh = wall(np.random.default_rng(6).integers(0, 256, (70, 90, 3)).astype(np.uint8))
    here = open_backend("warp:cpu")
    for model, shading in ((mesh, "texture"), (bump(40, 30), "plain"), (bump(12, 9), "wire")):
        one, other = (
            render(model, size=(83, 61), yaw=17, pitch=-9, shading=shading, device=device).astype(int)
            for device in (backend, here)
        )
        difference = np.abs(one - other)
        # To the bit between CPUs; a GPU may round a division the other way.
        assert difference.max() <= (0 if backend.kind == "cpu" else 1)


def test_a_model_far_from_the_origin_is_brought_in_front():
    mesh = cube()
    away = Mesh(vertices=mesh.vertices - (0, 0, 500), faces=mesh.faces, uv=mesh.uv, texture=mesh.texture)
    assert bring_in_front(mesh) is mesh
    moved = bring_in_front(away)
    assert moved.vertices[:, 2].min() > 0
    np.testing.assert_allclose(np.ptp(moved.vertices, axis=0), 100, rtol=1e-5)
    assert (render(moved, size=(90, 90))[45, 45] == SIDES[0][1]).all()


def test_a_picture_too_large_for_the_device_is_refused(monkeypatch):
    device = open_backend("warp:cpu")
    monkeypatch.setattr(device, "available_bytes", lambda: (10_000_000, 10_000_000))
    assert render(bump(12, 9), size=(300, 300), device=device).shape == (300, 300, 3)
    with pytest.raises(MemoryLimitError, match="draw a smaller picture"):
        render(bump(12, 9), size=(800, 600), device=device)


def test_errors():
    surface = bump(12, 9)
    with pytest.raises(InputError, match="needs a Mesh"):
        render(surface, shading="texture")
    with pytest.raises(InputError, match="'shiny' is unknown"):
        render(surface, shading="shiny")
    with pytest.raises(InputError, match="at least 1"):
        render(surface, size=(0, 10))
    with pytest.raises(InputError, match="more than 8192 px"):
        render(surface, size=(9000, 10))
    with pytest.raises(StageError, match="none of 0 faces"):
        render(Surface(vertices=surface.vertices, faces=np.empty((0, 3), np.int32)))
    with pytest.raises(StageError, match="none of 176 faces"):
        render(Surface(vertices=-surface.vertices, faces=surface.faces))
    with pytest.raises(InputError, match="one colour a point"):
        render_points(surface.vertices, np.zeros((3, 3), np.uint8))
    with pytest.raises(StageError, match="none of 5 points"):
        render_points(np.full((5, 3), np.nan, np.float32), np.zeros((5, 3), np.uint8))
