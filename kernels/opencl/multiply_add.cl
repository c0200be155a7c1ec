// How fast a GPU multiplies and adds: the roof that the benchmark holds the other kernels against.

// Eight chains v = v * factor + summand, begun at the pixel's number + 0 to 7, after so many rounds; their sum.
// Chains hide each other's latency. The two operations stay unfused, as in every kernel here.
__kernel void multiply_add(
    // In:
    int width,
    int height,
    int rounds,
    float factor,
    float summand,
    // Out:
    __global float *sum_out)
{
    int x = get_global_id(0), y = get_global_id(1);
    if (x >= width || y >= height) return;
    int item = y * width + x;
    float a = (float)item, b = a + 1.0f, c = a + 2.0f, d = a + 3.0f;
    float e = a + 4.0f, f = a + 5.0f, g = a + 6.0f, h = a + 7.0f;
    for (int i = 0; i < rounds; i++) {
        a = a * factor + summand;
        b = b * factor + summand;
        c = c * factor + summand;
        d = d * factor + summand;
        e = e * factor + summand;
        f = f * factor + summand;
        g = g * factor + summand;
        h = h * factor + summand;
    }
    sum_out[item] = ((a + b) + (c + d)) + ((e + f) + (g + h));
}
