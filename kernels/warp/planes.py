"""Fit robust planes through the cells around them."""

import warp as wp

from stereo_gpu.kernels.warp.robust_plane import fit_plane

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


# Warp's loop over the grid would take registers for its counters.
@wp.kernel(grid_stride=False)
def planes(
    # In:
    cells: wp.array(dtype=float),
    cells_wide: int,
    cells_high: int,
    planes_wide: int,
    planes_high: int,
    cell: int,
    spacing: int,
    reach: int,
    tolerance: float,
    # Out:
    planes_out: wp.array(dtype=float),
):
    """Least squares planes through the cells within `reach`, one in the middle of each spacing x spacing cells.

    Cells weigh by their own weight and (1 - r^2 / R^2)^3 at a distance of r of R px, and from the second of four fits
    on by (1 / (1 + (e / scale)^2))^2 where they are e px off the plane (Geman and McClure 1987), with scales of 4, 2
    and 1 px. Of each plane its value in its middle, its slopes along x and y, and the weight of the cells within
    tolerance px of it over the weight of all, a plane of the output each; NaN and zeros where no cell is near.
    """
    row, column = wp.tid()
    fit_plane(
        cells,
        cells_wide,
        cells_high,
        planes_wide,
        planes_high,
        column,
        row,
        cell,
        spacing,
        reach,
        tolerance,
        planes_out,
    )
