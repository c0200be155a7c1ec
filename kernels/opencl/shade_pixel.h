// One pixel of shade; needs triangle.h. TEXEL may be defined as another way to load a texel.

// Red, green, blue, and what is of no account.
typedef float4 Colour;

inline Colour mix_colours(Colour one, Colour other, float share) { return one * (1.0f - share) + other * share; }

inline Colour colour_at(__global const uchar *colours, int at)
{
    __global const uchar *rgb = colours + at * 3;
    return (Colour)((float)rgb[0], (float)rgb[1], (float)rgb[2], 0.0f);
}

#ifndef TEXEL
#define TEXEL colour_at
#endif

// Bilinear colour at (u, v) in 0..1 of one level of a texture, its edge repeated.
inline Colour sample_level(__global const uchar *level, int width, int height, float u, float v)
{
    float column = u * (float)width - 0.5f, row = v * (float)height - 0.5f;
    int x = floor_to_int(column), y = floor_to_int(row);
    float across = column - (float)x, down = row - (float)y;
    int left = clamp_index(x, width), right = clamp_index(x + 1, width);
    int top = clamp_index(y, height) * width, bottom = clamp_index(y + 1, height) * width;
    Colour upper = mix_colours(TEXEL(level, top + left), TEXEL(level, top + right), across);
    Colour lower = mix_colours(TEXEL(level, bottom + left), TEXEL(level, bottom + right), across);
    return mix_colours(upper, lower, down);
}

// Colour of the texture at (u, v), where a sample covers so many texels.
inline Colour sample_texture(
    __global const uchar *texture, int width, int height, int levels, float u, float v, float texels)
{
    // A face that is seen nearly edge on covers any number of them.
    while (texels > 4.0f && levels > 1) {
        texture += width * height * 3;
        width = (width + 1) / 2;
        height = (height + 1) / 2;
        texels *= 0.25f;
        levels--;
    }
    Colour colour = sample_level(texture, width, height, u, v);
    if (!(texels > 1.0f) || levels == 1) return colour;
    Colour next = sample_level(texture + width * height * 3, (width + 1) / 2, (height + 1) / 2, u, v);
    return mix_colours(colour, next, texels < 4.0f ? (texels - 1.0f) / 3.0f : 1.0f);
}

inline float within(float v, float low, float high) { return v < low ? low : v > high ? high : v; }

// How much ink lies at a sample: along the edges, thinly where the triangle is small, or it would vanish under them.
inline float ink_at(Triangle t, Shares s, float wire)
{
    float bcx = t.cx - t.bx, bcy = t.cy - t.by, cax = t.ax - t.cx, cay = t.ay - t.cy;
    float abx = t.bx - t.ax, aby = t.by - t.ay;
    float area = t.area < 0.0f ? -t.area : t.area;
    float a = area / sqrt(bcx * bcx + bcy * bcy), b = area / sqrt(cax * cax + cay * cay);
    float c = area / sqrt(abx * abx + aby * aby);
    float edge = least(s.a * a, s.b * b, s.c * c);
    float line = within(wire * 0.4f + 0.5f - edge, 0.0f, 1.0f);
    return line * within(least(a, b, c) / (10.0f * wire), 0.12f, 0.8f);
}

// A face with what the samples in it share.
typedef struct {
    Triangle t;
    float au, av, bu, bv, cu, cv;
    float texels; // that a sample covers
} Face;

inline Face load_face(
    __global const float *screen, __global const int *faces, __global const float *uv, int texture_width,
    int texture_height, int face)
{
    Face f;
    f.t = load_triangle(screen, faces, face);
    __global const float *a = uv + (long)faces[face * 3L] * 2, *b = uv + (long)faces[face * 3L + 1] * 2;
    __global const float *c = uv + (long)faces[face * 3L + 2] * 2;
    float laid = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    float texels = laid * (float)texture_width * (float)texture_height / f.t.area;
    f.texels = texels < 0.0f ? -texels : texels;
    f.au = a[0];
    f.av = a[1];
    f.bu = b[0];
    f.bv = b[1];
    f.cu = c[0];
    f.cv = c[1];
    return f;
}

// What shade.cl computes for the pixel (x, y).
inline void shade_pixel(
    __global const int *owner, __global const float *screen, __global const int *faces, __global const float *uv,
    __global const uchar *texture, __global const uchar *colours, int texture_width, int texture_height,
    int texture_levels, float behind, float wire, int samples, int width, int x, int y, __global uchar *picture_out)
{
    Colour background = colour_at(colours, 0), ink = colour_at(colours, 1), sum = (Colour)(0.0f);
    Face f;
    int held = -1; // the face that is loaded: mostly a pixel has but one
    for (int row = y * samples; row < (y + 1) * samples; row++) {
        for (int column = x * samples; column < (x + 1) * samples; column++) {
            int face = owner[row * width * samples + column] - 1;
            Colour colour = background;
            if (face >= 0) {
                if (face != held)
                    f = load_face(screen, faces, uv, texture_width, texture_height, face);
                held = face;
                Shares s = shares_at(f.t, (float)column, (float)row);
                // What is linear in space is not so in the picture: shares count by 1 / depth.
                float wa = s.a * f.t.az, wb = s.b * f.t.bz, wc = s.c * f.t.cz, whole = wa + wb + wc;
                float u = (wa * f.au + wb * f.bu + wc * f.cu) / whole;
                float v = (wa * f.av + wb * f.bv + wc * f.cv) / whole;
                v += f.t.area > 0.0f ? behind : 0.0f;
                colour = sample_texture(texture, texture_width, texture_height, texture_levels, u, v, f.texels);
                if (wire > 0.0f) colour = mix_colours(colour, ink, ink_at(f.t, s, wire));
            }
            sum += colour;
        }
    }
    float share = 1.0f / (float)(samples * samples);
    __global uchar *rgb = picture_out + ((long)y * width + x) * 3;
    rgb[0] = (uchar)(sum.x * share + 0.5f);
    rgb[1] = (uchar)(sum.y * share + 0.5f);
    rgb[2] = (uchar)(sum.z * share + 0.5f);
}
