// Put before every kernel file by the backend.
// No fused multiply-add: with it, two devices would round the same formula differently.
#pragma OPENCL FP_CONTRACT OFF

// A function that is inline and no more is defined nowhere for a compiler that calls it after all.
#undef inline // PoCL has its own
#define inline static inline

// The largest whole number that is not above v. (The built-in floor would be a call for every sample.)
inline int floor_to_int(float v)
{
    int whole = (int)v;
    return whole - (v < (float)whole);
}

// The nearest index inside 0..size-1: the picture's edge repeated. (A built-in min or max would be a call.)
inline int clamp_index(int index, int size)
{
    int low = index < 0 ? 0 : index;
    return low < size ? low : size - 1;
}
