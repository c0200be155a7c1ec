// Who owns a texel: a triangle's number from 1, INSIDE added where it holds the texel's centre; 0 is nobody.
#define INSIDE (1 << 30)
