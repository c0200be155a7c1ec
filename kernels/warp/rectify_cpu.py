"""Undistort and rectify in one resampling of the raw picture: the form for CPUs.

A work-item takes a row, in blocks of columns: first where they all lie in the raw picture, then what is there.
"""

from typing import Any

import warp as wp

from stereo_gpu.kernels.warp.lanes import LANES, Floats, aligned, floats, place, put

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BLOCK = wp.constant(256)
MEMORY = wp.constant(816)  # three blocks and three vectors


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
    y = wp.tid()
    row = float(y)
    memory = wp.zeros(shape=(MEMORY,), dtype=float)
    depths = aligned(memory.ptr)
    columns_u = place(depths, BLOCK)
    rows_v = place(columns_u, BLOCK)
    counting = place(rows_v, BLOCK)
    depth_of = wp.array(ptr=depths, shape=(BLOCK,), dtype=float)
    u_of = wp.array(ptr=columns_u, shape=(BLOCK,), dtype=float)
    v_of = wp.array(ptr=rows_v, shape=(BLOCK,), dtype=float)
    count_at = wp.array(ptr=counting, shape=(LANES,), dtype=float)
    for lane in range(LANES):
        count_at[lane] = float(lane)
    # Arrays whose elements are known to lie side by side are faster to read.
    pixels = wp.array(ptr=picture.ptr, shape=(1,), dtype=picture.dtype)
    pixels_out = wp.array(ptr=rectified_out.ptr, shape=(1,), dtype=rectified_out.dtype)
    stride = source_width * channels
    one = Floats(1.0)
    for start in range(0, width, BLOCK):
        columns = wp.min(BLOCK, width - start)
        for k in range(0, columns, LANES):
            column = floats(counting, 0) + Floats(float(start + k))
            depth = ray[6] * column + Floats(ray[7] * row) + Floats(ray[8])
            a = wp.cw_div(ray[0] * column + Floats(ray[1] * row) + Floats(ray[2]), depth)
            b = wp.cw_div(ray[3] * column + Floats(ray[4] * row) + Floats(ray[5]), depth)
            r2 = wp.cw_mul(a, a) + wp.cw_mul(b, b)
            radial = one + wp.cw_mul(r2, Floats(lens[4]) + wp.cw_mul(r2, Floats(lens[5]) + r2 * lens[8]))
            below = one + wp.cw_mul(r2, Floats(lens[9]) + wp.cw_mul(r2, Floats(lens[10]) + r2 * lens[11]))
            radial = wp.cw_div(radial, below)
            ab = wp.cw_mul(2.0 * lens[6] * a, b)
            ba = wp.cw_mul(2.0 * lens[7] * a, b)
            bent_a = wp.cw_mul(a, radial) + ab + lens[7] * (r2 + wp.cw_mul(2.0 * a, a))
            bent_b = wp.cw_mul(b, radial) + lens[6] * (r2 + wp.cw_mul(2.0 * b, b)) + ba
            bent_a = bent_a + wp.cw_mul(r2, Floats(lens[12]) + r2 * lens[13])
            bent_b = bent_b + wp.cw_mul(r2, Floats(lens[14]) + r2 * lens[15])
            put(depths, k, depth)
            put(columns_u, k, lens[0] * bent_a + Floats(lens[2]))
            put(rows_v, k, lens[1] * bent_b + Floats(lens[3]))
        for k in range(columns):
            pixel = y * width + start + k
            u = u_of[k]
            v = v_of[k]
            valid = depth_of[k] > 0.0 and u >= 0.0 and v >= 0.0
            if valid and u <= float(source_width - 1) and v <= float(source_height - 1):
                valid_out[pixel] = wp.uint8(1)
                left = int(u)
                top = int(v)
                across = u - float(left)
                down = v - float(top)
                at = top * stride + left * channels
                right = wp.where(left + 1 < source_width, channels, 0)
                under = wp.where(top + 1 < source_height, stride, 0)
                for channel in range(channels):
                    # The same order of operations as in sampling.py.
                    corner = at + channel
                    upper = float(pixels[corner]) * (1.0 - across) + float(pixels[corner + right]) * across
                    corner += under
                    lower = float(pixels[corner]) * (1.0 - across) + float(pixels[corner + right]) * across
                    value = upper * (1.0 - down) + lower * down
                    pixels_out[pixel * channels + channel] = rectified_out.dtype(value + 0.5)
            else:
                valid_out[pixel] = wp.uint8(0)
                for channel in range(channels):
                    pixels_out[pixel * channels + channel] = rectified_out.dtype(0.0)
