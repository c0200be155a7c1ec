// Who owns a texel: a triangle's number from 1, INSIDE added where it holds the texel's centre, CLOSE where it is nearer
// than half of what is near at all; 0 is nobody. So the largest number wins.
#define INSIDE (1 << 30)
#define CLOSE (1 << 29)

inline int face_of(int owner) { return (owner & (CLOSE - 1)) - 1; }
