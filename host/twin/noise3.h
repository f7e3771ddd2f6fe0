/* Procedural noise in three dimensions: what textures and small shapes are made of. The same
 * lattice hash everywhere, so a seed gives the same surface on every machine. Floats, no
 * allocation, any thread. */
#ifndef SC_TWIN_NOISE3_H
#define SC_TWIN_NOISE3_H

#include <stdint.h>

struct noise3_point {
    float x, y, z;
};

/* 32 random bits for a lattice cell. */
uint32_t noise3_hash(int32_t x, int32_t y, int32_t z, uint32_t seed);
/* Uniform in [0, 1) for a lattice cell. */
float noise3_cell(int32_t x, int32_t y, int32_t z, uint32_t seed);

/* Gradient noise (Perlin 2002, quintic fade), about -1..1, mean 0, features of size 1. */
float noise3_gradient(float x, float y, float z, uint32_t seed);

/* Sum of `octaves` gradient noises, each of half the amplitude and twice the frequency; about
 * -1..1. */
float noise3_fbm(float x, float y, float z, int octaves, uint32_t seed);

/* Like noise3_fbm() of the absolute value: creases; 0..1. */
float noise3_ridged(float x, float y, float z, int octaves, uint32_t seed);

/* Cellular noise (Worley 1996) with one point a unit cell. */
struct noise3_cells {
    float f1, f2; /* distance to the nearest and second nearest point */
    uint32_t id;  /* hash of the nearest point's cell */
};
struct noise3_cells noise3_worley(float x, float y, float z, uint32_t seed);

/* Smooth step from 0 at a to 1 at b (a may be above b). */
static inline float noise3_smooth(float a, float b, float x) {
    float t = (x - a) / (b - a);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}
static inline float noise3_mix(float a, float b, float t) {
    return a + (b - a) * t;
}

#endif
