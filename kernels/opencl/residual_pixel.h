// One pixel of residual; needs light.h.

// A bilinear sample of the texture at column s, row t, taken from a pixel's light. See residual.cl.
inline void residual_pixel(
    __global const ushort *light, __global const ushort *texture, int texture_width, int texture_height, int pixel,
    float s, float t, __global ushort *residual_out)
{
    int x = floor_to_int(s), y = floor_to_int(t);
    float across = s - (float)x, down = t - (float)y;
    int left = clamp_index(x, texture_width), right = clamp_index(x + 1, texture_width);
    int top = clamp_index(y, texture_height) * texture_width;
    int bottom = clamp_index(y + 1, texture_height) * texture_width;
    float4 a = light_at(texture, top + left), b = light_at(texture, top + right);
    float4 c = light_at(texture, bottom + left), d = light_at(texture, bottom + right);
    int there = a.w > 0.0f && b.w > 0.0f && c.w > 0.0f && d.w > 0.0f;
    float4 shown = (a * (1.0f - down) + c * down) * (1.0f - across) + (b * (1.0f - down) + d * down) * across;
    float4 missing = (light_at(light, pixel) - shown) * (there ? 0.5f : 0.0f);
    put_light(residual_out, pixel, missing + 32768.0f);
}
