"""The kernels that draw triangles against the loops in reference.py, on every device, and what they promise."""

import cv2
import numpy as np
import pytest
import reference
from test_gpu_forms import opened

from stereo_gpu.drawing.raster import Paint, place_on_screen, rasterise, shade, shrink_by_halves

COLOURS = np.array([[233, 236, 240], [34, 58, 94]], np.uint8)


def owners(backend, screen, faces, size):
    return backend.download(rasterise(backend, backend.upload(screen), backend.upload(faces), size))


def scattered(count, seed, low=-12.0, high=45.0):
    """Triangles of any size, some of them in part outside of a small picture, at all depths."""
    rng = np.random.default_rng(seed)
    screen = place_on_screen(rng.uniform(low, high, (3 * count, 2)), rng.uniform(1.0, 9.0, 3 * count))
    return screen, rng.permutation(3 * count).reshape(count, 3).astype(np.int32)


def lattice(columns, lines, angle):
    """A lattice of triangles, turned; and its outline as two triangles."""
    x, y = np.meshgrid(np.arange(columns) * 1.37 + 0.11, np.arange(lines) * 1.13 + 0.07)
    index = np.arange(columns * lines).reshape(lines, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3).astype(np.int32)
    places = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)], -1)
    corners = index[[0, 0, -1, -1], [0, -1, -1, 0]]
    return places.reshape(-1, 2) + np.array([15, -5]), faces, corners[[[0, 1, 2], [0, 2, 3]]].astype(np.int32)


@pytest.mark.parametrize("size", [(37, 23), (5, 9), (1, 1)])
def test_random_triangles_equal_the_loops(backend, size):
    screen, faces = scattered(25, 5)
    want, near = reference.rasterise(screen, faces, size)
    got = owners(backend, screen, faces, size)
    assert (want > 0).mean() > 0.5
    # Single precision may take the other of two triangles that meet in a sample.
    assert (got != want).mean() <= 0.002
    assert near.max() <= 1


def test_the_nearest_wins_and_of_equal_ones_the_last(backend):
    screen = place_on_screen(np.tile([[1.0, 1], [14, 1], [1, 14]], (4, 1)), np.repeat([3.0, 2.0, 2.0, 5.0], 3))
    faces = np.arange(12, dtype=np.int32).reshape(4, 3)
    for order, winner in (([0, 1, 2, 3], 3), ([2, 1, 0, 3], 2), ([3, 0], 2), ([0], 1)):
        got = owners(backend, screen, faces[order], (16, 16))
        assert set(np.unique(got)) == {0, winner}
        assert got[1, 1] == got[1, 14] == got[14, 1] == got[7, 8] == winner  # what lies on an edge is inside
        assert (got > 0).sum() == 14 * 15 // 2


def test_depth_is_compared_at_every_sample(backend):
    # Two walls that cross: each hides the other on its side.
    screen = place_on_screen(np.array([[0.0, 0], [20, 0], [0, 20], [20, 20]] * 2), np.array([1.0, 3, 1, 3, 3, 1, 3, 1]))
    faces = np.array([[0, 2, 1], [1, 2, 3], [4, 6, 5], [5, 6, 7]], np.int32)
    got = owners(backend, screen, faces, (21, 21))
    assert (got[:, :10] <= 2).all() and (got[:, 11:] >= 3).all()


def test_what_cannot_be_seen_is_left_out(backend):
    depth = np.ones(9)
    depth[8] = 0  # behind the camera
    screen = place_on_screen(
        np.array([[1.0, 1], [5, 5], [3, 3], [50, 50], [60, 50], [50, 60], [1, 1], [9, 1], [1, 9]]), depth
    )
    assert not owners(backend, screen, np.arange(9, dtype=np.int32).reshape(3, 3), (20, 20)).any()


@pytest.mark.parametrize("far", [1e5, 1e9, 3e30])
def test_corners_far_outside_of_the_picture(backend, far):
    screen = place_on_screen(np.array([[-far, -far], [far, -far], [0.0, far]]), np.full(3, 2.0))
    got = owners(backend, screen, np.array([[0, 2, 1]], np.int32), (33, 17))
    assert (got == 1).all() or far > 1e20  # the products of the largest have no place in single precision


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
def test_a_lattice_has_no_cracks(backend, angle):
    places, faces, outline = lattice(71, 53, angle)
    screen, size = place_on_screen(places, np.full(len(places), 3.0)), (90, 80)
    got, whole = (owners(backend, screen, some, size) > 0 for some in (faces, outline))
    assert whole.sum() > 2500
    # On the outline itself rounding may go either way.
    inside = cv2.erode(whole.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    outside = cv2.dilate(whole.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0
    assert got[inside].all()
    assert not got[outside].any()


def test_thin_fans_have_no_cracks(backend):
    # Slivers around a point, at any angle: the worst that rounding can do.
    angles = np.sort(np.random.default_rng(2).uniform(0, 2 * np.pi, 400))
    rim = 300 * np.stack([np.cos(angles), np.sin(angles)], -1) + 31.7
    screen = place_on_screen(np.vstack([[[31.7, 31.7]], rim]), np.full(401, 2.0))
    number = np.arange(1, 401)
    faces = np.stack([np.zeros(400, int), np.roll(number, -1), number], axis=1).astype(np.int32)
    assert (owners(backend, screen, faces, (64, 64)) > 0).all()


def painted(backend, screen, faces, uv, texture, size, samples, behind=0.0, wire=0.0, levels=None):
    """The picture from the kernels, and from the loops on what the kernels found."""
    texels, count = shrink_by_halves(texture)
    paint = Paint(
        texture=backend.upload(texels),
        size=(texture.shape[1], texture.shape[0]),
        levels=levels or count,
        behind=behind,
        wire=wire,
        colours=backend.upload(COLOURS),
    )
    held, held_faces = backend.upload(screen), backend.upload(faces)
    owner = rasterise(backend, held, held_faces, (size[0] * samples, size[1] * samples))
    got = backend.download(shade(backend, owner, held, held_faces, backend.upload(uv), paint, samples))
    copies, at, shape = [], 0, texture.shape[:2]
    for _ in range(paint.levels):
        copies.append(texels[at : at + shape[0] * shape[1]].reshape(*shape, 3))
        at, shape = at + shape[0] * shape[1], ((shape[0] + 1) // 2, (shape[1] + 1) // 2)
    want = reference.shade(
        backend.download(owner), screen, faces, uv.astype(float), copies, COLOURS.astype(float), behind, wire, samples
    )
    return got, want


@pytest.mark.parametrize(("samples", "wire", "behind"), [(1, 0.0, 0.0), (2, 2.0, 0.0), (3, 0.0, 0.5)])
@pytest.mark.parametrize("side", [7, 200])  # of the texture: magnified, and so small that copies are taken
def test_shade(backend, samples, wire, behind, side):
    screen, faces = scattered(12, 9, -6.0 * samples, 30.0 * samples)
    rng = np.random.default_rng(3)
    uv = rng.uniform(0, 1, (36, 2)).astype(np.float32)
    texture = rng.integers(0, 256, (side, side + 4, 3)).astype(np.uint8)
    got, want = painted(backend, screen, faces, uv, texture, (25, 17), samples, behind, wire)
    difference = np.abs(got.astype(int) - want.astype(int))
    assert (got == COLOURS[0]).all(axis=-1).mean() < 0.6
    # Where a triangle is seen edge on single precision places a texel less well.
    assert (difference > 1).mean() < 0.01


def test_fine_stripes_turn_grey_unless_the_texture_is_one_picture(backend):
    screen = place_on_screen(np.array([[0.0, 0], [8, 0], [0, 8]]), np.ones(3))
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[::2] = 255
    half_a_texel = 0.5 / 64
    uv = np.array([[0, half_a_texel], [1, half_a_texel], [0, 1 + half_a_texel]], np.float32)
    faces = np.array([[0, 2, 1]], np.int32)
    one, all_of_them = (
        painted(backend, screen, faces, uv, texture, (6, 6), 1, levels=levels)[0][:3, :3].astype(int)
        for levels in (1, None)
    )
    assert (one == 255).all()  # every sample meets a white stripe
    assert (abs(all_of_them - 128) <= 1).all()


def test_every_level_is_half_of_the_one_before():
    texture = np.random.default_rng(1).integers(0, 256, (5, 12, 3)).astype(np.uint8)
    texels, levels = shrink_by_halves(texture)
    assert levels == 5 and texels.shape == (5 * 12 + 3 * 6 + 2 * 3 + 1 * 2 + 1 + 1, 3)
    np.testing.assert_array_equal(texels[:60], texture.reshape(-1, 3))
    assert abs(texels[-2].astype(float) - texture.mean(axis=(0, 1))).max() < 12
    assert shrink_by_halves(texture[:1, :1])[1] == 1


@pytest.mark.parametrize("size", [(97, 41), (5, 3), (1, 1)])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_both_forms_give_the_same_bits(name, size):
    screen, faces = scattered(300, 7, -30.0, 120.0)
    uv = np.random.default_rng(8).uniform(0, 1, (900, 2)).astype(np.float32)
    texels, levels = shrink_by_halves(np.random.default_rng(8).integers(0, 256, (40, 33, 3)).astype(np.uint8))
    found = []
    for form in ("gpu", "cpu"):
        backend = opened(name, form)
        held, held_faces = backend.upload(screen), backend.upload(faces)
        owner = rasterise(backend, held, held_faces, (2 * size[0], 2 * size[1]))
        paint = Paint(
            texture=backend.upload(texels),
            size=(33, 40),
            levels=levels,
            behind=0.0,
            wire=2.0,
            colours=backend.upload(COLOURS),
        )
        picture = shade(backend, owner, held, held_faces, backend.upload(uv), paint, 2)
        found.append((backend.download(owner), backend.download(picture)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(np.unique(found[0][0])) > 20 or size != (97, 41)
