"""What stands in the built-in scene: its shapes, where rays meet them, and the bear and the cube made of them.

World frame: millimetres, x right, y away from the cameras, z up; the table is z = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stereo_gpu.types import Doubles

CUBE_SIDE = 170.0  # mm
WALL_Y = 430.0  # mm
SMALLEST_STEP = 1e-9  # lengths of a ray: nearer hits are the surface that the ray starts on


class Thing(IntEnum):
    """What a ray meets."""

    NOTHING = 0
    TABLE = 1
    WALL = 2
    CUBE = 3
    BEAR = 4


class Paint(IntEnum):
    """How a shape is coloured."""

    PLANKS = 0
    PLASTER = 1
    BLOCK = 2
    FUR = 3
    PALE_FUR = 4
    DARK = 5
    GLINT = 6
    CLOTH = 7


@dataclass(frozen=True, eq=False)
class Plane:
    """The half space below a plane: {X : normal . X <= offset}."""

    direction: Doubles
    offset: float
    thing: Thing
    paint: Paint

    def hit(self, origins: Doubles, directions: Doubles) -> Doubles:
        """Where rays enter, in lengths of their directions; inf where they do not. (N, 3), (N, 3) -> (N,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (self.offset - origins @ self.direction) / (directions @ self.direction)
        return np.where(step > SMALLEST_STEP, step, np.inf)

    def normal(self, points: Doubles) -> Doubles:
        """Outward unit normals (N, 3) at points of the surface."""
        return np.broadcast_to(self.direction, points.shape)

    def distance(self, points: Doubles) -> Doubles:
        """Signed distance (N,) in mm, negative inside."""
        return np.asarray(points @ self.direction - self.offset)


@dataclass(frozen=True, eq=False)
class Ellipsoid:
    """An ellipsoid.

    Args:
        centre: (3,) mm.
        axes: (3, 3), its own axes as rows.
        half: (3,) mm, radii along them.
    """

    centre: Doubles
    axes: Doubles
    half: Doubles
    thing: Thing
    paint: Paint

    def hit(self, origins: Doubles, directions: Doubles) -> Doubles:
        """Where rays enter, in lengths of their directions; inf where they do not. (N, 3), (N, 3) -> (N,)."""
        to_sphere = self.axes.T / self.half
        start, along = (origins - self.centre) @ to_sphere, directions @ to_sphere
        squared = _dot(along, along)
        middle = -_dot(start, along) / squared  # the point nearest to the centre
        nearest = start + middle[:, None] * along
        room = 1 - _dot(nearest, nearest)
        with np.errstate(invalid="ignore"):
            step = middle - np.sqrt(room / squared)
        return np.where((room > 0) & (step > SMALLEST_STEP), step, np.inf)

    def normal(self, points: Doubles) -> Doubles:
        """Outward unit normals (N, 3) at points of the surface."""
        gradient = ((points - self.centre) @ (self.axes.T / self.half**2)) @ self.axes
        return np.asarray(gradient / np.linalg.norm(gradient, axis=1, keepdims=True))

    def distance(self, points: Doubles) -> Doubles:
        """Signed distance (N,) in mm, negative inside; of first order, so exact near the surface."""
        local = (points - self.centre) @ self.axes.T
        level = np.sqrt(_dot(local / self.half, local / self.half))
        slope = np.sqrt(_dot(local / self.half**2, local / self.half**2))
        return np.asarray(level * (level - 1) / np.maximum(slope, 1e-12))


@dataclass(frozen=True, eq=False)
class Box:
    """A box; the members mean what they mean for an Ellipsoid, `half` being half of the sides."""

    centre: Doubles
    axes: Doubles
    half: Doubles
    thing: Thing
    paint: Paint

    def hit(self, origins: Doubles, directions: Doubles) -> Doubles:
        """Where rays enter, in lengths of their directions; inf where they do not. (N, 3), (N, 3) -> (N,)."""
        start, along = (origins - self.centre) @ self.axes.T, directions @ self.axes.T
        along = np.where(along == 0, 1e-300, along)
        first, second = (-self.half - start) / along, (self.half - start) / along
        enter = np.minimum(first, second).max(axis=1)
        leave = np.maximum(first, second).min(axis=1)
        return np.where((enter < leave) & (enter > SMALLEST_STEP), enter, np.inf)

    def local(self, points: Doubles) -> Doubles:
        """Points (N, 3) in the box's own frame, -1..1 inside."""
        return np.asarray((points - self.centre) @ self.axes.T / self.half)

    def normal(self, points: Doubles) -> Doubles:
        """Outward unit normals (N, 3) at points of the surface."""
        local = self.local(points)
        axis = np.abs(local).argmax(axis=1)
        return np.asarray(np.sign(local[np.arange(len(local)), axis])[:, None] * self.axes[axis])

    def distance(self, points: Doubles) -> Doubles:
        """Signed distance (N,) in mm, negative inside."""
        beyond = np.abs((points - self.centre) @ self.axes.T) - self.half
        outside = np.maximum(beyond, 0)
        return np.asarray(np.sqrt(_dot(outside, outside)) + np.minimum(beyond.max(axis=1), 0))


Shape = Plane | Ellipsoid | Box


@dataclass(frozen=True, eq=False)
class Group:
    """Shapes and a sphere round them, so that most rays can pass by at the cost of one test."""

    shapes: tuple[Shape, ...]
    centre: Doubles
    radius: float

    def reach(self, origins: Doubles, directions: Doubles) -> NDArray[np.intp]:
        """Indices of the rays that pass through the sphere round the group."""
        start = origins - self.centre
        along = _dot(start, directions)
        squared = _dot(directions, directions)
        inside = _dot(start, start) - self.radius**2
        return np.flatnonzero((along**2 >= squared * inside) & ((along < 0) | (inside < 0)))

    def near(self, points: Doubles, margin: float) -> NDArray[np.intp]:
        """Indices of the points within `margin` mm of the sphere round the group."""
        start = points - self.centre
        return np.flatnonzero(_dot(start, start) < (self.radius + margin) ** 2)


def room() -> tuple[Plane, ...]:
    """The table and the wall behind it."""
    return (
        Plane(np.array([0.0, 0.0, 1.0]), 0.0, Thing.TABLE, Paint.PLANKS),
        Plane(np.array([0.0, -1.0, 0.0]), -WALL_Y, Thing.WALL, Paint.PLASTER),
    )


def cube(x: float, y: float, yaw: float) -> Group:
    """A toy block that stands on the table at (x, y) mm, turned by `yaw` degrees."""
    half = CUBE_SIDE / 2
    centre = np.array([x, y, half])
    box = Box(centre, turn(0, 0, yaw).T, np.full(3, half), Thing.CUBE, Paint.BLOCK)
    return Group((box,), centre, half * 1.74)


def bear(x: float, y: float, yaw: float) -> Group:
    """A teddy bear that sits on the table at (x, y) mm and looks towards -y, turned by `yaw` degrees."""
    parts: list[Ellipsoid] = []
    facing = turn(0, 0, yaw)
    place = np.array([x, y, 0.0])

    def add(paint: Paint, centre: Sequence[float], radii: Sequence[float], tilt: Sequence[float] = (0, 0, 0)) -> None:
        own = facing @ turn(*tilt)
        middle = place + facing @ np.array(centre, np.float64)
        parts.append(Ellipsoid(middle, own.T, np.array(radii, np.float64), Thing.BEAR, paint))

    add(Paint.FUR, (0, 0, 88), (78, 68, 90))  # body
    add(Paint.PALE_FUR, (0, -34, 92), (54, 40, 60))  # belly
    add(Paint.FUR, (0, -10, 218), (72, 64, 62))  # head
    add(Paint.PALE_FUR, (0, -62, 200), (35, 30, 26))  # muzzle
    add(Paint.DARK, (0, -90, 210), (12, 8, 8.5))  # nose
    for side in (-1, 1):
        add(Paint.FUR, (side * 58, -2, 270), (28, 15, 28))  # ear
        add(Paint.PALE_FUR, (side * 58, -12, 270), (18, 8, 18))
        add(Paint.DARK, (side * 27, -66, 231), (8.5, 6.5, 9.5))  # eye
        add(Paint.GLINT, (side * 27 - 2.5, -71, 235), (2.8, 2.2, 2.8))
        add(Paint.FUR, (side * 86, -30, 118), (26, 27, 60), (-28, side * -24, 0))  # arm
        add(Paint.PALE_FUR, (side * 106, -59, 78), (20, 19, 21))  # paw
        add(Paint.FUR, (side * 60, -78, 36), (34, 66, 36), (0, 0, side * 16))  # leg
        add(Paint.FUR, (side * 74, -132, 46), (34, 22, 46), (0, 0, side * 16))  # foot
        add(Paint.PALE_FUR, (side * 77, -144, 44), (24, 15, 31), (0, 0, side * 16))  # sole
        add(Paint.CLOTH, (side * 26, -67, 158), (26, 11, 17), (0, side * 12, 0))  # bow
    add(Paint.CLOTH, (0, -73, 158), (10, 10, 11))  # its knot
    return Group(tuple(parts), place + facing @ np.array([0, -40, 140.0]), 180.0)


def turn(about_x: float, about_y: float, about_z: float) -> Doubles:
    """The rotation (3, 3) by degrees about x, then y, then z."""
    rotation = np.eye(3)
    for axis, angle in enumerate(np.deg2rad((about_x, about_y, about_z))):
        step = np.eye(3)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        step[[first, second], [first, second]] = np.cos(angle)
        step[first, second], step[second, first] = -np.sin(angle), np.sin(angle)
        rotation = step @ rotation
    return rotation


def _dot(a: Doubles, b: Doubles) -> Doubles:
    return np.asarray(np.einsum("ij,ij->i", a, b))
