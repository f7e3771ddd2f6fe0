/* Is an index pulse real? The encoder counts a whole revolution between two index pulses: a pulse
 * at another place is noise, more than one revolution means that pulses were missed. */
#ifndef SC_CORE_IDXFILTER_H
#define SC_CORE_IDXFILTER_H

#include <stdbool.h>
#include <stdint.h>

/* A pulse may lie 1/IDXFILTER_PART of a revolution, and two counts, beside its place. */
#define IDXFILTER_PART 64u

struct idxfilter {
    uint32_t counts;    /* unwrapped encoder counts at the last real pulse */
    uint32_t candidate; /* and at the last rejected one since */
    bool seen, has_candidate;
};

void idxfilter_init(struct idxfilter *filter);

/* A pulse at `counts`; `counts_per_rev` 0: no encoder, all pulses are taken. Returns the
 * revolutions since the last real pulse: 1 normally and for the first one, more if pulses were
 * missed, 0 if this one is to be ignored. Two pulses in a row that are wrong by the last real one,
 * but whole revolutions apart, are right: then the encoder had slipped. Two divisions. */
uint16_t idxfilter_turns(struct idxfilter *filter, uint32_t counts, uint16_t counts_per_rev);

#endif
