import numpy as np
import pytest
from mesh_measures import check_valid, directed, smallest_angles

from stereo_gpu.meshing.turn_edges import turn_edges, twins


def flat(places):
    return np.column_stack([places, np.zeros(len(places))])


def turned(corners, faces, tolerance=0.25):
    return turn_edges(np.asarray(corners, float), np.array(faces, np.int32), tolerance=tolerance, space=corners)


THIN = [[0, 0], [10, 0], [5, -1.0], [5, 1.0]]  # split along its long diagonal, and wound as seen with y down
FACES = [[0, 1, 2], [1, 0, 3]]


def test_the_long_diagonal_of_a_thin_quadrangle_is_turned():
    corners = flat(np.array(THIN))
    found = turned(corners, FACES)
    assert {frozenset(face) for face in found.tolist()} == {frozenset((0, 2, 3)), frozenset((1, 2, 3))}
    check_valid(corners[:, :2], found)
    np.testing.assert_array_equal(turned(corners, found), found)  # and stays so


@pytest.mark.parametrize(("height", "turns"), [(0.2, True), (0.3, False)])
def test_an_edge_along_a_crease_stays(height, turns):
    corners = flat(np.array(THIN))
    corners[:2, 2] = height  # the ridge is so much above the line between the two others
    assert (sorted(map(sorted, turned(corners, FACES).tolist())) != sorted(map(sorted, FACES))) == turns


def test_a_dart_keeps_its_only_diagonal():
    corners = flat(np.array([[0, 0], [2, 0], [1.0, -4], [1.0, -0.2]]))
    faces = [[0, 3, 2], [3, 1, 2]]
    np.testing.assert_array_equal(turned(corners, faces), faces)


def test_a_random_mesh_gets_delaunays_angles():
    """Points in a square, first joined row by row without regard to shape."""
    from scipy.spatial import Delaunay

    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(30.0), np.arange(20.0)), axis=-1).reshape(-1, 2) * (1.0, 3.0)
    inner = ((grid > 0) & (grid < grid.max(axis=0))).all(axis=1)
    grid[inner] += rng.uniform(-0.45, 0.45, (inner.sum(), 2))
    number = np.arange(600).reshape(20, 30)
    a, b, c, d = (
        number[rows, columns].ravel()
        for rows in (slice(0, -1), slice(1, None))
        for columns in (slice(0, -1), slice(1, None))
    )
    faces = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    assert len(np.unique(directed(faces), axis=0)) == 3 * len(faces)
    before = smallest_angles(grid, faces)
    found = turned(flat(grid), faces, tolerance=1.0)
    check_valid(grid, found)
    after = smallest_angles(grid, found)
    best = smallest_angles(grid, Delaunay(grid).simplices)
    assert len(found) == len(faces)
    assert np.sort(after)[:300].mean() > np.sort(before)[:300].mean()
    assert np.sort(after)[:300].mean() > 0.98 * np.sort(best)[:300].mean()


def test_a_triangle_upside_down_is_put_right():
    corners = flat(np.array([[0, 0], [4, 0], [2.0, -2], [2.0, -0.5]]))
    # The second one's corner lies on the wrong side of the edge 0-1, which it shares with the first.
    faces = [[0, 1, 2], [1, 0, 3]]
    a, b, c = (corners[np.array(faces[1])][i] for i in range(3))
    assert (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0] > 0
    found = turned(corners, faces, tolerance=0.0)
    check_valid(corners[:, :2], found)


def test_sides_know_their_neighbours():
    faces = np.array([[0, 1, 2], [1, 0, 3], [5, 4, 3], [4, 5, 6], [5, 4, 7]])
    found = twins(faces, 8)
    assert found[0] == 3 and found[3] == 0
    assert (np.delete(found, [0, 3]) == -1).all()  # of the side that three share, none
