/* A sweep put together: which pan and tilt belong to each sample of the head. The mirror is the
 * clock: the head counts its encoder's turns, the controller logs pan and tilt steps at the index
 * pulse of each revolution, so the part of a turn that the encoder shows is the part of the way
 * between two logged positions. No clocks are compared, except once, roughly, to find which turn is
 * which revolution.
 *
 *   pan(c) = pan_r + (pan_r+1 - pan_r) * frac(c / N),   r = revolution of turn floor(c / N)
 *
 * No allocation after init; a sweep belongs to one thread. */
#ifndef SC_BASE_SWEEP_H
#define SC_BASE_SWEEP_H

#include "base/head_packet.h"
#include "base/rig.h"
#include "base/sample.h"
#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What the controller logged at an index pulse. */
struct sweep_index {
    int64_t t_host_ns;   /* when the host learned of it, within half a revolution */
    uint32_t revolution; /* unbroken count, missed pulses included */
    double pan_steps;    /* with the part of a step */
    double tilt_steps;
    int8_t pan_direction; /* +1, -1: side to which the play is taken up */
    bool sweep;           /* belongs to the sweep (not to the way to its start) */
};

enum sweep_verdict {
    SWEEP_GOOD,
    SWEEP_NO_INDEX /* before the first or after the last index pulse, or none known */
};

struct sweep {
    const struct sweep_index *index; /* sorted by revolution; the caller's */
    size_t index_count;
    /* unwrapping the encoder */
    bool started;
    uint32_t last_position, last_seq;
    int64_t turns;                /* whole turns since the start */
    int64_t revolution_of_turn_0; /* set by the first match */
    bool matched;
    size_t at; /* index at or before the current turn */
};

/* Where a sample was taken. */
struct sweep_place {
    enum sweep_verdict verdict;
    double counts; /* encoder counts within the turn */
    double pan_steps, tilt_steps;
    int pan_direction;
    uint32_t revolution;
    bool sweep;
};

/* Starts; `index` must be sorted by revolution and outlive the sweep. */
void sweep_init(struct sweep *sweep, const struct sweep_index *index, size_t index_count);

/* Places all samples of the next packet (in the order they were sent). t_host_ns: when it arrived.
 * out_places has room for sample_count. A lost packet is noticed by its sequence; turns are then
 * counted by time, which is safe up to half a turn of doubt. */
void sweep_packet(struct sweep *sweep, const struct head_packet *packet, int64_t t_host_ns,
                  struct sweep_place *out_places);

/* The sample's point in the station frame, NaN without a range or a place. */
struct vec3 sweep_point(const struct rig *rig, const struct sweep_place *place,
                        const struct head_sample *sample);

#ifdef __cplusplus
}
#endif
#endif
