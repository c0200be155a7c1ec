"""The built-in scene with known truth: a block and a bear on a table, and a board to calibrate with.

`scene_render` takes its pictures, `scene_truth` holds what was measured on them against what is known here.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.boards.board import Board
from stereo_gpu.errors import InputError
from stereo_gpu.rig import Camera, Rig
from stereo_gpu.scene_objects import Group, Plane, Shape, Thing, bear, cube, room, turn
from stereo_gpu.types import Bytes, Doubles

SMALLEST_SIZE = (160, 120)
MARGIN = 15.0  # mm of white paper round the board's squares
CLEAR_PX = 5.0  # the paper of a board stays this far inside both pictures, at 640x480

# How a board is held: which way it is moved from the middle of what both cameras see (right, down; 1 is as far as
# both pictures show its paper whole), its distance in mm, its turns about x, y and z in degrees.
BOARD_VIEWS = (
    (0.0, 0.0, 470, 8, -6, 3),
    (0.0, 0.0, 540, 38, 6, -12),
    (0.0, 0.0, 560, -38, -8, 9),
    (0.3, 0.0, 540, 5, 42, 8),
    (-0.3, 0.0, 540, -6, -42, -9),
    (-1.0, -1.0, 560, 24, -20, 6),
    (1.0, -1.0, 560, 22, 24, -7),
    (-1.0, 1.0, 560, -24, -24, -8),
    (1.0, 1.0, 560, -22, 20, 5),
    (0.0, -1.0, 640, 36, 16, -5),
    (0.0, 1.0, 640, -36, -14, 7),
    (-1.0, 0.0, 600, 10, -34, 24),
    (1.0, 0.0, 600, -9, 36, -22),
    (-0.2, -0.2, 860, 34, 22, 72),
    (0.3, 0.2, 980, -32, -28, 14),
)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is known about the built-in scene.

    Args:
        rig: the true cameras.
        board: the calibration board.
        board_poses: (R (3, 3), t (3,)) a view, board frame to left camera, mm; the board's origin is its
            first inner corner, x along the columns, y along the rows.
        rotation, translation: world to left camera, mm.
        room: table and wall.
        groups: the objects, each in its own bounding sphere.
        seed: of textures and sensor noise.
    """

    rig: Rig
    board: Board
    board_poses: tuple[tuple[Doubles, Doubles], ...]
    rotation: Doubles
    translation: Doubles
    room: tuple[Plane, ...]
    groups: tuple[Group, ...]
    seed: int

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """All shapes; their order gives the numbers that `meet` returns."""
        return self.room + tuple(shape for group in self.groups for shape in group.shapes)


def build_scene(size: tuple[int, int] = (640, 480), seed: int = 0) -> Scene:
    """The scene, for pictures of `size` (width, height) px.

    Raises:
        InputError: pictures too small to show the board's squares.
    """
    if size[0] < SMALLEST_SIZE[0] or size[1] < SMALLEST_SIZE[1]:
        raise InputError(f"size is {size[0]}x{size[1]}: the scene needs at least 160x120 px")
    rig = _rig(size)
    # the left camera looks down at a point between the objects
    eye, target = np.array([-58.0, -742.0, 452.0]), np.array([-22.0, 0.0, 98.0])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    board = Board(columns=10, rows=7, square=30.0)
    return Scene(
        rig=rig,
        board=board,
        board_poses=tuple(_board_pose(rig, board, view) for view in BOARD_VIEWS),
        rotation=rotation,
        translation=-rotation @ eye,
        room=room(),
        groups=(cube(-130, 6, 47), bear(112, 28, -12)),
        seed=seed,
    )


def _rig(size: tuple[int, int]) -> Rig:
    scale = min(size[0] / 640, size[1] / 480)
    middle = (np.array(size) - 1) / 2

    def camera(focal: tuple[float, float], shift: tuple[float, float], lens: tuple[float, ...]) -> Camera:
        cx, cy = middle + np.array(shift) * scale
        matrix = np.array([[focal[0] * scale, 0, cx], [0, focal[1] * scale, cy], [0, 0, 1.0]])
        return Camera(matrix, np.array(lens), size)

    rotation = turn(0.5, 2.6, -0.4)
    # the right camera stands 100 mm to the right and turns towards the left one's axis
    centre = np.array([100.0, 1.3, -0.8])
    return Rig(
        left=camera((651.6, 650.3), (3.4, -2.7), (-0.283, 0.082, 0.0007, -0.0004, 0.0)),
        right=camera((647.9, 646.8), (-4.1, 3.2), (-0.276, 0.077, -0.0005, 0.0006, 0.0)),
        R=rotation,
        T=-rotation @ centre,
    )


def _board_pose(rig: Rig, board: Board, view: tuple[float, ...]) -> tuple[Doubles, Doubles]:
    """Board frame to left camera: R (3, 3), t (3,)."""
    right, down, distance, *turns = view
    rotation = turn(*turns)
    # from between the cameras, along the middle of their directions, both see it alike
    middle = cv2.Rodrigues(-cv2.Rodrigues(rig.R)[0] / 2)[0]
    eye = -rig.R.T @ rig.T / 2
    centre = rotation @ [(board.columns - 2) * board.square / 2, (board.rows - 2) * board.square / 2, 0]
    outline = paper_outline(board) @ rotation.T
    clear = CLEAR_PX * rig.left.size[0] / 640
    last = np.array(rig.left.size) - 1 - clear

    def place(across: float, along: float) -> Doubles:
        return np.asarray(eye + distance * (middle @ [across, along, 1.0]) - centre)

    def fits(across: float, along: float) -> bool:
        seen = outline + place(across, along)
        pixels = [project(rig.left, seen), project(rig.right, seen @ rig.R.T + rig.T)]
        return all(bool(((p >= clear) & (p <= last)).all()) for p in pixels)

    def farthest(across: float, along: float, step: tuple[float, float]) -> float:
        near, far = 0.0, 0.5
        for _ in range(12):
            reach = (near + far) / 2
            near, far = (reach, far) if fits(across + reach * step[0], along + reach * step[1]) else (near, reach)
        return near

    # down or up first: towards a side the lens leaves less height
    along = abs(down) * farthest(0, 0, (0, np.sign(down))) * np.sign(down)
    across = abs(right) * farthest(0, along, (np.sign(right), 0)) * np.sign(right)
    return rotation, place(across, along)


def paper_outline(board: Board) -> Doubles:
    """Points (N, 3) along the edge of the board's paper, mm, in its own frame; close, as lenses bend the edge."""
    low = -board.square - MARGIN
    far_x, far_y = ((count - 1) * board.square + MARGIN for count in (board.columns, board.rows))
    corners = np.array([[low, low, 0], [far_x, low, 0], [far_x, far_y, 0], [low, far_y, 0]])
    shares = np.linspace(0, 1, 12, endpoint=False)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])


def project(camera: Camera, points: Doubles) -> Doubles:
    """Points (N, 3) in a camera's own frame as pixels (N, 2) of its raw picture."""
    pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0]
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def undistort(camera: Camera, pixels: Doubles) -> Doubles:
    """Pixels (N, 2) of the raw picture as x/z, y/z (N, 2), to better than 1e-6 px.

    Newton's method on OpenCV's lens model with five coefficients.
    """
    k1, k2, p1, p2, k3 = camera.distortion
    matrix = camera.matrix
    goal_x = (pixels[:, 0] - matrix[0, 2]) / matrix[0, 0]
    goal_y = (pixels[:, 1] - matrix[1, 2]) / matrix[1, 1]
    x, y = goal_x, goal_y
    for _ in range(6):
        squared = x * x + y * y
        radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
        slope = 2 * (k1 + squared * (2 * k2 + squared * 3 * k3))
        off_x = x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x) - goal_x
        off_y = y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y - goal_y
        xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x
        xy = x * y * slope + 2 * p1 * x + 2 * p2 * y
        yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x
        determinant = xx * yy - xy * xy
        x = x - (yy * off_x - xy * off_y) / determinant
        y = y - (xx * off_y - xy * off_x) / determinant
    return np.stack([x, y], axis=1)


def trace(scene: Scene, origins: Doubles, directions: Doubles) -> tuple[Doubles, Bytes]:
    """What rays meet first, in the frame of the left camera.

    Args:
        scene: the scene.
        origins: (N, 3) or (3,), mm.
        directions: (N, 3), of any length.

    Returns:
        (N,) how far, in lengths of the ray's direction (so depth in mm where its z is 1), inf where it meets
        nothing; (N,) uint8, the `Thing` that it meets.
    """
    directions = np.asarray(directions, np.float64)
    starts = np.broadcast_to(np.asarray(origins, np.float64), directions.shape)
    steps, numbers = meet(scene, (starts - scene.translation) @ scene.rotation, directions @ scene.rotation)
    things = np.array([shape.thing for shape in scene.shapes] + [Thing.NOTHING], np.uint8)
    return steps, things[numbers]


def meet(scene: Scene, origins: Doubles, directions: Doubles) -> tuple[Doubles, NDArray[np.intp]]:
    """Like `trace`, but in the world frame and with the number of the shape, -1 for none."""
    steps = np.full(len(directions), np.inf)
    numbers = np.full(len(directions), -1)
    for number, plane in enumerate(scene.room):
        step = plane.hit(origins, directions)
        closer = step < steps
        steps[closer], numbers[closer] = step[closer], number
    number = len(scene.room)
    for group in scene.groups:
        rays = group.reach(origins, directions)
        own_origins, own_directions = origins[rays], directions[rays]
        for shape in group.shapes:
            step = shape.hit(own_origins, own_directions)
            closer = step < steps[rays]
            steps[rays[closer]], numbers[rays[closer]] = step[closer], number
            number += 1
    return steps, numbers
