"""The form of a kernel for CPUs gives the same answer, to the last bit, as the form for GPUs, on any OpenCL device."""

import cv2
import numpy as np
import pytest
from conftest import missing
from test_smooth_path_kernels import PENALTIES, paths_case, sums_case

from stereo_gpu.backends.opencl import open_device
from stereo_gpu.errors import BackendError

SIZES = [(1, 1), (3, 2), (17, 5), (47, 31), (150, 9)]


@pytest.fixture(scope="module")
def forms():
    try:
        return open_device("", "gpu"), open_device("", "cpu")
    except BackendError as error:
        missing("opencl", str(error))


def assert_same(forms, kernel, outputs, **arguments):
    """Launch both forms on the same input, with `outputs` by their name as they are beforehand."""
    results = []
    for backend in forms:
        held = {k: backend.upload(v) if isinstance(v, np.ndarray) else v for k, v in arguments.items()}
        out = {name: backend.upload(array) for name, array in outputs.items()}
        backend.launch(kernel, **held, **out)
        results.append({name: backend.download(array) for name, array in out.items()})
    for name, array in results[0].items():
        np.testing.assert_array_equal(array, results[1][name], err_msg=name)
    return results[0]


def junk(shape, dtype):
    return np.full(shape, 77, dtype)


def rows_of_hills(width, height):
    """A map with slopes, a jump and holes."""
    rng = np.random.default_rng(5)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    values = (2 + 0.1 * x + 0.3 * y + 5 * (x > 2 * width / 3) + rng.uniform(-0.4, 0.4, x.shape)).astype(np.float32)
    values[rng.random(values.shape) < 0.1] = np.nan
    values[height // 2 :, : width // 4] = np.nan
    return values


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("terms", [slice(0, 5), slice(0, 12), slice(2, 4), slice(5, 8)])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("source", [(41, 29), (1, 4), (2, 2)])
def test_rectify(forms, dtype, channels, terms, size, source):
    (width, height), (source_width, source_height) = size, source
    rng = np.random.default_rng(1)
    coefficients = np.zeros(12)
    coefficients[terms] = np.array([0.3, -0.1, 0.02, -0.01, 0.05, 0.5, -0.1, 0.04, 0.01, -0.005, 0.004, 0.002])[terms]
    lens = np.array([source_width, source_height, source_width / 2, source_height / 2, *coefficients])
    # The rectified picture reaches beyond the raw one, and its rightmost rays point backwards.
    ray = np.array([[1.7 / width, 0.05, -0.8], [0.02, 1.6 / height, -0.8], [-1.1 / width, 0.0, 1.0]])
    seen = assert_same(
        forms,
        "rectify",
        {"rectified_out": junk((height, width, channels), dtype), "valid_out": junk((height, width), np.uint8)},
        picture=rng.integers(0, np.iinfo(dtype).max + 1, (source_height, source_width, channels)).astype(dtype),
        lens=lens.astype(np.float32),
        ray=ray.astype(np.float32),
        source_width=source_width,
        source_height=source_height,
        channels=channels,
        width=width,
        height=height,
    )["valid_out"]
    assert set(np.unique(seen)) == {0, 1} or source != (41, 29) or min(size) < 5


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("size", SIZES)
def test_triangulate(forms, direction, size):
    width, height = size
    points = assert_same(
        forms,
        "triangulate",
        {"points_out": junk((height, width, 3), np.float32)},
        disparity=rows_of_hills(width, height) - 4,
        width=width,
        height=height,
        direction=direction,
        focal_px=612.5,
        baseline=99.8,
        cx_left=20.25,
        cx_right=17.5,
        cy=14.125,
    )["points_out"]
    assert np.isnan(points).any()


@pytest.mark.parametrize(("stride", "weighted", "direction"), [(1, 1, 1), (1, 0, -1), (2, 0, 1), (2, 1, -1), (3, 1, 1)])
@pytest.mark.parametrize("size", [*SIZES, (33, 6), (35, 5)])
def test_evidence(forms, stride, weighted, direction, size):
    width, height = size
    rng = np.random.default_rng(12)
    texture = rng.normal(0, 60, (2, height, width))
    reference, other = (np.round(cv2.GaussianBlur(t, (0, 0), 1.0) * 3).astype(np.float32) for t in texture)
    slopes = rng.uniform(-1, 1, (2, height, width)).astype(np.float32)
    seen = assert_same(
        forms,
        "evidence",
        {f"{name}_out": junk((height, width), np.float32) for name in ("moved", "information", "residual")},
        reference=reference,
        other=other,
        disparity=rows_of_hills(width, height) * direction,
        along_x=slopes[0],
        along_y=slopes[1],
        guide=rng.integers(80, 130, (3, height, width)).astype(np.uint8),
        width=width,
        height=height,
        radius=2,
        stride=stride,
        direction=direction,
        weighted=weighted,
        noise=2.0,
        damping=50.0,
        largest_step=1.0,
        keep=16.0,
    )
    assert seen["information_out"].max() > 1 or width < 20


@pytest.mark.parametrize("reach", [1, 2, 9])
@pytest.mark.parametrize("size", SIZES)
def test_slopes(forms, reach, size):
    names = ("along_x_out", "along_y_out")
    assert_same(
        forms,
        "slopes",
        {name: junk(size[::-1], np.float32) for name in names},
        disparity=rows_of_hills(*size),
        width=size[0],
        height=size[1],
        reach=reach,
        largest=0.5,
    )


@pytest.mark.parametrize("row_slope", [0, 1, -1, -3])
@pytest.mark.parametrize("disparities", [1, 31, 32, 64, 77])
@pytest.mark.parametrize("size", SIZES)
def test_aggregate(forms, row_slope, disparities, size):
    cost, guide, sums = paths_case((*size[::-1], disparities), 3)
    for heading in (0, 1, -1):
        assert_same(
            forms,
            "aggregate",
            {"sums_out": sums},
            cost=cost,
            guide=guide,
            width=size[0],
            height=size[1],
            disparities=disparities,
            heading=heading,
            row_slope=row_slope,
            **PENALTIES,
        )


@pytest.mark.parametrize("disparities", [1, 31, 32, 64, 77])
@pytest.mark.parametrize("size", SIZES)
def test_lowest(forms, disparities, size):
    sums, validity = sums_case((*size[::-1], disparities), 4)
    maps = dict.fromkeys(("disparity_out", "lowest_out", "ratio_out"), junk(size[::-1], np.float32))
    numbers = {"width": size[0], "height": size[1], "smallest": 5, "disparities": disparities, "subpixel": 1}
    assert_same(
        forms,
        "lowest",
        {**maps, "validity_out": junk(size[::-1], np.uint8)},
        sums=sums,
        validity=validity,
        **numbers,
    )


@pytest.mark.parametrize("size", SIZES)
def test_census(forms, size):
    width, height = size
    assert_same(
        forms,
        "census",
        {"bits_out": junk((height, width), np.int32)},
        picture=np.random.default_rng(6).integers(-9, 9, (height, width)).astype(np.float32),
        width=width,
        height=height,
    )


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", SIZES)
def test_guide(forms, dtype, channels, size):
    width, height = size
    most = np.iinfo(dtype).max
    shape = (height, width) if channels == 1 else (height, width, channels)
    assert_same(
        forms,
        "guide",
        {"guide_out": junk((3, height, width), np.uint8)},
        picture=np.random.default_rng(16).integers(0, most + 1, shape).astype(dtype),
        levels=np.array([400 / most, -60.3, -300 / most, 250.0, 0.0, 128.0], np.float32),
        width=width,
        height=height,
        channels=channels,
    )


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(("smallest", "disparities"), [(0, 1), (3, 8), (-20, 37), (0, 64), (400, 16), (-300, 600)])
@pytest.mark.parametrize("size", [*SIZES, (530, 3)])
def test_match_cost(forms, direction, smallest, disparities, size):
    width, height = size
    rng = np.random.default_rng(7)
    bits = rng.integers(0, 1 << 24, (2, height, width)).astype(np.int32)
    guide = rng.integers(90, 140, (2, 3, height, width)).astype(np.uint8)
    validity = np.where(rng.random((2, height, width)) < 0.1, 16, 2).astype(np.uint8)
    assert_same(
        forms,
        "match_cost",
        {"cost_out": junk((height, width, disparities), np.uint8)},
        reference_bits=bits[0],
        other_bits=bits[1],
        reference_guide=guide[0],
        other_guide=guide[1],
        reference_validity=validity[0],
        other_validity=validity[1],
        width=width,
        height=height,
        smallest=smallest,
        disparities=disparities,
        direction=direction,
    )


def triangles(many, size, source):
    """Triangles of all sizes, some without area, some reaching out of the atlas, some sampling out of the picture."""
    rng = np.random.default_rng(8)
    places = rng.uniform(-2, 1.1 * max(size), (many, 1, 2)) + rng.uniform(-9, 9, (many, 3, 2))
    places[::7, 2] = places[::7, 1]
    seen = rng.uniform(-3, 1.1 * max(source), (many, 3, 2))
    depth = rng.uniform(0.5, 2, (many, 3, 1))
    return np.concatenate([places, seen * depth, depth], axis=2).astype(np.float32)


@pytest.mark.parametrize("many", [1, 2, 300])
@pytest.mark.parametrize("reach", [0.0, 1.5])
@pytest.mark.parametrize("size", SIZES)
def test_cover(forms, many, reach, size):
    owner = assert_same(
        forms,
        "cover",
        {"owner_out": np.zeros(size[::-1], np.int32)},
        corners=triangles(many, size, (9, 9)),
        triangles=many,
        reach=reach,
        texture_width=size[0],
        texture_height=size[1],
    )["owner_out"]
    assert owner.any() or many < 300


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("margin", [0.0, 2.0])
def test_place(forms, size, margin):
    rng = np.random.default_rng(9)
    owner = np.where(rng.random(size[::-1]) < 0.3, 0, rng.integers(0, 41, size[::-1]))
    found = assert_same(
        forms,
        "place",
        {"place_out": junk((2, *size[::-1]), np.float32)},
        corners=triangles(40, size, (41, 29)),
        owner=(owner + (owner > 0) * rng.choice([0, 1 << 29, 1 << 30], size[::-1])).astype(np.int32),
        margin=margin,
        texture_width=size[0],
        texture_height=size[1],
    )["place_out"]
    np.testing.assert_array_equal(np.isnan(found), np.broadcast_to(owner == 0, found.shape))


def light(size, gaps):
    """Light with some texels missing."""
    rng = np.random.default_rng(10)
    out = rng.integers(0, 65536, (*size[::-1], 4)).astype(np.uint16)
    out[..., 3] = np.where(rng.random(size[::-1]) < gaps, 0, 65535)
    return out


def places(size, source):
    """Places in a picture and a little beyond it, and some that are none."""
    rng = np.random.default_rng(11)
    out = rng.uniform(-3, 1, (2, *size[::-1])) + rng.uniform(0, 1, (2, *size[::-1])) * np.reshape(source, (2, 1, 1))
    out[:, rng.random(size[::-1]) < 0.3] = np.nan
    return out.astype(np.float32)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("source", [(41, 29), (1, 1), (4, 5)])
@pytest.mark.parametrize(("cell", "bias", "gain"), [(1.0, 0.0, 1.0), (2.0, 32768.0, 3.0)])
def test_bake(forms, size, source, cell, bias, gain):
    assert_same(
        forms,
        "bake",
        {"texture_out": light(size, 0.5)},
        light=light(source, 0.0),
        places=places(size, source),
        width=source[0],
        height=source[1],
        cell=cell,
        bias=bias,
        gain=gain,
        texture_width=size[0],
        texture_height=size[1],
    )


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("source", [(41, 29), (1, 1), (4, 5)])
def test_residual(forms, size, source):
    assert_same(
        forms,
        "residual",
        {"residual_out": junk((*size[::-1], 4), np.uint16)},
        light=light(size, 0.0),
        texture=light(source, 0.1),
        places=places(size, source),
        texture_width=source[0],
        texture_height=source[1],
        width=size[0],
        height=size[1],
    )


@pytest.mark.parametrize("gaps", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("size", SIZES)
def test_pull_and_push(forms, size, gaps):
    width, height = -(-size[0] // 2), -(-size[1] // 2)
    fine, scalars = light(size, gaps), {"width": width, "height": height}
    coarse = assert_same(
        forms,
        "pull",
        {"coarse_out": junk((height, width, 4), np.uint16)},
        fine=fine,
        fine_width=size[0],
        fine_height=size[1],
        **scalars,
    )["coarse_out"]
    scalars = {"coarse_width": width, "width": size[0], "height": size[1]}
    assert_same(forms, "push", {"fine_out": fine}, coarse=coarse, **scalars)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(("smallest", "disparities"), [(0, 1), (3, 8), (-20, 37), (0, 33), (2, 200), (400, 16)])
@pytest.mark.parametrize("size", SIZES)
def test_wta(forms, direction, smallest, disparities, size):
    width, height = size
    rng = np.random.default_rng(11)
    # Few levels, so that many scores are equal.
    volume = rng.integers(-4, 9, (height, width, disparities)) / 8
    volume[0, 0] = 0
    found = assert_same(
        forms,
        "wta",
        {
            "disparity_out": junk((height, width), np.float32),
            "score_out": junk((height, width), np.float32),
            "ratio_out": junk((height, width), np.float32),
            "validity_out": junk((height, width), np.uint8),
            "other_out": np.zeros((height, width), np.int32),
        },
        volume=volume.astype(np.float32),
        validity=np.where(rng.random((height, width)) < 0.3, 16, 0).astype(np.uint8),
        width=width,
        height=height,
        smallest=smallest,
        disparities=disparities,
        direction=direction,
        subpixel=1,
    )
    assert np.isnan(found["disparity_out"][0, 0])
