#include "base/rng.h"

#include <math.h>

static uint64_t splitmix64(uint64_t *state) {
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

struct rng rng_make(uint64_t seed) {
    struct rng rng = {.has_spare = false};
    for (int i = 0; i < 4; i++) /* four successive outputs are never all 0 */
        rng.s[i] = splitmix64(&seed);
    return rng;
}

struct rng rng_stream(uint64_t seed, uint64_t index) {
    /* Both words pass through the full mixing function, so neighbouring indices share nothing. */
    uint64_t a = seed;
    uint64_t b = splitmix64(&a) ^ index;
    return rng_make(splitmix64(&b));
}

static uint64_t rotate_left(uint64_t x, int k) {
    return (x << k) | (x >> (64 - k));
}

uint64_t rng_u64(struct rng *rng) {
    uint64_t *s = rng->s;
    uint64_t result = rotate_left(s[1] * 5, 7) * 9;
    uint64_t t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotate_left(s[3], 45);
    return result;
}

void rng_jump(struct rng *rng) {
    /* The generator's transition to the power 2^128 as a polynomial, from the authors' paper. */
    static const uint64_t power[4] = {0x180ec6d33cfd0abau, 0xd5a61266f0c9392cu, 0xa9582618e03fc9aau,
                                      0x39abdc4529b1661cu};
    uint64_t s[4] = {0, 0, 0, 0};
    for (int word = 0; word < 4; word++) {
        for (int bit = 0; bit < 64; bit++) {
            if (power[word] >> bit & 1u)
                for (int i = 0; i < 4; i++)
                    s[i] ^= rng->s[i];
            (void)rng_u64(rng);
        }
    }
    for (int i = 0; i < 4; i++)
        rng->s[i] = s[i];
    rng->has_spare = false;
}

uint32_t rng_below(struct rng *rng, uint32_t n) {
    if (n == 0)
        return 0;
    uint32_t reject = (0u - n) % n; /* 2^32 mod n */
    for (;;) {
        uint64_t m = (rng_u64(rng) >> 32) * n;
        if ((uint32_t)m >= reject)
            return (uint32_t)(m >> 32);
    }
}

double rng_uniform(struct rng *rng) {
    return (double)(rng_u64(rng) >> 11) * 0x1p-53;
}

double rng_range(struct rng *rng, double low, double high) {
    return low + (high - low) * rng_uniform(rng);
}

double rng_normal(struct rng *rng) {
    if (rng->has_spare) {
        rng->has_spare = false;
        return rng->spare;
    }
    double u, v, s;
    do {
        u = 2.0 * rng_uniform(rng) - 1.0;
        v = 2.0 * rng_uniform(rng) - 1.0;
        s = u * u + v * v;
    } while (s >= 1.0 || s == 0.0);
    double k = sqrt(-2.0 * log(s) / s);
    rng->spare = k * v;
    rng->has_spare = true;
    return k * u;
}

struct vec3 rng_direction(struct rng *rng) {
    /* Archimedes: z is uniform. */
    double z = rng_range(rng, -1.0, 1.0);
    double a = rng_range(rng, -3.14159265358979323846, 3.14159265358979323846);
    double r = sqrt(fmax(0.0, 1.0 - z * z));
    return vec3_make(r * cos(a), r * sin(a), z);
}
