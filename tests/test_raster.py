import cv2
import numpy as np

from stereo_gpu.raster import rasterise


def shown(fragments, size):
    picture = np.full(size[0] * size[1], -1)
    picture[fragments.pixels] = fragments.triangles
    return picture.reshape(size[1], size[0])


def reference(screen, depth, faces, size):
    """The nearest triangle of each pixel in plain loops, and its depth."""
    picture = np.full((size[1], size[0]), -1)
    nearest = np.full((size[1], size[0]), np.inf)
    for index, face in enumerate(faces):
        (ax, ay), (bx, by), (cx, cy) = screen[face]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        for y in range(size[1]):
            for x in range(size[0]):
                a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                c = 1 - a - b
                if min(a, b, c) < 0:
                    continue
                z = 1 / (a / depth[face[0]] + b / depth[face[1]] + c / depth[face[2]])
                if z < nearest[y, x]:
                    nearest[y, x], picture[y, x] = z, index
    return picture, nearest


def test_random_triangles_equal_the_loops():
    random = np.random.default_rng(5)
    size = (37, 23)
    screen = random.uniform(-12, 45, (60, 2))
    depth = random.uniform(1.0, 9.0, 60)
    faces = random.permutation(60).reshape(20, 3).astype(np.int32)
    fragments = rasterise(screen, depth, faces, size)
    expected, nearest = reference(screen, depth, faces, size)
    got = shown(fragments, size)
    assert (expected >= 0).mean() > 0.5
    assert (got == expected).mean() >= 0.998  # a pixel exactly on an edge may fall either way
    same = (got == expected)[fragments.pixels // size[0], fragments.pixels % size[0]]
    z = np.einsum("pi,pi->p", fragments.weights, depth[faces[fragments.triangles]])
    np.testing.assert_allclose(z[same], nearest.ravel()[fragments.pixels][same], rtol=1e-6)


def test_weights_find_the_pixel_again():
    # Weights are perspective-correct: the space point they give must project onto the pixel's centre.
    points = np.array([[-1.0, -1.0, 2.0], [4.0, -1.2, 5.0], [-0.5, 5.0, 9.0]])
    screen = 20 * points[:, :2] / points[:, 2:] + 12
    fragments = rasterise(screen, points[:, 2], np.array([[0, 1, 2]], np.int32), (40, 30))
    assert len(fragments.pixels) > 100
    space = fragments.weights @ points
    again = 20 * space[:, :2] / space[:, 2:] + 12
    y, x = np.divmod(fragments.pixels, 40)
    np.testing.assert_allclose(again, np.stack([x, y], axis=1), atol=1e-4)


def test_fine_lattice_has_no_cracks():
    columns, lines = 71, 53
    x, y = np.meshgrid(np.arange(columns) * 1.37 + 0.11, np.arange(lines) * 1.13 + 0.07)
    index = np.arange(columns * lines).reshape(lines, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).reshape(-1, 3)
    angle = 0.3
    screen = np.stack([x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)], -1)
    screen = screen.reshape(-1, 2) + np.array([15, -5])
    depth = np.full(columns * lines, 3.0)
    got = shown(rasterise(screen, depth, faces.astype(np.int32), (90, 80)), (90, 80))
    outline = shown(
        rasterise(
            screen[[index[0, 0], index[0, -1], index[-1, -1], index[-1, 0]]],
            depth[:4],
            np.array([[0, 1, 2], [0, 2, 3]], np.int32),
            (90, 80),
        ),
        (90, 80),
    )
    assert (outline >= 0).sum() > 3000
    # On the outline itself rounding may go either way.
    inside = cv2.erode((outline >= 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    outside = cv2.dilate((outline >= 0).astype(np.uint8), np.ones((3, 3), np.uint8)) == 0
    assert (got[inside] >= 0).all()
    assert (got[outside] < 0).all()


def test_edge_on_and_outside_give_nothing():
    screen = np.array([[1.0, 1.0], [5.0, 5.0], [3.0, 3.0], [50.0, 50.0], [60.0, 50.0], [50.0, 60.0]])
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    assert len(rasterise(screen, np.ones(6), faces, (20, 20)).pixels) == 0
