// The smallest and the largest of three numbers. (The built-in ones would be calls.)
inline float least(float a, float b, float c) { return a < b ? (a < c ? a : c) : (b < c ? b : c); }
inline float most(float a, float b, float c) { return a > b ? (a > c ? a : c) : (b > c ? b : c); }
