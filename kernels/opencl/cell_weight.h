// How much a pixel's disparity weighs among others.
#define LEAST_VARIANCE 0.01f // px^2: added to the variance that the pictures' noise alone would give
