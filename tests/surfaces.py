"""Disparity maps of known shapes, and measures of meshes, for the tests of everything after matching."""

import numpy as np

FOCAL, BASELINE = 400.0, 60.0
CENTRE = (BASELINE, 0.0, 0.0)


def triangulated(depth):
    """Disparity and points of the right view, for the depth of every pixel; NaN stays NaN."""
    height, width = depth.shape
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    cx, cy = (width - 1) / 2, (height - 1) / 2
    points = np.stack([(x - cx) * depth / FOCAL + BASELINE, (y - cy) * depth / FOCAL, depth], axis=-1)
    return (FOCAL * BASELINE / depth).astype(np.float32), points.astype(np.float32)


def plane(height=41, width=63, distance=900.0, tilt=0.3):
    """Depth of a plane that recedes to the right."""
    x = np.arange(width) - (width - 1) / 2
    return np.tile(distance / (1 - tilt * x / FOCAL), (height, 1))


def ball(height=121, width=161, distance=900.0, radius=100.0, wall=1500.0):
    """Depth of a ball before a wall; without a wall if that is NaN. Its middle is on the axis of the right camera."""
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    ray = np.stack([x / FOCAL, y / FOCAL, np.ones_like(x)], axis=-1)
    square, along = (ray**2).sum(axis=-1), distance
    root = along**2 - square * (distance**2 - radius**2)
    hit = (along - np.sqrt(np.where(root > 0, root, 0))) / square
    return np.where(root > 0, hit, wall)


def from_ball(vertices, distance=900.0):
    """Distance of each vertex from the middle of `ball`."""
    return np.linalg.norm(vertices.astype(float) - (BASELINE, 0, distance), axis=1)


def seen(vertices, centre=CENTRE, shift=(0.0, 0.0)):
    """(N, 2): column and row at which the right camera sees vertices, around its axis."""
    local = vertices.astype(float) - centre
    return local[:, :2] / local[:, 2:] * FOCAL + shift


def signed_areas(corners, faces):
    """(M,): areas in the plane, above 0 where the corners go round clockwise with y down."""
    a, b, c = (corners[faces[:, i]] for i in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def normals(vertices, faces):
    a, b, c = (vertices[faces[:, i]].astype(float) for i in range(3))
    across = np.cross(b - a, c - a)
    return across / np.linalg.norm(across, axis=1, keepdims=True)
