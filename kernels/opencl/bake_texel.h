// One texel of bake; needs cubic.h.

// Add to a texel what its place in a picture of light shows. See bake.cl.
inline void bake_texel(
    __global const ushort *light, int width, int height, float u, float v, float share, float bias, float gain,
    int texel, __global ushort *texture_out)
{
    float4 value = sample_cubic(light, width, height, (u + 0.5f) * share - 0.5f, (v + 0.5f) * share - 0.5f);
    float4 sum = light_at(texture_out, texel) + (value - bias) * gain;
    sum.w = 65535.0f;
    put_light(texture_out, texel, sum);
}
