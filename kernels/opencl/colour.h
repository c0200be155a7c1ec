// A pixel's light as one vector, for the forms that are made for CPUs.
typedef float colour __attribute__((ext_vector_type(4)));
typedef ushort packed_colour __attribute__((ext_vector_type(4), aligned(8)));
