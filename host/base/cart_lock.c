#include "base/cart_lock.h"

#include <math.h>
#include <stdlib.h>

static const double near_turn = 1.0 / 6; /* a pair lies within so much of a turn */
static const double enough = 0.6;        /* so many of the passes that overlap must have an event */
static const double decisive = 4;        /* the runner-up scatters more by this */
static const double even_ns = 2000;      /* scatter that any right shift may have */
static const double early_ns = 5e6;      /* an arrival may seem early by the latency of packets */

enum { MOST = 64, LISTED = 32, STARTS = 3, BESIDE = 2, WEAK = 4, PATIENCE = 16 };

struct found {
    unsigned count, overlap;
    unsigned turn[MOST], event[MOST];
    double at[MOST], off[MOST]; /* ns, relative to the first pair */
    unsigned first;             /* of those that lie on the line */
    double least_late_ns;
};

static double middle_of(double *values, unsigned count) {
    for (unsigned i = 1; i < count; i++) { /* by insertion: few, and nothing is allocated */
        double v = values[i];
        unsigned k = i;
        for (; k > 0 && values[k - 1] > v; k--)
            values[k] = values[k - 1];
        values[k] = v;
    }
    return count % 2 ? values[count / 2] : 0.5 * (values[count / 2 - 1] + values[count / 2]);
}

/* Pairs each pass with the nearest event if event j belongs to pass i. The difference of the clocks
 * is handed on from pair to pair, so that a drift does not add up. */
static void pair_up(const struct head_turn *turns, unsigned turn_count,
                    const struct cart_clock_event *events, unsigned event_count, int64_t shift_ns,
                    struct found *f) {
    unsigned e = 0;
    double off = 0, turn_ns = 1e9 / turns[0].rate_hz;
    int64_t last_ns = events[event_count - 1].index.t_controller_ns;
    f->count = f->overlap = 0;
    f->least_late_ns = INFINITY;
    for (unsigned i = 0; i < turn_count; i++) {
        int64_t want = turns[i].t_head_ns + shift_ns + (int64_t)off;
        turn_ns = turns[i].rate_hz > 0 ? 1e9 / turns[i].rate_hz : turn_ns;
        double near = near_turn * turn_ns;
        if ((double)(want - last_ns) > near)
            break;
        f->overlap += (double)(events[0].index.t_controller_ns - want) <= near;
        while (e + 1 < event_count && llabs(events[e + 1].index.t_controller_ns - want) <=
                                          llabs(events[e].index.t_controller_ns - want))
            e++;
        double miss = (double)(events[e].index.t_controller_ns - want);
        if (fabs(miss) > near)
            continue;
        off += miss;
        f->turn[f->count] = i;
        f->event[f->count] = e;
        f->at[f->count] = (double)(turns[i].t_head_ns - turns[f->turn[0]].t_head_ns);
        f->off[f->count++] = off;
        if (events[e].t_host_ns != CART_CLOCK_NO_ARRIVAL)
            f->least_late_ns =
                fmin(f->least_late_ns, (double)(events[e].t_host_ns - turns[i].t_host_ns));
    }
}

/* Robust scatter about a line: the median slope of pairs half the way apart (after Theil and Sen),
 * then the median of what is left. */
static double scatter_of(struct found *f, double *out_rate) {
    double v[MOST];
    unsigned half = f->count / 2, n = 0;
    for (unsigned i = 0; i + half < f->count; i++)
        v[n++] = (f->off[i + half] - f->off[i]) / (f->at[i + half] - f->at[i]);
    double rate = middle_of(v, n);
    for (unsigned i = 0; i < f->count; i++)
        v[i] = f->off[i] - rate * f->at[i];
    double middle = middle_of(v, f->count);
    for (unsigned i = 0; i < f->count; i++)
        v[i] = fabs(f->off[i] - rate * f->at[i] - middle);
    *out_rate = rate;
    double scatter = 1.4826 * middle_of(v, f->count);
    f->first = 0; /* a spurious event may have been taken for the first */
    while (f->first + 1 < f->count &&
           fabs(f->off[f->first] - rate * f->at[f->first] - middle) > 4 * scatter + even_ns)
        f->first++;
    return scatter;
}

/* Is this shift possible at all? */
static bool judge(const struct cart_clock_params *params, struct found *f, double turn_ns,
                  double *out_scatter) {
    double rate;
    if (f->count < WEAK || (double)f->count < enough * (double)f->overlap)
        return false;
    *out_scatter = scatter_of(f, &rate);
    /* wrong shifts are also off in rate while the mirror spins up */
    double slack = 4 * *out_scatter / (f->at[f->count - 1] + 1);
    if (fabs(rate) > 5e-6 * params->max_drift_ppm + slack)
        return false;
    return !(f->least_late_ns < -fmax(early_ns, turn_ns / 4)); /* known before it happened */
}

/* Do two describe the same shift? Both count from their first good pair. */
static bool same_shift(const struct cart_lock *a, const struct cart_lock *b,
                       const struct head_turn *turns, const struct cart_clock_event *events) {
    double ours =
        (double)(events[a->first_event].index.t_controller_ns - turns[a->first_turn].t_head_ns);
    double theirs =
        (double)(events[b->first_event].index.t_controller_ns - turns[b->first_turn].t_head_ns);
    return fabs(ours - theirs) < near_turn * 1e9 / turns[a->first_turn].rate_hz;
}

struct search {
    struct cart_lock list[LISTED];
    unsigned count, best;
};

/* Keeps a shift, the better one of two that are the same. */
static void keep(struct search *s, const struct cart_lock *is, const struct head_turn *turns,
                 const struct cart_clock_event *events) {
    unsigned k = 0;
    while (k < s->count && !same_shift(&s->list[k], is, turns, events))
        k++;
    if (k == LISTED)
        return;
    if (k == s->count)
        s->list[s->count++] = *is;
    else if (is->scatter_ns < s->list[k].scatter_ns)
        s->list[k] = *is;
    if (s->list[k].scatter_ns < s->list[s->best].scatter_ns)
        s->best = k;
}

/* The one with the least scatter; among those that scatter alike, the one whose events came
 * soonest. If that has few pairs so far, more must come. */
static bool choose(const struct search *s, const struct cart_clock_params *params, bool must,
                   struct cart_lock *out_lock) {
    const struct cart_lock *is = &s->list[s->best], *soon = NULL;
    double alike_ns = decisive * is->scatter_ns;
    unsigned alike = 0;
    for (unsigned i = 0; i < s->count; i++) {
        const struct cart_lock *other = &s->list[i];
        if (other->scatter_ns > alike_ns)
            continue;
        alike++;
        if (!isnan(other->least_late_ns) && (!soon || other->least_late_ns < soon->least_late_ns))
            soon = other;
    }
    /* Pairs tell more the longer they last, and arrivals the more there are. */
    if (alike > 1 && !must && (!soon || is->pairs < PATIENCE))
        return false;
    is = alike > 1 && soon ? soon : is;
    if (is->pairs < params->lock_turns)
        return false;
    *out_lock = *is;
    out_lock->ambiguous = alike > 1;
    return true;
}

bool cart_lock_find(const struct cart_clock_params *params, const struct head_turn *turns,
                    unsigned turn_count, const struct cart_clock_event *events,
                    unsigned event_count, struct cart_lock *out_lock) {
    /* Shifts by BESIDE turns must have enough pairs, too, to be seen to be possible. */
    struct search search = {.count = 0, .best = 0};
    struct found f = {.count = 0};
    unsigned least = params->lock_turns + BESIDE;
    if (turn_count < least || event_count < least || !(turns[0].rate_hz > 0))
        return false;
    double turn_ns = 1e9 / turns[turn_count / 2].rate_hz;
    for (unsigned t = 0; t < turn_count; t++)
        for (unsigned e = 0; e < event_count; e++) {
            if (t >= STARTS && e >= STARTS) /* some of the first may be missing */
                break;
            double scatter;
            pair_up(turns, turn_count, events, event_count,
                    events[e].index.t_controller_ns - turns[t].t_head_ns, &f);
            if (!judge(params, &f, turn_ns, &scatter))
                continue;
            struct cart_lock is = {f.turn[f.first],
                                   f.event[f.first],
                                   f.count,
                                   scatter + even_ns,
                                   isinf(f.least_late_ns) ? (double)NAN : f.least_late_ns,
                                   false};
            keep(&search, &is, turns, events);
        }
    return search.count && choose(&search, params, turn_count >= MOST / 2, out_lock);
}
