/* SC_SIMD_CLONES before a function compiles it once per instruction set and picks at start-up. Put
 * it on the whole kernel (loops and all), not on what the loop calls; helpers must be static
 * inline. With -ffp-contract=off all clones give the same bytes. Empty with other compilers and
 * processors, and under sanitizers, coverage and fuzzing, which cannot live with the loader's
 * resolver functions. gcc 12 leaves most loops scalar at -O2 (a projection kernel is then 8 times
 * slower): measure at -O3, preset release. */
#ifndef SC_BASE_SIMD_H
#define SC_BASE_SIMD_H

#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__linux__) &&       \
    defined(__OPTIMIZE__) && !defined(SCANCART_NO_CLONES) && !defined(__SANITIZE_ADDRESS__) &&     \
    !defined(__SANITIZE_THREAD__)
#define SC_SIMD_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define SC_SIMD_CLONES
#endif

#endif
