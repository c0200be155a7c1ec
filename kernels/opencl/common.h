// Put before every kernel file by the backend.
// No fused multiply-add: with it, two devices would round the same formula differently.
#pragma OPENCL FP_CONTRACT OFF

// The nearest index inside 0..size-1: the picture's edge repeated. (A built-in min or max would be a call.)
inline int clamp_index(int index, int size)
{
    int low = index < 0 ? 0 : index;
    return low < size ? low : size - 1;
}
