// Samples between pixels by Catmull and Rom's cubic (R. Keys, "Cubic Convolution Interpolation", 1981), which gives a
// pixel's own value at its centre; needs light.h.

// Shares of the pixels at -1, 0, 1 and 2 of a sample at t from 0 to 1.
inline float4 cubic_shares(float t)
{
    return (float4)(((-0.5f * t + 1.0f) * t - 0.5f) * t, (1.5f * t - 2.5f) * t * t + 1.0f,
        ((-1.5f * t + 2.0f) * t + 0.5f) * t, (0.5f * t - 0.5f) * t * t);
}

// Pixels of one column, weighed along it.
inline float4 down_column(__global const ushort *light, int4 rows, int column, float4 down)
{
    return light_at(light, rows.x + column) * down.x + light_at(light, rows.y + column) * down.y +
        light_at(light, rows.z + column) * down.z + light_at(light, rows.w + column) * down.w;
}

// Value at column u, row v (pixel centres at whole numbers), the picture's edge repeated.
inline float4 sample_cubic(__global const ushort *light, int width, int height, float u, float v)
{
    int x = floor_to_int(u), y = floor_to_int(v);
    float4 across = cubic_shares(u - (float)x), down = cubic_shares(v - (float)y);
    int4 rows = (int4)(clamp_index(y - 1, height), clamp_index(y, height), clamp_index(y + 1, height),
        clamp_index(y + 2, height)) * width;
    return down_column(light, rows, clamp_index(x - 1, width), down) * across.x +
        down_column(light, rows, clamp_index(x, width), down) * across.y +
        down_column(light, rows, clamp_index(x + 1, width), down) * across.z +
        down_column(light, rows, clamp_index(x + 2, width), down) * across.w;
}
