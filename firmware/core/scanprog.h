/* The scan program: go to the start with the backlash taken up, sweep continuously or step by
 * revolution. */
#ifndef SC_CORE_SCANPROG_H
#define SC_CORE_SCANPROG_H

#include "firmware/core/axis.h"
#include "firmware/shared/faultcode.h"

struct scanprog {
    enum scanstate state;
    int32_t from, to;
    uint32_t rate; /* 0.001 steps/s */
    bool stepwise;
    uint16_t steps;
    uint32_t lines;
    uint16_t overruns;
    bool overran; /* this revolution */
    bool run_up;  /* on the way to the point from which a negative sweep's start is approached */
};

void scanprog_init(struct scanprog *scan);

/* Starts; from, to, rate, stepwise and steps are set. Under the interrupt lock. */
void scanprog_start(struct scanprog *scan, struct axis *pan, uint64_t now_us);

/* Ends the program (the caller stops the axis). Under the interrupt lock or in interrupts. */
void scanprog_end(struct scanprog *scan);

/* An index pulse, after the event's pan position was taken. Index interrupt. */
void scanprog_index(struct scanprog *scan, struct axis *pan, uint64_t now_us);

/* The pan has made a step or come to rest. Step interrupt. */
void scanprog_pan(struct scanprog *scan, struct axis *pan, uint64_t now_us);

static inline bool scanprog_active(const struct scanprog *scan) {
    return scan->state == SCANSTATE_TO_START || scan->state == SCANSTATE_SWEEP;
}

#endif
