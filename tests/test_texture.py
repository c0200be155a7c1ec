"""The texture: drawing the model gives its picture back, and no level of a mip map shows a seam."""

import dataclasses
import json
import math

import cv2
import numpy as np
import pytest

import stereo_gpu as sg
from stereo_gpu.backends import open_backend
from stereo_gpu.config import MeshOptions
from stereo_gpu.evaluation.pairs import load_pair
from stereo_gpu.evaluation.redraw import psnr, redraw
from stereo_gpu.prepare import grey_scale
from stereo_gpu.texture import bake_texture, project
from stereo_gpu.types import Mesh, RectifiedPair, Surface, View
from stereo_gpu.unwrap import Unwrapped, unwrap

# What the project asks of the texture, dB.
PSNR = {"charts": 36.0, "view": 44.0}
SEAM = (0.01, 0.05, 0.5)  # mean difference of both sides of a seam by level, of 255: nobody sees a tenth
DIFFERENT = 1e-3  # of the levels; GPUs may round a division otherwise, which moves a sample by 1e-6 px
ROUNDED = 1  # of 255 levels: light is kept as 16 bits, in which the darkest levels are 20 apart


def scene_model(raw_folder):
    rig = sg.Rig.load(raw_folder / "rig.json")
    return sg.reconstruct(raw_folder / "left.png", raw_folder / "right.png", rig, profile="fast", mesh=OPTIONS)


def motorcycle_model(data):
    pair = load_pair(data, "motorcycle")
    camera = json.loads((data / "stereo" / "motorcycle" / "calib.json").read_text())
    rectified = RectifiedPair.from_geometry(
        pair.left,
        pair.right,
        focal_px=camera["focal_px"],
        baseline=camera["baseline_mm"],
        cx_left=camera["cx0"],
        cx_right=camera["cx0"] + camera["doffs_px"],
        cy=camera["cy"],
    )
    return sg.reconstruct_rectified(rectified, profile="fast", disparities=(0, 64), mesh=OPTIONS)


def cup_model(data):
    folder = data / "rigs" / "cup"
    file = cv2.FileStorage(str(folder / "published_opencv.yml"), cv2.FILE_STORAGE_READ)
    values = {name: file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T")}
    cameras = [sg.Camera(values[f"K{i}"], values[f"D{i}"].ravel(), (640, 480)) for i in (1, 2)]
    rig = sg.Rig(*cameras, values["R"], values["T"].ravel(), 0.0, 0.0, ())
    pictures = [folder / "test_images" / f"{side}Pic.jpg" for side in ("left", "right")]
    return sg.reconstruct(*pictures, rig, profile="fast", disparities=(0, 160), mesh=OPTIONS)


OPTIONS = MeshOptions(unwrap="view", faces=20_000)
MAKERS = {"scene": (scene_model, "raw_folder"), "motorcycle": (motorcycle_model, "data"), "cup": (cup_model, "data")}


@pytest.fixture(scope="module", params=list(MAKERS))
def model(request):
    """A whole reconstruction; each has a right picture of its own kind."""
    make, what = MAKERS[request.param]
    return make(request.getfixturevalue(what))


@pytest.fixture(scope="module")
def device():
    return open_backend(None)


def baked(device, surface, pair, method, view=View.RIGHT, **options):
    """A surface textured with a view's picture; and what it is unwrapped to."""
    unwrapped = unwrap(surface, project(surface.vertices, pair, view)[:, :2], method=method, **options)
    assert unwrapped.reason is None
    return textured(device, unwrapped, pair, view), unwrapped


def textured(device, unwrapped, pair, view=View.RIGHT):
    picture = pair.right if view is View.RIGHT else pair.left
    texture = bake_texture(device, device.upload(picture), grey_scale(picture), unwrapped, pair, view)
    return Mesh(vertices=unwrapped.vertices, faces=unwrapped.faces, uv=unwrapped.uv, texture=texture)


def psnr_of(device, mesh, pair, view=View.RIGHT):
    drawn, there = redraw(device, mesh, pair, view)
    assert there.sum() > 5000
    picture = pair.right if view is View.RIGHT else pair.left
    return psnr(drawn, picture, there, grey_scale(picture))


@pytest.mark.parametrize("method", ["charts", "view"])
def test_the_right_camera_sees_its_picture_again(device, model, method):
    mesh, _ = baked(device, model.smoothed, model.pair, method)
    assert psnr_of(device, mesh, model.pair) >= PSNR[method]


def test_the_result_is_such_a_texture(device, model):
    assert psnr_of(device, model.mesh, model.pair) >= PSNR["view"]


def turned(unwrapped, seen, angle, scale=1.0):
    """The view's own coordinates, turned in the atlas, so that no texel meets a pixel."""
    a, b = scale * math.cos(angle), scale * math.sin(angle)
    place = seen @ np.array([[a, b], [-b, a]])
    place += 4.25 - np.floor(place.min(axis=0))
    size = np.ceil(place.max(axis=0) + 4).astype(int)
    return dataclasses.replace(unwrapped, uv=(place / size).astype(np.float32), size=(int(size[0]), int(size[1])))


@pytest.mark.parametrize("angle", [0.3, 0.0, math.pi / 2])
def test_texels_between_pixels_give_the_picture_back_too(device, model, angle):
    """At 0 and at a quarter turn all texels are a quarter of a pixel off, either way."""
    seen = project(model.smoothed.vertices, model.pair, View.RIGHT)[:, :2]
    unwrapped = turned(unwrap(model.smoothed, seen, method="view"), seen, angle)
    assert psnr_of(device, textured(device, unwrapped, model.pair), model.pair) >= PSNR["charts"]


def plane(corners, size, depth=1000.0):
    """Two triangles that show a rectangle of pictures of a size, their pair, and where the right camera sees them."""
    left, top, right, bottom = corners
    pair = RectifiedPair.from_geometry(
        *[np.zeros((size[1], size[0], 3), np.uint8)] * 2,
        focal_px=500.0,
        baseline=80.0,
        cx_left=size[0] / 2,
        cx_right=size[0] / 2,
        cy=size[1] / 2,
    )
    seen = np.array([[left, top], [right, top], [left, bottom], [right, bottom]], float)
    vertices = np.column_stack([(seen - [size[0] / 2, size[1] / 2]) * depth / 500.0, np.full(4, depth)])
    vertices[:, 0] += 80.0
    return Surface(vertices=vertices.astype(np.float32), faces=np.array([[0, 2, 1], [1, 2, 3]], np.int32)), pair


def noise(size, dtype=np.uint8, channels=3):
    shape = (size[1], size[0], channels) if channels > 1 else size[::-1]
    return np.random.default_rng(1).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)


@pytest.mark.parametrize("view", list(View))
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_texel_on_a_pixel_is_a_copy_of_it_and_so_are_those_beside_the_mesh(dtype, channels, view):
    device = open_backend(None)
    surface, pair = plane((7, 5, 40, 30), (64, 48))
    picture = noise((64, 48), dtype, channels)
    pair = dataclasses.replace(pair, left=picture, right=picture)
    if view is View.LEFT:
        surface = dataclasses.replace(surface, vertices=surface.vertices - np.float32([80, 0, 0]))
    seen = project(surface.vertices, pair, view)[:, :2]
    unwrapped = unwrap(surface, seen, method="view")
    scale = 255 / np.iinfo(dtype).max
    texture = bake_texture(device, device.upload(picture), scale, unwrapped, pair, view)
    x, y = np.round(unwrapped.uv[0] * unwrapped.size - 0.5 - seen[0]).astype(int)
    # With a texel all around, which samples on the border take in.
    want = np.floor(picture[4:32, 6:42] * scale + 0.5)
    got = texture[4 + y : 32 + y, 6 + x : 42 + x].astype(int)
    assert np.abs(got - want.reshape(28, 36, -1)).max() <= (0 if dtype == np.uint8 else ROUNDED)


def test_what_is_no_picture_gets_into_no_texel():
    """A rectified picture is black where its camera saw nothing; a mesh may end there."""
    device = open_backend(None)
    surface, pair = plane((7, 5, 40, 30), (64, 48))
    valid = np.zeros((48, 64), np.uint8)
    valid[5:31, 7:41] = 1
    picture = np.full((48, 64, 3), 90, np.uint8) * valid[..., None]
    pair = dataclasses.replace(pair, right=picture, valid_right=valid)
    seen = project(surface.vertices, pair, View.RIGHT)[:, :2]
    assert (textured(device, unwrap(surface, seen, method="view"), pair).texture == 90).all()


def test_a_coarse_atlas_averages_light():
    """Every second pixel is white: half the light, which is level 188. A sample of single pixels would be patchy."""
    device = open_backend(None)
    surface, pair = plane((1, 1, 190, 126), (192, 128))
    picture = np.zeros((128, 192, 3), np.uint8)
    picture[::2, ::2] = picture[1::2, 1::2] = 255
    seen = project(surface.vertices, pair, View.RIGHT)[:, :2]
    unwrapped = unwrap(surface, seen, method="view", max_size=60)
    texture = bake_texture(device, device.upload(picture), 1.0, unwrapped, pair, View.RIGHT)
    assert max(texture.shape[:2]) <= 60
    assert np.abs(texture.astype(int) - 188).max() <= ROUNDED


def mips(texture):
    """Levels of a mip map in linear light, box-filtered; a side that is odd keeps its last texels to itself."""
    level = np.arange(256) / 255
    light = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)[texture]
    while True:
        yield light
        if light.shape[:2] == (1, 1):
            return
        light = np.pad(light, ((0, light.shape[0] % 2), (0, light.shape[1] % 2), (0, 0)), mode="edge")
        light = (light[::2, ::2] + light[1::2, ::2] + light[::2, 1::2] + light[1::2, 1::2]) / 4


def test_a_picture_of_one_colour_is_that_colour_at_every_level(model, device):
    """Any colour of the atlas' background would show."""
    colour = np.array([201, 120, 33], np.uint8)
    picture = np.broadcast_to(colour, (*model.pair.right.shape[:2], 3)).copy()
    seen = project(model.smoothed.vertices, model.pair, View.RIGHT)[:, :2]
    unwrapped = unwrap(model.smoothed, seen, method="charts")
    texture = bake_texture(device, device.upload(picture), 1.0, unwrapped, model.pair, View.RIGHT)
    assert np.abs(texture.astype(int) - colour).max() <= ROUNDED
    *_, whole = mips(texture)
    assert whole.shape == (1, 1, 3)


def apart(parts, shift):
    """Two rectangles in one atlas with a wide gap between their charts, which are the pieces of the view."""
    unwrapped = [unwrap(surface, seen, method="view") for surface, seen in parts]
    size = np.array([shift + unwrapped[1].size[0], max(part.size[1] for part in unwrapped)])
    uv = [part.uv * part.size + [shift * k, 0] for k, part in enumerate(unwrapped)]
    count = len(unwrapped[0].vertices)
    return Unwrapped(
        vertices=np.concatenate([part.vertices for part in unwrapped]),
        faces=np.concatenate([unwrapped[0].faces, unwrapped[1].faces + count]),
        uv=(np.concatenate(uv) / size).astype(np.float32),
        vertex_map=np.arange(2 * count, dtype=np.int32),
        size=(int(size[0]), int(size[1])),
        method="view",
    )


def test_levels_between_two_charts_mix_no_third_colour():
    device = open_backend(None)
    picture = np.zeros((64, 128, 3), np.uint8)
    picture[:, :64], picture[:, 64:] = (255, 0, 0), (0, 0, 255)
    parts = []
    for corners in ((9, 8, 50, 49), (73, 12, 118, 57)):
        surface, pair = plane(corners, (128, 64))
        parts.append((surface, project(surface.vertices, pair, View.RIGHT)[:, :2]))
    unwrapped = apart(parts, 80)
    texture = bake_texture(device, device.upload(picture), 1.0, unwrapped, pair, View.RIGHT)
    for level, light in enumerate(mips(texture)):
        assert np.abs(light[..., 0] + light[..., 2] - 1).max() < 0.01, level
        assert light[..., 1].max() == 0
        if level < 3:
            # Nor the other chart's, where a chart is sampled bilinearly.
            texels = unwrapped.uv * unwrapped.size / 2**level - 0.5
            for chart, channel in ((texels[:4], 0), (texels[4:], 2)):
                (left, top), (right, bottom) = np.floor(chart.min(axis=0)), np.ceil(chart.max(axis=0))
                assert light[int(top) : int(bottom) + 1, int(left) : int(right) + 1, channel].min() > 0.99, level


def cut(surface, seen, side):
    """Square pieces of the view as charts, all moved by whole cells of 4 texels, one empty cell between any two."""
    tile = (seen[surface.faces].mean(axis=1) // side).astype(int)
    keys = (tile @ [1, 1000])[:, None] * len(seen) + surface.faces
    used, faces = np.unique(keys, return_inverse=True)
    chart, vertex = np.divmod(used, len(seen))
    texels = seen[vertex].copy()
    corner, tallest = np.array([4, 4]), 0
    for number in np.unique(chart):
        mine = texels[chart == number]
        low = 4 * np.floor(mine.min(axis=0) / 4)
        cells = np.floor((mine.max(axis=0) - low) / 4).astype(int) + 1
        if corner[0] + 4 * cells[0] > 1000:
            corner, tallest = np.array([4, corner[1] + 4 * tallest + 4]), 0
        texels[chart == number] += corner - low
        corner += [4 * cells[0] + 4, 0]
        tallest = max(tallest, cells[1])
    size = np.array([1004, corner[1] + 4 * tallest + 4])
    return Unwrapped(
        vertices=surface.vertices[vertex],
        faces=faces.reshape(-1, 3).astype(np.int32),
        uv=((texels + 0.5) / size).astype(np.float32),
        vertex_map=vertex.astype(np.int32),
        size=(int(size[0]), int(size[1])),
        method="xatlas",
    )


def test_both_sides_of_a_seam_look_alike(model, device):
    """Where charts are cut apart, samples of both sides at one place of the surface; in levels 0, 1 and 2."""
    seen = project(model.smoothed.vertices, model.pair, View.RIGHT)[:, :2]
    unwrapped = cut(model.smoothed, seen, 40)
    mesh = textured(device, unwrapped, model.pair)
    order = np.argsort(unwrapped.vertex_map, kind="stable")
    twin = unwrapped.vertex_map[order][1:] == unwrapped.vertex_map[order][:-1]
    first, second = order[:-1][twin], order[1:][twin]
    assert len(first) > 500
    for level, light in zip(range(3), mips(mesh.texture), strict=False):
        sides = []
        for side in (first, second):
            at = mesh.uv[side] * mesh.texture.shape[1::-1] / 2**level - 0.5
            sides.append(cv2.remap(light.astype(np.float32), *at.T.astype(np.float32), cv2.INTER_LINEAR))
        off = np.abs(np.diff([255 * np.maximum(side, 0) ** (1 / 2.2) for side in sides], axis=0))
        assert off.mean() <= SEAM[level], level
        assert np.percentile(off, 99) <= 10 * SEAM[level], level


def test_every_device_makes_the_same_texture(backend):
    surface, pair = plane((3, 3, 60, 44), (64, 48))
    pair = dataclasses.replace(pair, right=noise((64, 48)))
    surface = dataclasses.replace(surface, vertices=surface.vertices * np.float32([[1], [1.5], [0.8], [1.2]]))
    seen = project(surface.vertices, pair, View.RIGHT)[:, :2]
    unwrapped = turned(unwrap(surface, seen, method="view"), seen, 0.3)
    want = textured(open_backend("warp:cpu"), unwrapped, pair).texture
    assert want.std() > 50
    off = np.abs(textured(backend, unwrapped, pair).texture.astype(int) - want)
    assert (off > 0).mean() <= DIFFERENT and off.max() <= ROUNDED
