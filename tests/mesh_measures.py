"""What is measured of meshes in several tests: validity, roundness, and how far an outline strays."""

import numpy as np
from surfaces import signed_areas


def directed(faces):
    """(3 M, 2): the sides of the faces, each as its face has it."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)


def check_valid(places, faces):
    """No flipped or empty face, no side with a third face, no vertex on the middle of a side (a T-junction)."""
    assert (signed_areas(places, faces) < 0).all()
    sides = directed(faces)
    assert len(np.unique(sides, axis=0)) == len(sides)  # of two faces at a side, each has it in its own direction
    border = outline(faces)
    a, b = places[border[:, 0]], places[border[:, 1]]
    for vertex in np.unique(border)[::7]:  # a T-junction comes with two borders, seldom alone
        along, off = b - a, places[vertex] - a
        length = np.linalg.norm(along, axis=1)
        share = (along * off).sum(axis=1) / length**2
        away = np.abs(along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]) / length
        assert not ((away < 1e-4) & (share > 1e-3) & (share < 1 - 1e-3)).any()


def outline(faces):
    """(B, 2): sides that one face has."""
    sides = directed(faces)
    key, back = sides[:, 0] << 32 | sides[:, 1], sides[:, 1] << 32 | sides[:, 0]
    return sides[~np.isin(key, back)]


def smallest_angles(places, faces):
    """(M,) degrees, in the plane or in space."""
    angles = []
    for i in range(3):
        p, q, r = (places[faces[:, (i + k) % 3]].astype(float) for k in range(3))
        u, v = q - p, r - p
        cosine = (u * v).sum(axis=1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.min(angles, axis=0)


def stray(places, faces, others, other_faces, step=0.25):
    """For points along the first outline, their distance to the nearest one along the other outline, px."""
    from scipy.spatial import cKDTree

    def points(where, border):
        a, b = where[border[:, 0]], where[border[:, 1]]
        count = np.maximum(1, np.ceil(np.linalg.norm(b - a, axis=1) / step).astype(int))
        row = np.repeat(np.arange(len(a)), count)
        share = (np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)) / count[row]
        return a[row] + (b - a)[row] * share[:, None]

    one, other = points(places, outline(faces)), points(others, outline(other_faces))
    return cKDTree(other).query(one)[0]
