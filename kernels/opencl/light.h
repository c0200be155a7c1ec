// Pictures of linear light: red, green, blue and a fourth number, 16 bits each.
inline ushort4 texel_at(__global const ushort *light, int index) { return *((__global const ushort4 *)light + index); }

inline void put_texel(__global ushort *light, int index, ushort4 texel) { *((__global ushort4 *)light + index) = texel; }

// As numbers to compute with. (A built-in conversion would be a call.)
inline float4 light_at(__global const ushort *light, int index)
{
    ushort4 texel = texel_at(light, index);
    return (float4)((float)texel.x, (float)texel.y, (float)texel.z, (float)texel.w);
}

inline ushort rounded(float v)
{
    float low = v > 0.0f ? v : 0.0f;
    return (ushort)((low < 65535.0f ? low : 65535.0f) + 0.5f);
}

inline void put_light(__global ushort *light, int index, float4 v)
{
    put_texel(light, index, (ushort4)(rounded(v.x), rounded(v.y), rounded(v.z), rounded(v.w)));
}
