"""Pictures of the built-in scene, as two real cameras would take them.

Rays are cast through the same lens model that calibration has to find: soft shadows, antialiasing, the lens's
blur, different exposure, and the sensor's noise.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from stereo_gpu.rig import Camera
from stereo_gpu.scene import Scene, meet, paper_outline, project, undistort
from stereo_gpu.scene_objects import Group
from stereo_gpu.scene_texture import block_faces, colour, noise_lattice
from stereo_gpu.types import Bytes, Doubles, Floats

SUBSAMPLES = 3  # rays a pixel in each direction
BLUR_PX = 0.6  # of lens and colour filter, standard deviation; without it corners seem drawn to whole pixels
NOISE = 1.0  # grey levels, standard deviation of the sensor's noise
GAINS = ((1.0, 1.0, 1.0), (0.93, 0.92, 0.945))  # left, right, each RGB: the cameras expose differently
BAND = 40_000  # rays at a time: what stays in the processor's cache
LIGHT = np.array([-330.0, -900.0, 1100.0])  # mm, world
LIGHT_WIDTH = 150.0  # mm
AMBIENT_REACH = 30.0  # mm: corners narrower than this get darker


def render_pair(scene: Scene) -> tuple[Bytes, Bytes]:
    """The raw pictures (H, W, 3) of the objects, left and right, RGB."""
    left, right = (_cast(scene, side, scene.groups, _rays(_camera(scene, side)[0])) for side in (0, 1))
    return _develop(scene, 0, 0, left), _develop(scene, 1, 0, right)


def render_boards(scene: Scene) -> list[tuple[Bytes, Bytes]]:
    """The raw pictures (H, W, 3) of the board, 15 pairs, RGB."""
    sides: list[list[Bytes]] = []
    for side in (0, 1):
        rays = _rays(_camera(scene, side)[0])
        empty = _cast(scene, side, (), rays)
        shown = [_board_over(scene, side, pose, rays, empty) for pose in scene.board_poses]
        sides.append([_develop(scene, side, number, light) for number, light in enumerate(shown, 1)])
    return list(zip(*sides, strict=True))


def _camera(scene: Scene, side: int) -> tuple[Camera, Doubles, Doubles]:
    """A camera with its pose, left camera to this one: 0 is the left, 1 the right."""
    if side == 0:
        return scene.rig.left, np.eye(3), np.zeros(3)
    return scene.rig.right, scene.rig.R, scene.rig.T


def _rays(camera: Camera) -> Floats:
    """x/z, y/z of every subsample (H * SUBSAMPLES, W * SUBSAMPLES, 2)."""
    width, height = camera.size
    steps = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    columns = (np.arange(width)[:, None] + steps).ravel()
    rows = (np.arange(height)[:, None] + steps).ravel()
    rays = np.empty((len(rows), len(columns), 2), np.float32)
    for start in range(0, len(rows), 16):  # a few rows at a time stay in the processor's cache
        pixels = np.stack(np.meshgrid(columns, rows[start : start + 16]), axis=-1)
        rays[start : start + 16] = undistort(camera, pixels.reshape(-1, 2)).reshape(pixels.shape)
    return rays


def _cast(scene: Scene, side: int, groups: tuple[Group, ...], rays: Floats) -> Floats:
    """The light (H, W, 3), 0..255, that a camera gets from the room and some of the objects."""
    _, rotation, translation = _camera(scene, side)
    part = replace(scene, groups=groups)
    to_world = rotation @ scene.rotation  # applied from the right: world from camera
    eye = -(translation + rotation @ scene.translation) @ to_world
    lattice, faces = noise_lattice(scene.seed), block_faces()
    lamps = _lamps(rays.shape[1])
    picture = np.empty((*rays.shape[:2], 3), np.float32)
    rows = max(1, BAND // rays.shape[1]) // SUBSAMPLES * SUBSAMPLES or SUBSAMPLES
    for start in range(0, rays.shape[0], rows):
        flat = rays[start : start + rows].reshape(-1, 2).astype(np.float64)
        directions = np.concatenate([flat, np.ones((len(flat), 1))], axis=1) @ to_world
        lamp = np.tile(lamps, (len(flat) // len(lamps), 1))
        light = _shade(part, lattice, faces, np.broadcast_to(eye, directions.shape), directions, lamp)
        picture[start : start + rows] = light.reshape(-1, rays.shape[1], 3)
    return _average(picture)


def _lamps(columns: int) -> Doubles:
    """A place on the square lamp for each subsample of a row of pixels, so that shadows have soft edges."""
    steps = ((np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5) * LIGHT_WIDTH
    x, z = np.meshgrid(steps, steps)
    places = LIGHT + np.stack([x, 0 * x, z], axis=-1)  # (SUBSAMPLES, SUBSAMPLES, 3): row, column
    return np.tile(places, (1, columns // SUBSAMPLES, 1)).reshape(-1, 3)


def _shade(
    scene: Scene, lattice: Floats, faces: Bytes, origins: Doubles, directions: Doubles, lamps: Doubles
) -> Floats:
    """The light (N, 3) along rays in the world frame: Lambert's law, shadows, and dark corners."""
    steps, numbers = meet(scene, origins, directions)
    light = np.zeros((len(steps), 3), np.float32)
    seen = np.flatnonzero(numbers >= 0)
    points = origins[seen] + steps[seen, None] * directions[seen]
    normals = np.empty_like(points)
    for number in np.unique(numbers[seen]):
        own = np.flatnonzero(numbers[seen] == number)
        shape = scene.shapes[number]
        normals[own] = shape.normal(points[own])
        light[seen[own]] = colour(lattice, faces, shape, points[own])
    outside = points + 0.05 * normals  # mm: off the surface, or it would shadow itself
    to_lamp = lamps[seen] - outside
    blocked = np.zeros(len(seen), bool)
    for group in scene.groups:
        rays = group.reach(outside, to_lamp)
        for shape in group.shapes:
            blocked[rays] |= shape.hit(outside[rays], to_lamp[rays]) < 1
    facing = np.einsum("ij,ij->i", normals, to_lamp) / np.linalg.norm(to_lamp, axis=1)
    direct = np.where(blocked, 0, np.maximum(facing, 0))
    sky = (0.72 + 0.28 * normals[:, 2]) * _open(scene, points, normals)
    light[seen] *= (0.56 * sky + 0.66 * direct)[:, None].astype(np.float32)
    return light


def _open(scene: Scene, points: Doubles, normals: Doubles) -> Doubles:
    """How much of the sky (N,), 0..1, points see, told from how near the next surface is above them."""
    probes = points + AMBIENT_REACH * normals
    room_left = np.full(len(points), AMBIENT_REACH)
    for plane in scene.room:
        room_left = np.minimum(room_left, plane.distance(probes))
    for group in scene.groups:
        near = group.near(probes, AMBIENT_REACH)
        for shape in group.shapes:
            room_left[near] = np.minimum(room_left[near], shape.distance(probes[near]))
    return 0.45 + 0.55 * np.clip(room_left / AMBIENT_REACH, 0, 1)


def _board_over(scene: Scene, side: int, pose: tuple[Doubles, Doubles], rays: Floats, behind: Floats) -> Floats:
    """The board before the empty room: (H, W, 3)."""
    camera, rotation, translation = _camera(scene, side)
    turned, origin = rotation @ pose[0], rotation @ pose[1] + translation
    square, columns, rows = scene.board.square, scene.board.columns, scene.board.rows
    edge = paper_outline(scene.board)
    low, high = edge.min(axis=0), edge.max(axis=0)
    outline = project(camera, edge @ turned.T + origin)
    first = np.clip(np.floor(outline.min(axis=0)).astype(int) - 2, 0, np.array(camera.size) - 2)
    last = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 3, 2, np.array(camera.size))
    columns_px, rows_px = slice(first[0], last[0]), slice(first[1], last[1])
    fine = [slice(part.start * SUBSAMPLES, part.stop * SUBSAMPLES) for part in (rows_px, columns_px)]
    near = rays[fine[0], fine[1]]
    to_plane = np.linalg.inv(np.stack([turned[:, 0], turned[:, 1], origin], axis=1)).astype(np.float32)
    a, b, c = (near[..., 0] * row[0] + near[..., 1] * row[1] + row[2] for row in to_plane)
    x, y = a / c, b / c
    # edges have the width of a subsample: counted in whole subsamples, those along the rows would lie up to a
    # sixth of a pixel off
    soft_x, soft_y = (np.hypot(*np.gradient(part)) / 2 for part in (x, y))
    board_x = _inside(x, -square, (columns - 1) * square, soft_x)
    board_y = _inside(y, -square, (rows - 1) * square, soft_y)
    stripes = _stripes(x, square, columns - 1, soft_x) * _stripes(y, square, rows - 1, soft_y)
    black = board_x * board_y * (1 + stripes) / 2
    paper = _inside(x, low[0], high[0], soft_x) * _inside(y, low[1], high[1], soft_y)
    share_paper, share_black = np.split(_average(np.stack([paper, black], axis=-1)), 2, axis=-1)
    # paper turned towards the lamp is brighter
    lamp = scene.rotation @ LIGHT + scene.translation - pose[1]
    facing = abs(float(pose[0][:, 2] @ lamp)) / float(np.linalg.norm(lamp))
    white, ink = np.array([236, 233, 226], np.float32), np.array([30, 29, 32], np.float32)
    shown = (share_paper - share_black) * white + share_black * ink
    picture = behind.copy()
    area = picture[rows_px, columns_px]
    area *= 1 - share_paper
    area += shown * (0.74 + 0.24 * facing)
    return picture


def _inside(x: Floats, low: float, high: float, soft: Floats) -> Floats:
    """How much of a subsample that reaches `soft` to both sides of x lies between low and high, 0..1."""
    return np.asarray(np.clip((np.minimum(x - low, high - x) / soft + 1) / 2, 0, 1))


def _stripes(x: Floats, width: float, edges: int, soft: Floats) -> Floats:
    """+1, -1 by turns, changing at 0, `width` and so on, `edges` times, averaged over `soft` to both sides of x."""
    edge = np.clip(np.rint(x / width), 0, edges - 1)
    sign = 1 - 2 * (edge % 2)
    return np.asarray(sign * np.clip((x - edge * width) / soft, -1, 1), np.float32)


def _average(fine: Floats) -> Floats:
    """Subsamples to pixels."""
    height, width = fine.shape[0] // SUBSAMPLES, fine.shape[1] // SUBSAMPLES
    return np.asarray(cv2.resize(fine, (width, height), interpolation=cv2.INTER_AREA))


def _develop(scene: Scene, side: int, number: int, light: Floats) -> Bytes:
    """What the sensor makes of the light: exposure, the lens's blur, noise, eight bits."""
    random = np.random.default_rng((scene.seed, side, number))
    exposed = cv2.GaussianBlur(light * np.array(GAINS[side], np.float32), (0, 0), BLUR_PX)
    noisy = exposed + NOISE * random.standard_normal(light.shape, np.float32)
    return np.asarray(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
