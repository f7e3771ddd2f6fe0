/* The mirror encoder's 16-bit counter, unwrapped, with the fraction of a count. */
#ifndef SC_CORE_ENCUNWRAP_H
#define SC_CORE_ENCUNWRAP_H

#include <stdint.h>

struct encunwrap {
    uint32_t counts; /* since reset, wraps at 2^32; may step back by jitter around an edge */
    uint16_t last;
};

void encunwrap_init(struct encunwrap *enc, uint16_t count);

/* A new reading; must come at least every 32767 counts. Returns the unwrapped counts. */
uint32_t encunwrap_update(struct encunwrap *enc, uint16_t count);

/* Interpolated fraction of a count, 1/65536: time since the last edge over the time a count takes
 * (`period_us` / `counts_per_rev`). 0 if the period is unknown (0), at most 65535. One division. */
uint16_t encunwrap_fraction(uint32_t since_edge_us, uint32_t period_us, uint16_t counts_per_rev);

#endif
