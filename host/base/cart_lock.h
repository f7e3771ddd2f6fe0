/* Which pass of the head's encoder is which event of the controller: the search for the shift by
 * whole turns, when nothing is known yet. See cart_clock.h. */
#ifndef SC_BASE_CART_LOCK_H
#define SC_BASE_CART_LOCK_H

#include "base/cart_clock.h"

#ifdef __cplusplus
extern "C" {
#endif

struct cart_lock {
    unsigned first_turn, first_event; /* positions of the first pair */
    unsigned pairs;
    double scatter_ns;
    double least_late_ns; /* the least that an event came after its pass; NaN: unknown */
    bool ambiguous;       /* the scatter does not tell it from its neighbours */
};

/* The best shift of `events` against `turns` (of one epoch, in order of time). False if there is
 * none that can be believed yet. Cost: events x turns. */
bool cart_lock_find(const struct cart_clock_params *params, const struct head_turn *turns,
                    unsigned turn_count, const struct cart_clock_event *events,
                    unsigned event_count, struct cart_lock *out_lock);

#ifdef __cplusplus
}
#endif
#endif
