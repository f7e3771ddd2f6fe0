#include "firmware/core/idxfilter.h"

void idxfilter_init(struct idxfilter *filter) {
    *filter = (struct idxfilter){.seen = false};
}

/* Whole revolutions from `from` to `to`, rounded; 0 if it is not near a whole number, none, or
 * backwards. */
static uint32_t whole_turns(uint32_t from, uint32_t to, uint16_t counts_per_rev) {
    uint32_t counts = to - from, slack = counts_per_rev / IDXFILTER_PART + 2;
    if (counts > INT32_MAX)
        return 0;
    uint32_t turns = (counts + slack) / counts_per_rev;
    return counts + slack - turns * counts_per_rev <= 2 * slack ? turns : 0;
}

static uint16_t take(struct idxfilter *filter, uint32_t counts, uint32_t turns) {
    filter->counts = counts;
    filter->seen = true;
    filter->has_candidate = false;
    return turns > INT16_MAX ? INT16_MAX : (uint16_t)turns;
}

uint16_t idxfilter_turns(struct idxfilter *filter, uint32_t counts, uint16_t counts_per_rev) {
    if (!filter->seen || !counts_per_rev)
        return take(filter, counts, 1);
    uint32_t turns = whole_turns(filter->counts, counts, counts_per_rev);
    if (turns)
        return take(filter, counts, turns);
    if (filter->has_candidate && whole_turns(filter->candidate, counts, counts_per_rev)) {
        uint32_t since = (counts - filter->counts + counts_per_rev / 2u) / counts_per_rev;
        return take(filter, counts, since && since < INT16_MAX ? since : 1);
    }
    filter->candidate = counts;
    filter->has_candidate = true;
    return 0;
}
