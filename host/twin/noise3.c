#include "twin/noise3.h"

#include <math.h>

/* The hash in three stages, so that corners of a cell share the first two. Each coordinate passes
 * through its own odd multiplier; the end is the finaliser of MurmurHash3 (Appleby). */
static inline uint32_t hash_x(int32_t x, uint32_t seed) {
    uint32_t h = seed * 0x9e3779b1u ^ (uint32_t)x * 0x85ebca6bu;
    return (h << 13 | h >> 19) * 5u + 0xe6546b64u;
}
static inline uint32_t hash_y(uint32_t h, int32_t y) {
    h ^= (uint32_t)y * 0xc2b2ae35u;
    return (h << 13 | h >> 19) * 5u + 0xe6546b64u;
}
static inline uint32_t hash_z(uint32_t h, int32_t z) {
    h ^= (uint32_t)z * 0x27d4eb2fu;
    h ^= h >> 16;
    h *= 0x85ebca6bu;
    h ^= h >> 13;
    h *= 0xc2b2ae35u;
    return h ^ h >> 16;
}

uint32_t noise3_hash(int32_t x, int32_t y, int32_t z, uint32_t seed) {
    return hash_z(hash_y(hash_x(x, seed), y), z);
}

float noise3_cell(int32_t x, int32_t y, int32_t z, uint32_t seed) {
    return (float)(noise3_hash(x, y, z, seed) >> 8) * 0x1p-24f;
}

static float fade(float t) {
    return t * t * t * (t * (t * 6 - 15) + 10);
}

/* Dot product of one of 12 edge directions with (x, y, z). */
static float gradient(uint32_t h, float x, float y, float z) {
    float u = (h & 15) < 8 ? x : y;
    float v = (h & 15) < 4 ? y : ((h & 13) == 12 ? x : z);
    return ((h & 1) ? -u : u) + ((h & 2) ? -v : v);
}

float noise3_gradient(float x, float y, float z, uint32_t seed) {
    float fx = floorf(x), fy = floorf(y), fz = floorf(z);
    int32_t ix = (int32_t)fx, iy = (int32_t)fy, iz = (int32_t)fz;
    float dx = x - fx, dy = y - fy, dz = z - fz;
    float u = fade(dx), v = fade(dy), w = fade(dz);
    float corner[8];
    for (int cx = 0; cx < 2; cx++) {
        uint32_t hx = hash_x(ix + cx, seed);
        for (int cy = 0; cy < 2; cy++) {
            uint32_t hxy = hash_y(hx, iy + cy);
            for (int cz = 0; cz < 2; cz++)
                corner[cx + 2 * cy + 4 * cz] =
                    gradient(hash_z(hxy, iz + cz), dx - (float)cx, dy - (float)cy, dz - (float)cz);
        }
    }
    float a =
        noise3_mix(noise3_mix(corner[0], corner[1], u), noise3_mix(corner[2], corner[3], u), v);
    float b =
        noise3_mix(noise3_mix(corner[4], corner[5], u), noise3_mix(corner[6], corner[7], u), v);
    return noise3_mix(a, b, w);
}

float noise3_fbm(float x, float y, float z, int octaves, uint32_t seed) {
    float sum = 0, amplitude = 0.5f;
    for (int i = 0; i < octaves; i++) {
        sum += amplitude * noise3_gradient(x, y, z, seed + (uint32_t)i);
        amplitude *= 0.5f;
        /* not exactly 2, so that the lattices do not line up */
        x = x * 2.03f + 11.3f;
        y = y * 2.03f - 7.7f;
        z = z * 2.03f + 3.1f;
    }
    return sum * 1.6f;
}

float noise3_ridged(float x, float y, float z, int octaves, uint32_t seed) {
    float sum = 0, amplitude = 0.5f;
    for (int i = 0; i < octaves; i++) {
        sum += amplitude * (1 - fabsf(noise3_gradient(x, y, z, seed + (uint32_t)i)));
        amplitude *= 0.5f;
        x = x * 2.03f + 5.1f;
        y = y * 2.03f + 9.2f;
        z = z * 2.03f - 4.4f;
    }
    return sum;
}

struct noise3_cells noise3_worley(float x, float y, float z, uint32_t seed) {
    int32_t ix = (int32_t)floorf(x), iy = (int32_t)floorf(y), iz = (int32_t)floorf(z);
    struct noise3_cells best = {1e9f, 1e9f, 0};
    for (int32_t dx = -1; dx <= 1; dx++) {
        uint32_t hx = hash_x(ix + dx, seed);
        for (int32_t dy = -1; dy <= 1; dy++) {
            uint32_t hxy = hash_y(hx, iy + dy);
            for (int32_t dz = -1; dz <= 1; dz++) {
                uint32_t h = hash_z(hxy, iz + dz);
                float px = (float)(ix + dx) + (float)(h & 1023) / 1023.0f - x;
                float py = (float)(iy + dy) + (float)(h >> 10 & 1023) / 1023.0f - y;
                float pz = (float)(iz + dz) + (float)(h >> 20 & 1023) / 1023.0f - z;
                float d2 = px * px + py * py + pz * pz;
                if (d2 < best.f1) {
                    best.f2 = best.f1;
                    best.f1 = d2;
                    best.id = h;
                } else if (d2 < best.f2) {
                    best.f2 = d2;
                }
            }
        }
    }
    best.f1 = sqrtf(best.f1);
    best.f2 = sqrtf(best.f2);
    return best;
}
