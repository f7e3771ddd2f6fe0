/* The moving parts: pan, tilt and mirror as the controller's own firmware moves them. The firmware
 * core runs on its simulated port (firmware/port/sim), whose virtual time is the controller's
 * clock; this file builds that plant from the twin's parameters, maps its time to true time, lets
 * the scheduled faults loose in it, and keeps a record of its motion, from which any instant of a
 * block of time can be asked for, by many threads.
 *
 * Between two steps the pan and the tilt move evenly (finely stepped motors), as the controller
 * assumes when it logs the fraction of a step. */
#ifndef SC_TWIN_MECHANICS_H
#define SC_TWIN_MECHANICS_H

#include "base/rig.h"
#include "base/rng.h"
#include "firmware/port/sim/sim.h"
#include "twin/clocks.h"
#include "twin/faults.h"
#include "twin/twin_config.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { MECHANICS_BLOCK_NS = 250000000 }; /* longest block */

/* Everything that moves, at one instant. */
struct mechanics_state {
    double mirror_rad; /* theta, grows without bound */
    double mirror_rad_s;
    double pan_rad, tilt_rad;                 /* true angles of the head */
    double pan_motor_steps, tilt_motor_steps; /* as the controller counts, with the fraction */
    bool laser;
};

enum mechanics_event_kind {
    MECHANICS_INDEX,  /* an index pulse on the wires */
    MECHANICS_STROBE, /* the camera begins to expose */
    MECHANICS_ESTOP,  /* chain opened or closed */
    MECHANICS_INTERLOCK
};

struct mechanics_event {
    double us; /* controller's plant, exact */
    enum mechanics_event_kind kind;
    bool high;
};

struct mechanics_segment {
    double t0_us, rev0, rps0, acceleration;
};

/* Where an axis was at an instant; between two of them it moved evenly. */
struct mechanics_mark {
    double us, head_steps, counted_steps;
};

struct mechanics_laser {
    double us;
    bool on;
};

/* A growing array of records; `items` is of the kind that its user says. */
struct mechanics_list {
    void *items;
    size_t count, capacity, item_size;
};

struct mechanics {
    struct sim *sim;
    struct sim_config plant;
    struct rig rig; /* true */
    const struct clocks *clock;
    const struct faults *faults;
    double play_steps, shown_zero_us, sim_zero_us;
    bool out_of_memory;
    struct mechanics_list segment, mark[HAL_AXES], laser, event;
    size_t tail[HAL_AXES]; /* marks beyond mark[].count: the step that is about to be given */
    /* the block */
    int64_t from_ns, to_ns;
    double from_us, us_a_ns;
};

/* The controller has just been switched on and commissioned; true time 0. clock (the controller's)
 * and faults (may be NULL) outlive it. ST_NOMEM; ST_INVALID if the parameters make no cart, or for
 * more faults at once than the plant takes. */
ST_MUST_CHECK enum st mechanics_create(struct mechanics *m, const struct twin_config *config,
                                       const struct faults *faults, const struct clocks *clock,
                                       uint64_t seed, struct errctx *err);
void mechanics_destroy(struct mechanics *m); /* takes a zeroed one */

/* Lets the controller and its plant run until true time t_ns (no effect if that has passed). */
void mechanics_run(struct mechanics *m, int64_t t_ns);
/* True time until which they have run: also by requests to the controller. */
int64_t mechanics_reached_ns(const struct mechanics *m);

/* Makes [from_ns, to_ns] the block, to_ns having been reached, not longer than MECHANICS_BLOCK_NS;
 * forgets what was before it. ST_NOMEM if the record has holes. */
ST_MUST_CHECK enum st mechanics_block(struct mechanics *m, int64_t from_ns, int64_t to_ns,
                                      struct errctx *err);

/* The state at t within the block (a few us beyond it are fine). Any thread. */
struct mechanics_state mechanics_at(const struct mechanics *m, double t_ns);
/* What the encoder disc shows then: counts, growing without bound; 0 of a turn is the index. */
double mechanics_counts(const struct mechanics *m, double t_ns);

/* Event `number` of the block, in order of time, and its true time; false: there are no more. */
bool mechanics_event(const struct mechanics *m, size_t number, struct mechanics_event *out_event,
                     int64_t *out_t_ns);

#endif
