/* A sweep put together: which pan and tilt belong to each sample of the head. The mirror is the
 * clock: the head counts its encoder's turns, the controller logs pan and tilt steps at the index
 * pulse of each revolution.
 *
 * With index pulses whose clocks were fitted (cart_clock.h, clock_solve.h) the head's own time says
 * where a sample lies between two logged positions; the way between them is a pan_curve. Such
 * pulses also carry what the encoder had slipped, and the sigma of everything.
 *
 * With pulses that only have the host's time, clocks are compared once, roughly, to find which turn
 * is which revolution, and the part of a turn that the encoder shows is the part of the way:
 *
 *   pan(c) = pan_r + (pan_r+1 - pan_r) * frac(c / N),   r = revolution of turn floor(c / N)
 *
 * No allocation; a sweep belongs to one thread. */
#ifndef SC_BASE_SWEEP_H
#define SC_BASE_SWEEP_H

#include "base/head_packet.h"
#include "base/head_turns.h"
#include "base/pan_curve.h"
#include "base/rig.h"
#include "base/sample.h"
#include "base/st.h"
#include "base/sweep_index.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum sweep_verdict {
    SWEEP_GOOD,
    SWEEP_NO_INDEX, /* before the first or after the last index pulse, or none known */
    SWEEP_LATER     /* on line: the pulse after it has not come yet */
};

/* The curve that was asked for last. */
struct sweep_cursor {
    size_t at; /* index at or before */
    size_t curve_at;
    bool has_curve;
    struct pan_curve curve;
    struct pan_curve_params params;
};

struct sweep {
    const struct sweep_index *index; /* sorted; the caller's */
    size_t index_count;
    bool fitted; /* index carries the fit of the clocks */
    struct head_epoch epoch;
    struct sweep_cursor cursor;
    /* by phase: unwrapping the encoder */
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
    double counts; /* encoder counts within the turn, slips taken out */
    double pan_steps, tilt_steps;
    double pan_sigma_steps, tilt_sigma_steps; /* NaN: not known (index pulses without a fit) */
    int pan_direction;
    uint32_t revolution;
    bool sweep;
};

/* Starts; `index` must be sorted (by revolution; fitted ones by epoch and head time) and outlive
 * the sweep. cursor.params may be set afterwards: the noise of logged positions is measured here,
 * the pan's acceleration is left 0, unknown. */
void sweep_init(struct sweep *sweep, const struct sweep_index *index, size_t index_count);

/* Places all samples of the next packet (in the order they were sent). t_host_ns: when it arrived.
 * out_places has room for sample_count. A lost packet is noticed by its sequence; without a fit
 * turns are then counted by time, which is safe up to half a turn of doubt. */
void sweep_packet(struct sweep *sweep, const struct head_packet *packet, int64_t t_host_ns,
                  struct sweep_place *out_places);

/* One instant among fitted index pulses. counts: what the encoder showed. */
void sweep_at(struct sweep_cursor *cursor, const struct sweep_index *index, size_t count,
              uint32_t head_epoch, int64_t t_head_ns, double counts, struct sweep_place *out_place);

/* The sample's point in the station frame, NaN without a range or a place. */
struct vec3 sweep_point(const struct rig *rig, const struct sweep_place *place,
                        const struct head_sample *sample);

/* Sigma of the head's pan and tilt at a place, rad: of the steps, and of the play where its side is
 * not known. NaN: not known. */
double sweep_pan_sigma(const struct rig *rig, const struct sweep_place *place);
double sweep_tilt_sigma(const struct rig *rig, const struct sweep_place *place);

#ifdef __cplusplus
}
#endif
#endif
