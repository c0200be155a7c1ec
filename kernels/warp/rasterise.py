"""Which triangle each sample of a picture shows."""

import warp as wp

from stereo_gpu.kernels.warp.triangle import (
    can_be_seen,
    first_sample,
    least,
    load_triangle,
    most,
    past_samples,
    shares_at,
)

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def rasterise(
    # In:
    screen: wp.array(dtype=float),
    faces: wp.array(dtype=int),
    triangles: int,
    width: int,
    height: int,
    members: int,
    stage: int,
    # Out:
    depth_out: wp.array(dtype=int),
    owner_out: wp.array(dtype=int),
):
    """Number of the nearest triangle at each sample, counted from 1, and the bits of its 1 / depth.

    Both must come in as 0. screen is (N, 3): a vertex's column and row, px, sample centres at whole numbers, and
    1 / depth, 0 where it is not to be drawn; faces is (M, 3). What lies on an edge belongs to both triangles; of equal
    depths the last triangle wins, so that a picture does not change from run to run. Stage 0 finds depths, stage 1
    triangles: an atomic of 64 bits, which would do both, is not to be had everywhere. The bits of a positive number
    order as the number does.
    """
    face, member = wp.tid()
    t = load_triangle(screen, faces, face)
    if can_be_seen(t):
        left = first_sample(least(t.a[0], t.b[0], t.c[0]), 0, width)
        top = first_sample(least(t.a[1], t.b[1], t.c[1]), 0, height)
        columns = past_samples(most(t.a[0], t.b[0], t.c[0]), left, width) - left
        rows = past_samples(most(t.a[1], t.b[1], t.c[1]), top, height) - top
        # Members of a triangle share the samples of its box, neighbours side by side.
        for cell in range(member, columns * rows, members):
            x = left + cell % columns
            y = top + cell / columns
            at = y * width + x
            s = shares_at(t, float(x), float(y))
            if s[0] >= 0.0 and s[1] >= 0.0 and s[2] >= 0.0:
                near = wp.cast(s[0] * t.a[2] + s[1] * t.b[2] + s[2] * t.c[2], wp.int32)
                if stage == 0:
                    wp.atomic_max(depth_out, at, near)
                elif depth_out[at] == near:
                    wp.atomic_max(owner_out, at, face + 1)
