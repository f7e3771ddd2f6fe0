/* What is known of one index pulse: what the controller logged, and when the other two clocks saw
 * it. Filled by hand from the log alone, by cart_clock on line or by clock_solve off line. */
#ifndef SC_BASE_SWEEP_INDEX_H
#define SC_BASE_SWEEP_INDEX_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct sweep_index {
    int64_t t_host_ns;   /* when the host learned of it, within half a revolution */
    uint32_t revolution; /* unbroken count, missed pulses included */
    double pan_steps;    /* with the part of a step */
    double tilt_steps;
    int8_t pan_direction; /* +1, -1: side to which the play is taken up; 0: not known */
    bool sweep;           /* belongs to the sweep (not to the way to its start) */
    bool pan_moving, tilt_moving;

    /* By the fit of the clocks; head_epoch 0: not fitted, and none of these means anything. */
    uint32_t head_epoch; /* of the head's time (head_turns.h) */
    uint32_t log;        /* events of different logs (a restart of the controller) do not meet */
    int64_t t_head_ns;   /* head time of the pulse */
    int64_t t_controller_ns;  /* the controller's own */
    double t_sigma_ns;        /* of one against the other */
    double slip_counts;       /* the encoder had slipped by so much at this pulse */
    double slip_after_counts; /* and from slip_t_head_ns on by this, until the next pulse */
    int64_t slip_t_head_ns;
};

#ifdef __cplusplus
}
#endif
#endif
