/* Seeded random numbers: xoshiro256** (Blackman and Vigna 2018), state filled by splitmix64. The
 * same seed gives the same numbers everywhere; normal deviates depend on the machine's libm.
 * Parallel work takes one stream per item (not per thread), so that results do not depend on the
 * number of threads. No allocation; a generator belongs to one thread. */
#ifndef SC_BASE_RNG_H
#define SC_BASE_RNG_H

#include "base/vec.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct rng {
    uint64_t s[4];
    double spare; /* second deviate of the last pair */
    bool has_spare;
};

/* Any seed, 0 too, is good. */
struct rng rng_make(uint64_t seed);

/* Stream `index` of `seed`: independent for each (seed, index), in constant time. Stream i is not
 * rng_make(seed + i). */
struct rng rng_stream(uint64_t seed, uint64_t index);

/* Moves 2^128 numbers ahead: blocks of that length that provably do not overlap. */
void rng_jump(struct rng *rng);

/* 64 random bits. */
uint64_t rng_u64(struct rng *rng);

/* Uniform in 0..n-1 without bias (Lemire 2019); 0 for n = 0. */
uint32_t rng_below(struct rng *rng, uint32_t n);

/* Uniform in [0, 1), a multiple of 2^-53. */
double rng_uniform(struct rng *rng);

/* Uniform in [low, high). */
double rng_range(struct rng *rng, double low, double high);

/* Normal with mean 0 and standard deviation 1 (polar method, Marsaglia 1964). */
double rng_normal(struct rng *rng);

/* Uniform on the unit sphere. */
struct vec3 rng_direction(struct rng *rng);

#ifdef __cplusplus
}
#endif
#endif
