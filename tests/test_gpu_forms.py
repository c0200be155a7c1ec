"""The forms of kernels for GPUs give the same bits as the forms for CPUs, in both languages, on the CPU."""

from functools import cache

import numpy as np
import pytest
from conftest import missing
from test_matching_kernels import HEIGHT, WIDTH, junk, maps, prepared, winners
from test_smooth_path_kernels import aggregated, launch_lowest, paths_case, sums_case

from stereo_gpu.errors import BackendError


@cache
def opened(name, form):
    try:
        if name == "opencl":
            from stereo_gpu.backends import opencl

            # A GPU, where there is one, comes first, and has no compiler for the forms for CPUs.
            cpus = [status.name for status in opencl.statuses() if status.available and status.kind == "cpu"]
            if not cpus:
                missing(name, "no CPU can be used through OpenCL")
            return opencl.open_device(cpus[0].removeprefix("opencl:"), form)
        from stereo_gpu.backends import warp

        return warp.WarpBackend("cpu", form)
    except (BackendError, ImportError) as error:
        missing(name, str(error))


def pictures(shape, levels, seed):
    """Two pictures of so many grey levels; few make equal scores common."""
    rng = np.random.default_rng(seed)
    step = 255 // (levels - 1)
    return [(rng.integers(0, levels, shape) * step - 128).astype(np.float32) for _ in range(2)]


def downloaded(backend, out):
    return {name: backend.download(array) for name, array in out.items()}


# Chunks of disparities end within, at and next to winners, and strips within windows.
@pytest.mark.parametrize(
    ("shape", "smallest", "disparities", "size", "direction", "levels"),
    [
        ((40, 90), 0, 64, 11, 1, 256),
        ((40, 90), -20, 65, 3, -1, 2),
        ((23, 150), -64, 129, 5, 1, 2),
        ((37, 61), -100, 200, 31, -1, 3),
        ((20, 300), -60, 257, 7, 1, 2),
        ((5, 40), -500, 1000, 9, -1, 2),
        ((1, 1), 0, 130, 11, 1, 256),
        ((2, 900), 100, 128, 31, 1, 256),
    ],
)
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_ncc_wta(name, shape, smallest, disparities, size, direction, levels):
    ref, oth = pictures(shape, levels, disparities)
    mask = np.ones(shape, np.uint8)
    mask[: shape[0] // 4, : shape[1] // 3] = 0
    numbers = {"width": shape[1], "height": shape[0], "smallest": smallest, "disparities": disparities}
    numbers["direction"] = direction
    found = []
    for form in ("gpu", "cpu"):
        backend = opened(name, form)
        arrays, validity = prepared(backend, ref, oth, mask, size // 2, 1.0)
        fused, apart = winners(backend, shape), winners(backend, shape)
        numbers["radius"] = size // 2
        backend.launch("ncc_wta", **arrays, validity=validity, **numbers, subpixel=1, **fused)
        volume = junk(backend, (*shape, disparities), np.float32)
        backend.launch("ncc_volume", **arrays, **numbers, volume_out=volume)
        del numbers["radius"]
        backend.launch("wta", volume=volume, validity=validity, **numbers, subpixel=1, **apart)
        found += [downloaded(backend, fused), downloaded(backend, apart)]
    for other in found[1:]:
        for array, values in found[0].items():
            np.testing.assert_array_equal(values, other[array], err_msg=array)
    assert np.isfinite(found[0]["disparity_out"]).any() or shape == (1, 1)


@pytest.mark.parametrize("disparities", [11, 70, 300])  # fewer than work-items, more, and more than local memory holds
@pytest.mark.parametrize("heading", [0, 1, -1])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_aggregate(name, heading, disparities):
    cost, guide, start = paths_case((13, 19, disparities), disparities)
    sums = [aggregated(opened(name, form), cost, guide, start, heading, 1) for form in ("gpu", "cpu")]
    np.testing.assert_array_equal(*sums)
    assert (sums[0] != start).any()


@pytest.mark.parametrize("disparities", [1, 16, 17, 300])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_lowest(name, disparities):
    sums, validity = sums_case((7, 150, disparities), disparities)
    found = [launch_lowest(opened(name, form), sums, validity, -9, 1) for form in ("gpu", "cpu")]
    for got, want in zip(*found, strict=True):
        np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("kernel", ["merge", "agree", "fill"])
@pytest.mark.parametrize("shape", [(HEIGHT, WIDTH), (1, 1), (7, 300), (41, 3)])
@pytest.mark.parametrize("name", ["opencl", "warp:cpu"])
def test_maps(name, shape, kernel):
    rng = np.random.default_rng(8)
    values, validity = maps(shape)
    other, _ = maps(shape, 0.4)
    given = {"disparity": values, "validity": validity}
    numbers = {"width": shape[1], "height": shape[0]}
    outputs = ["disparity"]
    if kernel == "merge":
        sums = {name: rng.integers(0, 4400, shape).astype(np.float32) for name in ("lowest", "ratio")}
        rivals = {"disparity": other, "lowest": sums["ratio"], "validity": validity ^ 1, "ratio": sums["lowest"]}
        given |= sums | {f"rival_{name}": array for name, array in rivals.items()}
        numbers |= {"radius": 4, "margin": 3.0}
        outputs += ["lowest", "ratio"]
    elif kernel == "agree":
        given |= {"other_disparity": other + 1}
        numbers |= {"smallest": -3, "disparities": 40, "direction": -1, "tolerance": 0.75}
    else:
        numbers |= {"axis": 0, "reach": 1 << 30, "near": 4, "edges": 1, "tolerance": 1.0}
    for axis in (0, 1) if kernel == "fill" else (0,):
        found = []
        for form in ("gpu", "cpu"):
            backend = opened(name, form)
            out = {f"{output}_out": junk(backend, shape, np.float32) for output in outputs}
            out["validity_out"] = junk(backend, shape, np.uint8)
            held = {key: backend.upload(array) for key, array in given.items()}
            backend.launch(kernel, **held, **(numbers | {"axis": axis} if kernel == "fill" else numbers), **out)
            found.append(downloaded(backend, out))
        for output, array in found[0].items():
            np.testing.assert_array_equal(array, found[1][output], err_msg=output)
        assert (found[0]["validity_out"] != validity).any() or shape == (1, 1)
