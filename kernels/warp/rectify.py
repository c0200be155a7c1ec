"""Undistort and rectify in one resampling of the raw picture."""

from typing import Any

import warp as wp

from stereo_gpu.kernels.warp.sampling import sample

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def rectify(
    # In:
    picture: wp.array(dtype=Any),
    lens: wp.array(dtype=float),
    ray: wp.array(dtype=float),
    source_width: int,
    source_height: int,
    channels: int,
    width: int,
    height: int,
    # Out:
    rectified_out: wp.array(dtype=Any),
    valid_out: wp.array(dtype=wp.uint8),
):
    """The raw picture as the rectified camera would see it, and 1 where it has content; 0 and black elsewhere.

    ray is a (3, 3) matrix from rectified pixel (x, y, 1) to a direction in the raw camera's frame; lens is
    fx, fy, cx, cy and OpenCV's k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 of the raw camera.
    """
    y, x = wp.tid()
    pixel = y * width + x
    column = float(x)
    row = float(y)
    depth = ray[6] * column + ray[7] * row + ray[8]
    valid = int(0)
    u = float(0.0)
    v = float(0.0)
    if depth > 0.0:
        a = (ray[0] * column + ray[1] * row + ray[2]) / depth
        b = (ray[3] * column + ray[4] * row + ray[5]) / depth
        r2 = a * a + b * b
        radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
        radial = radial / (1.0 + r2 * (lens[9] + r2 * (lens[10] + r2 * lens[11])))
        bent_a = a * radial + 2.0 * lens[6] * a * b + lens[7] * (r2 + 2.0 * a * a)
        bent_b = b * radial + lens[6] * (r2 + 2.0 * b * b) + 2.0 * lens[7] * a * b
        bent_a += r2 * (lens[12] + r2 * lens[13])
        bent_b += r2 * (lens[14] + r2 * lens[15])
        u = lens[0] * bent_a + lens[2]
        v = lens[1] * bent_b + lens[3]
        if u >= 0.0 and v >= 0.0 and u <= float(source_width - 1) and v <= float(source_height - 1):
            valid = 1
    valid_out[pixel] = wp.uint8(valid)
    for channel in range(channels):
        value = float(0.0)
        if valid == 1:
            value = sample(picture, source_width, source_height, channels, channel, u, v)
        rectified_out[pixel * channels + channel] = rectified_out.dtype(value + 0.5)
