"""Paint the triangles that a picture shows."""

import warp as wp

from stereo_gpu.kernels.warp.triangle import Triangle, least, load_triangle, shares_at

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def mix_colours(one: wp.vec3, other: wp.vec3, share: float) -> wp.vec3:
    """The share of one colour in another."""
    return one * (1.0 - share) + other * share


@wp.func
def texel(texture: wp.array(dtype=wp.uint8), at: int) -> wp.vec3:
    """Colour of a texel by its number."""
    return wp.vec3(float(texture[at * 3]), float(texture[at * 3 + 1]), float(texture[at * 3 + 2]))


@wp.func
def clamp_index(index: int, size: int) -> int:
    """The nearest index inside 0..size-1."""
    return wp.clamp(index, 0, size - 1)


@wp.func
def sample_level(texture: wp.array(dtype=wp.uint8), first: int, width: int, height: int, u: float, v: float) -> wp.vec3:
    """Bilinear colour at (u, v) in 0..1 of the level of a texture that begins at a texel; its edge repeated."""
    column = u * float(width) - 0.5
    row = v * float(height) - 0.5
    x = int(wp.floor(column))
    y = int(wp.floor(row))
    across = column - float(x)
    down = row - float(y)
    left = clamp_index(x, width)
    right = clamp_index(x + 1, width)
    top = first + clamp_index(y, height) * width
    bottom = first + clamp_index(y + 1, height) * width
    upper = mix_colours(texel(texture, top + left), texel(texture, top + right), across)
    lower = mix_colours(texel(texture, bottom + left), texel(texture, bottom + right), across)
    return mix_colours(upper, lower, down)


@wp.func
def sample_texture(
    texture: wp.array(dtype=wp.uint8), width: int, height: int, levels: int, u: float, v: float, texels: float
) -> wp.vec3:
    """Colour of the texture at (u, v), where a sample covers so many texels."""
    first = int(0)
    columns = int(width)
    rows = int(height)
    left = int(levels)
    share = float(texels)
    # A face that is seen nearly edge on covers any number of them.
    while share > 4.0 and left > 1:
        first += columns * rows
        columns = (columns + 1) / 2
        rows = (rows + 1) / 2
        share *= 0.25
        left -= 1
    colour = sample_level(texture, first, columns, rows, u, v)
    if share > 1.0 and left > 1:
        next = sample_level(texture, first + columns * rows, (columns + 1) / 2, (rows + 1) / 2, u, v)
        mixed = float(1.0)
        if share < 4.0:
            mixed = (share - 1.0) / 3.0
        colour = mix_colours(colour, next, mixed)
    return colour


@wp.func
def ink_at(t: Triangle, s: wp.vec3, wire: float) -> float:
    """How much ink lies at a sample: along the edges, thinly where the triangle is small."""
    bcx = t.c[0] - t.b[0]
    bcy = t.c[1] - t.b[1]
    cax = t.a[0] - t.c[0]
    cay = t.a[1] - t.c[1]
    abx = t.b[0] - t.a[0]
    aby = t.b[1] - t.a[1]
    area = wp.abs(t.area)
    a = area / wp.sqrt(bcx * bcx + bcy * bcy)
    b = area / wp.sqrt(cax * cax + cay * cay)
    c = area / wp.sqrt(abx * abx + aby * aby)
    edge = least(s[0] * a, s[1] * b, s[2] * c)
    line = wp.clamp(wire * 0.4 + 0.5 - edge, 0.0, 1.0)
    return line * wp.clamp(least(a, b, c) / (10.0 * wire), 0.12, 0.8)


@wp.kernel
def shade(
    # In:
    owner: wp.array(dtype=int),
    screen: wp.array(dtype=float),
    faces: wp.array(dtype=int),
    uv: wp.array(dtype=float),
    texture: wp.array(dtype=wp.uint8),
    colours: wp.array(dtype=wp.uint8),
    texture_width: int,
    texture_height: int,
    texture_levels: int,
    behind: float,
    wire: float,
    samples: int,
    width: int,
    height: int,
    # Out:
    picture_out: wp.array(dtype=wp.uint8),
):
    """Colours of a picture of which each pixel has samples x samples samples, whose triangles rasterise has found.

    screen and faces are those of rasterise. uv (N, 2) places the vertices in the texture, (0, 0) its top left corner;
    behind is added to v where a face is seen from behind. texture holds texture_levels pictures one after the other,
    RGB, each with half the side of the one before, rounded up; of a face that covers k texels a sample, the level is
    the one where that is 1 to 4, and (k - 1) / 3 of the next one is mixed in (after Williams 1983). Along the edges
    lies ink, about wire samples wide, thinly where a face is small. colours: background and ink, RGB.
    """
    y, x = wp.tid()
    background = texel(colours, 0)
    total = wp.vec3(0.0, 0.0, 0.0)
    for row in range(y * samples, (y + 1) * samples):
        for column in range(x * samples, (x + 1) * samples):
            face = owner[row * width * samples + column] - 1
            colour = background
            if face >= 0:
                t = load_triangle(screen, faces, face)
                s = shares_at(t, float(column), float(row))
                a = faces[face * 3] * 2
                b = faces[face * 3 + 1] * 2
                c = faces[face * 3 + 2] * 2
                # What is linear in space is not so in the picture: shares count by 1 / depth.
                wa = s[0] * t.a[2]
                wb = s[1] * t.b[2]
                wc = s[2] * t.c[2]
                whole = wa + wb + wc
                u = (wa * uv[a] + wb * uv[b] + wc * uv[c]) / whole
                v = (wa * uv[a + 1] + wb * uv[b + 1] + wc * uv[c + 1]) / whole
                laid = (uv[b] - uv[a]) * (uv[c + 1] - uv[a + 1]) - (uv[b + 1] - uv[a + 1]) * (uv[c] - uv[a])
                texels = wp.abs(laid * float(texture_width) * float(texture_height) / t.area)
                if t.area > 0.0:
                    v = v + behind
                colour = sample_texture(texture, texture_width, texture_height, texture_levels, u, v, texels)
                if wire > 0.0:
                    colour = mix_colours(colour, texel(colours, 1), ink_at(t, s, wire))
            total = total + colour
    share = 1.0 / float(samples * samples)
    at = (y * width + x) * 3
    picture_out[at] = wp.uint8(total[0] * share + 0.5)
    picture_out[at + 1] = wp.uint8(total[1] * share + 0.5)
    picture_out[at + 2] = wp.uint8(total[2] * share + 0.5)
