/* The simulated cart at one stand, in virtual time: moving parts, head, controller's index log,
 * GPIO edges. What a real cart's devices would send comes out of a sink, in order; what really
 * happened comes out beside it.
 *
 * Deterministic: the same scene, parameters, seed and commands give the same bytes, whatever the
 * number of threads (each sample draws from its own random stream). One cart belongs to one thread;
 * within cart_advance() samples are simulated on all of them. */
#ifndef SC_TWIN_CART_H
#define SC_TWIN_CART_H

#include "base/head_packet.h"
#include "firmware/shared/idxevent.h"
#include "twin/mechanics.h"
#include "twin/optics.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

/* One sample as it really was. */
struct cart_shot {
    uint32_t seq;
    int64_t t_ns; /* true time of the middle of its integration */
    struct mechanics_state state;
    double counts;           /* reported encoder counts before rounding, growing without bound */
    struct optics_beam beam; /* world frame; origin is the mirror */
    struct optics_echo echo;
    struct optics_reading reading;
    double range_m; /* as reported, before rounding to the wire's unit; NaN: none */
};

/* A packet of the head as it reaches the host. */
struct cart_packet {
    const uint8_t *bytes;
    size_t size;
    uint32_t packet_seq; /* as sent, faults included */
    int64_t t_host_ns;   /* arrival, host clock */
    uint32_t sample_count;
};

/* A line that the host watches. */
enum cart_line { CART_LINE_INDEX = 0, CART_LINE_STROBE = 1 };
struct cart_edge {
    int64_t t_host_ns;
    enum cart_line line;
    uint32_t seq; /* counts the edges of that line from 0 */
};

/* Receivers; each may be NULL. A failure ends cart_advance() and is returned by it. */
struct cart_sink {
    void *ctx;
    enum st (*packet)(void *ctx, const struct cart_packet *packet, struct errctx *err);
    enum st (*index)(void *ctx, const struct idxevent *event, int64_t t_host_ns,
                     struct errctx *err);
    enum st (*edge)(void *ctx, const struct cart_edge *edge, struct errctx *err);
    enum st (*shot)(void *ctx, const struct cart_shot *shot,
                    struct errctx *err); /* in order of seq */
};

struct cart; /* on the heap */

/* A cart at world_from_station (true: z is the pan axis, origin where pan and tilt axes meet).
 * scene, faults (may be NULL) and sink outlive it. At rest at true time 0, laser off. ST_NOMEM. */
ST_MUST_CHECK enum st cart_create(const struct scene *scene, const struct twin_config *config,
                                  const struct faults *faults,
                                  const struct pose *world_from_station, uint64_t seed,
                                  const struct cart_sink *sink, struct cart **out_cart,
                                  struct errctx *err);
void cart_destroy(struct cart *cart); /* takes NULL */

/* Runs virtual time up to t_ns. ST_CANCELLED once a power loss has come. */
ST_MUST_CHECK enum st cart_advance(struct cart *cart, int64_t t_ns, struct errctx *err);

/* Commands, effective from the cart's present time on. */
void cart_mirror(struct cart *cart, double speed_hz);
void cart_laser(struct cart *cart, bool on);
void cart_pan(struct cart *cart, double target_steps, double rate_steps_s, bool sweep);
void cart_tilt(struct cart *cart, double target_steps, double rate_steps_s);
bool cart_at_rest(const struct cart *cart);
/* The camera's strobe: an event for the controller and an edge for the host, at the present time.
 */
ST_MUST_CHECK enum st cart_strobe(struct cart *cart, struct errctx *err);

int64_t cart_time_ns(const struct cart *cart);
/* State at the present time. */
struct mechanics_state cart_state(const struct cart *cart);
/* What a clock shows now. */
int64_t cart_clock_ns(const struct cart *cart, enum twin_config_clock which);
const struct clocks *cart_clock(const struct cart *cart, enum twin_config_clock which);
/* Samples taken so far (sent or not) and samples sent. */
uint64_t cart_samples(const struct cart *cart);
uint64_t cart_samples_sent(const struct cart *cart);

#endif
