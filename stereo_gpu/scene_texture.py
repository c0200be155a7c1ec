"""The colours of the built-in scene: value noise at several scales, fur, wood, plaster, and a toy block's faces.

Every surface varies at scales from 3 to 60 mm, so that it can be matched at any distance.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_gpu.scene_objects import CUBE_SIDE, Box, Paint, Shape, turn
from stereo_gpu.types import Bytes, Doubles, Floats

LATTICE = 64  # cells, after which the noise repeats
FACE_PX = 510  # pixels of a block's face: about three a mm, finer than any view of it
PLANK = 96.0  # mm, width of a plank
PLANKS_TURNED = turn(0, 0, 24)  # a grain along the rows would leave stereo nothing to hold on to

INK = {
    Paint.FUR: (182, 122, 66),
    Paint.PALE_FUR: (232, 196, 144),
    Paint.DARK: (46, 36, 34),
    Paint.GLINT: (250, 250, 250),
    Paint.CLOTH: (196, 44, 52),
    Paint.PLASTER: (150, 182, 186),
}


def noise_lattice(seed: int) -> Floats:
    """The random values (64, 64, 64), -1..1, that all noise of one scene is read from."""
    return np.random.default_rng(seed).uniform(-1, 1, (LATTICE,) * 3).astype(np.float32)


def value_noise(lattice: Floats, points: NDArray[np.floating]) -> Floats:
    """Smooth noise (N,), -1..1, at points (N, 3) given in cells.

    Source: value noise, Ebert et al., "Texturing and Modeling", chapter 2.
    """
    cell = np.floor(points)
    part = (points - cell).astype(np.float32)
    part = part * part * (3 - 2 * part)
    low = cell.astype(np.int64) & (LATTICE - 1)
    high = (low + 1) & (LATTICE - 1)
    x0, x1 = low[:, 0] * LATTICE**2, high[:, 0] * LATTICE**2
    y0, y1 = low[:, 1] * LATTICE, high[:, 1] * LATTICE
    flat = lattice.reshape(-1)

    def along_z(start: NDArray[np.int64]) -> Floats:
        first = flat[start + low[:, 2]]
        return np.asarray(first + part[:, 2] * (flat[start + high[:, 2]] - first))

    near, far = along_z(x0 + y0), along_z(x1 + y0)
    near += part[:, 1] * (along_z(x0 + y1) - near)
    far += part[:, 1] * (along_z(x1 + y1) - far)
    return np.asarray(near + part[:, 0] * (far - near))


def octaves(lattice: Floats, points: NDArray[np.floating], *scales: tuple[float, float]) -> Floats:
    """The sum of noise (N,) at points (N, 3) in mm over (mm a cell, weight)."""
    total = np.zeros(len(points), np.float32)
    for number, (size, weight) in enumerate(scales):
        # shifted, so that no two octaves read the same cells at the same place
        total += weight * value_noise(lattice, points / size + 17.31 * number)
    return total


def colour(lattice: Floats, faces: Bytes, shape: Shape, points: Doubles) -> Floats:
    """The colour (N, 3), RGB 0..255 under full light, of points (N, 3) of a shape."""
    if isinstance(shape, Box):
        return _block(lattice, faces, shape, points)
    if shape.paint is Paint.PLANKS:
        return _planks(lattice, points)
    ink = np.array(INK[shape.paint], np.float32)
    if shape.paint is Paint.PLASTER:
        grain = octaves(lattice, points, (5, 0.10), (14, 0.10), (60, 0.10))
    elif shape.paint in (Paint.FUR, Paint.PALE_FUR):
        # tufts hang down: longer along z than across
        tufts = octaves(lattice, points * [1, 1, 0.6], (3.4, 0.30), (7.5, 0.34), (22, 0.16))
        grain = tufts + octaves(lattice, points, (55, 0.10))
    elif shape.paint is Paint.CLOTH:
        grain = octaves(lattice, points, (3.4, 0.25), (9, 0.3))
    else:
        grain = octaves(lattice, points, (4, 0.15))
    return ink * (1 + grain)[:, None]


def _planks(lattice: Floats, points: Doubles) -> Floats:
    turned = points @ PLANKS_TURNED
    number = np.floor(turned[:, 0] / PLANK)
    across = turned[:, 0] - number * PLANK
    # each plank is cut from another place of the log
    wood = turned + np.stack([0 * number, 371 * number, 53 * number], axis=1)
    tone = value_noise(lattice, np.stack([number * 7.7, number * 3.3, 0 * number], axis=1))
    grain = octaves(lattice, wood * [1, 0.09, 1], (3.2, 0.13), (9, 0.15), (30, 0.12))
    specks = octaves(lattice, wood, (4.5, 0.13), (13, 0.10))
    gap = np.clip(np.minimum(across, PLANK - across) / 1.6, 0.35, 1).astype(np.float32)
    light = (1 + grain + specks + 0.10 * tone) * gap
    return np.array([178, 138, 98], np.float32) * light[:, None]


def _block(lattice: Floats, faces: Bytes, box: Box, points: Doubles) -> Floats:
    local = box.local(points)
    axis = np.abs(local).argmax(axis=1)
    rows = np.arange(len(local))
    outward = local[rows, axis] > 0
    # on the sides the picture stands upright and reads from left to right; the top's foot is towards -y
    across = np.where(axis == 2, local[:, 0], np.where(axis == 0, local[:, 1], -local[:, 0]))
    across = np.where((axis == 2) | outward, across, -across)
    up = np.where(axis == 2, local[:, 1], local[:, 2])
    px = np.clip(((across + 1) / 2 * FACE_PX).astype(np.intp), 0, FACE_PX - 1)
    py = np.clip(((1 - up) / 2 * FACE_PX).astype(np.intp), 0, FACE_PX - 1)
    number = axis * 2 + outward
    base = faces[number, py, px].astype(np.float32)
    wood = local * (CUBE_SIDE / 2)
    # grain through the depth of the block; specks keep the end grain and the paint from being flat
    grain = octaves(lattice, wood * [1, 1, 0.15], (3.6, 0.12), (11, 0.14))
    specks = octaves(lattice, wood, (4, 0.16), (9, 0.16), (26, 0.10))
    return np.asarray(base * (1 + grain + specks)[:, None])


def block_faces() -> Bytes:
    """The six faces (6, 510, 510, 3), RGB: -x, +x, -y, +y, -z, +z of the block's own frame."""
    side = FACE_PX
    wood, red, green, blue = (226, 190, 142), (200, 62, 50), (66, 132, 74), (52, 92, 160)
    faces = np.empty((6, side, side, 3), np.uint8)
    faces[:] = wood
    for face, ink in zip(faces, (green, green, red, red, blue, blue), strict=True):
        cv2.rectangle(face, (34, 34), (side - 35, side - 35), ink, 22, cv2.LINE_AA)
    stroke = 46
    for face in faces[2:4]:  # A
        for ends in (((150, 390), (255, 120)), ((255, 120), (360, 390)), ((190, 300), (320, 300))):
            cv2.line(face, *ends, red, stroke, cv2.LINE_AA)
    for face in faces[0:2]:  # B
        cv2.line(face, (180, 125), (180, 385), green, stroke, cv2.LINE_AA)
        for middle, radius in ((188, 63), (318, 67)):
            cv2.line(face, (180, middle - radius), (270, middle - radius), green, stroke, cv2.LINE_AA)
            cv2.line(face, (180, middle + radius), (270, middle + radius), green, stroke, cv2.LINE_AA)
            cv2.ellipse(face, (270, middle), (radius, radius), 0, -90, 90, green, stroke, cv2.LINE_AA)
    for face in faces[4:6]:  # a star
        angles = np.arange(10) * np.pi / 5
        reach = np.where(np.arange(10) % 2 == 0, 165, 72)
        star = np.stack([255 + reach * np.sin(angles), 262 - reach * np.cos(angles)], axis=1)
        cv2.fillPoly(face, [star.astype(np.int32)], blue, cv2.LINE_AA)
    return faces
