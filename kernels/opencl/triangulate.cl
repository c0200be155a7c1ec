// Disparity to points in space.

// Point (x, y, z) of every pixel in the baseline's unit, frame of the rectified left camera.
// NaN where there is no disparity, or none that lies in front of the cameras. direction is 1 where the map
// is laid out on the right view and -1 for the left one.
__kernel void triangulate(
    // In:
    __global const float *disparity,
    int width,
    int height,
    int direction,
    float focal_px,
    float baseline,
    float cx_left,
    float cx_right,
    float cy,
    // Out:
    __global float *points_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int pixel = y * width + x;
    float value = disparity[pixel];
    float parallax = value - (cx_left - cx_right);
    int seen = parallax > 0.0f;
    float x_left = direction > 0 ? (float)x + value : (float)x;
    float scale = baseline / parallax;
    points_out[pixel * 3] = seen ? (x_left - cx_left) * scale : NAN;
    points_out[pixel * 3 + 1] = seen ? ((float)y - cy) * scale : NAN;
    points_out[pixel * 3 + 2] = seen ? focal_px * scale : NAN;
}
