"""Cells of evidence and the robust planes through them, against the loops in reference.py, and both forms' bits."""

import numpy as np
import pytest
import reference
from test_gpu_forms import opened

# Sums of up to 16 products in single precision, relative.
CELL_TOLERANCE = 1e-6
# Sums of up to 625 products in single precision, px and px a pixel.
PLANE_TOLERANCE = 5e-4
SLOPE_TOLERANCE = 1e-4
# A cell may lie just within or just beyond the tolerance: share of the weight.
SHARE_TOLERANCE = 0.02
FORMS = [("opencl", "gpu"), ("opencl", "cpu"), ("warp:cpu", "gpu"), ("warp:cpu", "cpu")]
# A pixel, less than a cell, less than a vector, a vector and a bit, more than what is taken at a time.
SHAPES = [(1, 1), (2, 3), (5, 17), (31, 47), (70, 333), (9, 2700)]
# (cell, spacing, reach); the last ones reach too far or stand too far apart for the lines of the form for CPUs.
GRIDS = [(4, 2, 12), (4, 1, 3), (3, 3, 5), (1, 2, 4), (2, 4, 16), (1, 1, 20), (2, 9, 7), (1, 40, 1)]


def evidence(shape, seed=0):
    """Two leaning surfaces, noise, what lies elsewhere, and pixels and parts that tell nothing."""
    height, width = shape
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    moved = 90 + 0.12 * x - 0.3 * y + 9 * (x > 0.6 * width) + rng.normal(0, 0.2, shape)
    outliers = rng.random(shape) < 0.1
    moved[outliers] += rng.uniform(-20, 20, np.count_nonzero(outliers))
    moved[rng.random(shape) < 0.05] = np.nan
    information = rng.gamma(1.0, 20.0, shape) * ((x % 2 == 0) & (y % 2 == 0))
    information[: height // 2, width // 4 : width // 2] = 0
    return moved.astype(np.float32), information.astype(np.float32)


def launch_cells(backend, moved, information, cell, least):
    height, width = moved.shape
    out = backend.upload(np.full((4, -(-height // cell), -(-width // cell)), 77, np.float32))
    held = {"moved": backend.upload(moved), "information": backend.upload(information)}
    backend.launch("cells", **held, width=width, height=height, cell=cell, least=least, cells_out=out)
    return backend.download(out)


def launch_planes(backend, cells, cell, spacing, reach, tolerance):
    cells_high, cells_wide = cells.shape[1:]
    planes_high, planes_wide = -(-cells_high // spacing), -(-cells_wide // spacing)
    out = backend.upload(np.full((4, planes_high, planes_wide), 77, np.float32))
    backend.launch(
        "planes",
        cells=backend.upload(cells),
        cells_wide=cells_wide,
        cells_high=cells_high,
        planes_wide=planes_wide,
        planes_high=planes_high,
        cell=cell,
        spacing=spacing,
        reach=reach,
        tolerance=tolerance,
        planes_out=out,
    )
    return backend.download(out)


def cells_of(shape, cell):
    return reference.cells(*evidence(shape), cell, 4.0).astype(np.float32)


@pytest.mark.parametrize(("shape", "cell"), [((31, 47), 4), ((30, 52), 1), ((17, 66), 5), ((3, 2), 7)])
def test_cells(backend, shape, cell):
    moved, information = evidence(shape)
    found = launch_cells(backend, moved, information, cell, 4.0)
    want = reference.cells(moved, information, cell, 4.0)
    np.testing.assert_allclose(found, want, rtol=CELL_TOLERANCE)
    assert (want[0] > 0).any()
    assert (want[0] == 0).any() or shape == (3, 2)


@pytest.mark.parametrize(
    ("shape", "cell", "spacing", "reach"),
    [((62, 85), 4, 2, 6), ((31, 47), 3, 3, 4), ((20, 33), 2, 1, 5), ((7, 9), 4, 2, 12)],
)
def test_planes(backend, shape, cell, spacing, reach):
    cells = cells_of(shape, cell)
    found = launch_planes(backend, cells, cell, spacing, reach, 1.0)
    want = reference.planes(cells, found.shape[1:], cell, spacing, reach, 1.0)
    np.testing.assert_allclose(found[0], want[0], rtol=0, atol=PLANE_TOLERANCE)
    np.testing.assert_allclose(found[1:3], want[1:3], rtol=0, atol=SLOPE_TOLERANCE)
    np.testing.assert_allclose(found[3], want[3], rtol=0, atol=SHARE_TOLERANCE)
    assert np.isfinite(want[0]).any()


def test_planes_lie_on_the_surface_that_most_cells_do(backend):
    cells = cells_of((96, 160), 4)
    value, along_x, along_y, share = launch_planes(backend, cells, 4, 2, 12, 1.0)
    y, x = np.mgrid[: value.shape[0], : value.shape[1]] * 8 + 3.5
    near = x > 130  # all that is within reach belongs to the nearer surface, but for outliers
    np.testing.assert_allclose(value[near], (99 + 0.12 * x - 0.3 * y)[near], rtol=0, atol=0.5)
    assert abs(along_x[near].mean() - 0.12) < 0.01 and abs(along_y[near].mean() + 0.3) < 0.01
    assert share[near].min() > 0.5
    edge = (x > 92) & (x < 100)
    assert share[edge].mean() < share[near].mean() - 0.1


def test_no_cell_gives_no_plane(backend):
    cells = np.zeros((4, 9, 21), np.float32)
    cells[:, 8, 20] = 30, 82, 34, 7
    value, along_x, along_y, share = launch_planes(backend, cells, 4, 2, 3, 1.0)
    reached = np.isfinite(value)
    assert 0 < np.count_nonzero(reached) < 10
    np.testing.assert_allclose(value[reached], 7, rtol=1e-6)
    assert not along_x.any() and not along_y.any()
    np.testing.assert_array_equal(share, reached)


@pytest.mark.parametrize("cell", [1, 3, 4, 30])
@pytest.mark.parametrize("shape", SHAPES)
def test_cells_are_the_same_in_all_forms(shape, cell):
    moved, information = evidence(shape)
    information[0, 0], moved[0, 0] = 5, 3
    first, *others = (launch_cells(opened(*form), moved, information, cell, 2.0) for form in FORMS)
    for other in others:
        np.testing.assert_array_equal(first, other)
    assert first[0].any()


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("shape", SHAPES)
def test_planes_are_the_same_in_all_forms(shape, grid):
    cell, spacing, reach = grid
    moved, information = evidence(shape)
    information[0, 0], moved[0, 0] = 5, 3
    cells = launch_cells(opened(*FORMS[0]), moved, information, cell, 2.0)
    first, *others = (launch_planes(opened(*form), cells, cell, spacing, reach, 1.0) for form in FORMS)
    for other in others:
        np.testing.assert_array_equal(first, other)
    # A plane in the middle of so large a block has no cell within reach.
    assert np.isfinite(first[0]).any() or spacing == 40 or shape == (1, 1)
