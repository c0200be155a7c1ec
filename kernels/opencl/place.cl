// Where in another picture each texel of a mesh lies.
#include "owner.h"
#include "weights.h"
#include "extremes.h"
#include "place.h"

// Place that the centre of every texel shows, all columns u first, then all rows v; NaN where no triangle owns it.
// corners is (F, 3, 5): a corner's place in texels, its place (u, v) in the other picture, and its weight there: the depth
// where the texels lie on the mesh, 1 / depth where they are a camera's pixels. Beside its triangle a texel goes on as
// if all weights were equal, since a plane that is seen edge on may lie anywhere there, and at most `margin` beyond the
// places of its corners.
__kernel void place(
    // In:
    __global const float *corners,
    __global const int *owner,
    float margin,
    int texture_width,
    int texture_height,
    // Out:
    __global float *place_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= texture_width || y >= texture_height) return;
    int texel = y * texture_width + x, number = owner[texel];
    Place found = {NAN, NAN};
    if (number) found = find_place(corners, number, x, y, margin);
    place_out[texel] = found.u;
    place_out[texture_width * texture_height + texel] = found.v;
}
