#include "firmware/core/scanprog.h"

void scanprog_init(struct scanprog *scan) {
    *scan = (struct scanprog){.state = SCANSTATE_OFF};
}

/* The way to the start ends in the sweep's own direction, so that the sweep begins with the
 * backlash taken up. */
void scanprog_start(struct scanprog *scan, struct axis *pan, uint64_t now_us) {
    scan->state = SCANSTATE_TO_START;
    scan->lines = 0;
    scan->overruns = 0;
    scan->overran = false;
    scan->run_up = false;
    uint16_t backlash = pan->limits.backlash_steps;
    if (scan->to >= scan->from || !backlash) {
        axis_move(pan, scan->from, 0, now_us);
    } else {
        int64_t above = (int64_t)scan->from + backlash;
        if (above > pan->limits.max_steps)
            above = pan->limits.max_steps;
        scan->run_up = true;
        axis_move_direct(pan, (int32_t)above, 0, now_us);
    }
    scanprog_pan(scan, pan, now_us); /* it may be there already */
}

void scanprog_end(struct scanprog *scan) {
    scan->state = SCANSTATE_OFF;
}

static void begin_sweep(struct scanprog *scan, struct axis *pan, uint64_t now_us) {
    scan->state = SCANSTATE_SWEEP;
    if (scan->from == scan->to)
        scan->state = SCANSTATE_DONE;
    else if (!scan->stepwise)
        axis_move_direct(pan, scan->to, scan->rate, now_us);
}

void scanprog_pan(struct scanprog *scan, struct axis *pan, uint64_t now_us) {
    if (!scanprog_active(scan) || pan->active)
        return;
    if (scan->state == SCANSTATE_SWEEP) {
        if (pan->position == scan->to)
            scan->state = SCANSTATE_DONE;
    } else if (scan->run_up) {
        scan->run_up = false;
        axis_move_direct(pan, scan->from, 0, now_us);
        if (!pan->active) /* no room for a run-up */
            begin_sweep(scan, pan, now_us);
    } else {
        begin_sweep(scan, pan, now_us);
    }
}

void scanprog_index(struct scanprog *scan, struct axis *pan, uint64_t now_us) {
    scan->overran = false;
    if (scan->state != SCANSTATE_SWEEP)
        return;
    scan->lines++;
    if (!scan->stepwise)
        return;
    if (pan->active) {
        scan->overran = true;
        if (scan->overruns < UINT16_MAX)
            scan->overruns++;
        return;
    }
    int64_t next = pan->position;
    if (scan->to > scan->from)
        next = next + scan->steps > scan->to ? scan->to : next + scan->steps;
    else
        next = next - scan->steps < scan->to ? scan->to : next - scan->steps;
    axis_move_direct(pan, (int32_t)next, 0, now_us);
}
