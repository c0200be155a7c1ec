"""A real table top with a cup, a bottle and a tripod: what is known of it comes out of a whole reconstruction."""

import itertools

import cv2
import numpy as np
import pytest

import stereo_gpu as sg

# Where the corners of the board on the table are in the rectified right picture, to a pixel, read off by eye: rows
# of neighbours, from the far side to the near one, as far as the left camera sees them too.
CORNERS = [
    [(179, 420), (214, 422), (250, 424), (286, 427), (323, 430), (359, 434), (396, 437), (433, 439), (470, 441)],
    [(163, 430), (202, 434), (242, 438), (282, 440), (322, 443), (362, 446), (402, 449), (443, 452)],
    [(145, 445), (188, 449), (232, 453), (276, 456), (321, 459), (366, 462), (411, 466)],
]
SQUARE = 12.0  # mm


@pytest.fixture(scope="module")
def cup(data):
    """Reconstruction of the raw pair with the rig that the pictures' owner published."""
    folder = data / "rigs" / "cup"
    file = cv2.FileStorage(str(folder / "published_opencv.yml"), cv2.FILE_STORAGE_READ)
    values = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    cameras = [sg.Camera(values[f"K{i}"], values[f"D{i}"].ravel(), (640, 480)) for i in (1, 2)]
    rig = sg.Rig(*cameras, values["R"], values["T"].ravel(), 0.0, 0.0, ())
    pictures = [folder / "test_images" / f"{side}Pic.jpg" for side in ("left", "right")]
    return sg.reconstruct(*pictures, rig)


def at(points, column, row):
    x, y = int(column), int(row)
    a, b = column - x, row - y
    upper = points[y, x] * (1 - a) + points[y, x + 1] * a
    return upper * (1 - b) + (points[y + 1, x] * (1 - a) + points[y + 1, x + 1] * a) * b


def test_the_board_on_the_table_measures_12_mm_and_is_flat(cup):
    picture = cup.pair.right
    corners = []
    for row in CORNERS:
        seeds = np.array(row, np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(picture, seeds.copy(), (4, 3), (-1, -1), (3, 50, 1e-3))
        assert np.abs(found - seeds).max() < 3
        corners.append(np.array([at(cup.points, *corner) for corner in found[:, 0]]))
    assert np.isfinite(np.concatenate(corners)).all()
    along = np.concatenate([np.linalg.norm(np.diff(row, axis=0), axis=1) for row in corners])
    away = np.concatenate(
        [np.linalg.norm(near - far[: len(near)], axis=1) for far, near in itertools.pairwise(corners)]
    )
    assert abs(along.mean() - SQUARE) <= 0.1
    assert (np.abs(along - SQUARE) <= 0.3).mean() >= 0.85
    # Away from the camera the table is seen at a grazing angle: a row of pixels is 0.8 mm there, and a corner can
    # be located to about half a row.
    assert abs(away.mean() - SQUARE) <= 0.3
    every = np.concatenate(corners)
    _, _, axes = np.linalg.svd(every - every.mean(axis=0))
    assert np.std((every - every.mean(axis=0)) @ axes[2]) <= 0.3


@pytest.mark.parametrize("row", [235, 245])
def test_the_cup_is_round(cup, row):
    across = cup.points[row, 320:435][:, [0, 2]].astype(float)
    assert np.isfinite(across).all()
    fit = np.linalg.lstsq(np.c_[2 * across, np.ones(len(across))], (across**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(fit[2] + fit[0] ** 2 + fit[1] ** 2)
    assert 50 < radius < 70
    assert np.std(np.hypot(*(across - fit[:2]).T) - radius) <= 0.6


def test_cup_bottle_and_tripod_stand_apart(cup):
    """Depth in mm at a place on each thing, and on the curtain behind."""
    places = {"cup": (380, 245), "bottle": (258, 330), "tripod": (182, 210), "curtain": (420, 120)}
    depth = {thing: np.nanmedian(cup.points[y - 3 : y + 4, x - 3 : x + 4, 2]) for thing, (x, y) in places.items()}
    assert depth["bottle"] < depth["cup"] - 30
    assert depth["bottle"] < depth["tripod"]
    assert depth["curtain"] > depth["cup"] + 150


@pytest.mark.parametrize(("region", "share"), [((450, 590, 20, 180), 0.98), ((150, 450, 400, 470), 0.9)])
def test_curtain_and_table_are_whole(cup, region, share):
    """How much of the curtain right of the cup, and of the table before it, the mesh covers in the right picture."""
    left, right, top, bottom = region
    x, y, z = (cup.mesh.vertices[:, i].astype(float) for i in range(3))
    place = np.stack([x - cup.pair.baseline, y], axis=1) / z[:, None] * cup.pair.focal_px
    corners = (place + np.array([cup.pair.cx_right, cup.pair.cy]))[cup.mesh.faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    middle = corners.mean(axis=1)
    inside = (middle > (left, top)).all(axis=1) & (middle < (right, bottom)).all(axis=1)
    assert area[inside].sum() > share * (right - left) * (bottom - top)
