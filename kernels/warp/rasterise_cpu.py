"""Which triangle each sample of a picture shows: the form for CPUs.

A work-item owns a band of rows of the picture and draws what every triangle has there, one after the other, in one
stage.
"""

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
    """What rasterise.py computes, where members is the rows of a band; stage is not used."""
    band = wp.tid()
    first = band * members
    last = wp.min(first + members, height)
    for face in range(triangles):
        t = load_triangle(screen, faces, face)
        top = first_sample(least(t.a[1], t.b[1], t.c[1]), first, last)
        bottom = past_samples(most(t.a[1], t.b[1], t.c[1]), top, last)
        if top < bottom and can_be_seen(t):
            left = first_sample(least(t.a[0], t.b[0], t.c[0]), 0, width)
            right = past_samples(most(t.a[0], t.b[0], t.c[0]), left, width)
            for y in range(top, bottom):
                for x in range(left, right):
                    s = shares_at(t, float(x), float(y))
                    if s[0] >= 0.0 and s[1] >= 0.0 and s[2] >= 0.0:
                        at = y * width + x
                        near = wp.cast(s[0] * t.a[2] + s[1] * t.b[2] + s[2] * t.c[2], wp.int32)
                        if near >= depth_out[at]:
                            depth_out[at] = near
                            owner_out[at] = face + 1
