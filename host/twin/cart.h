/* The simulated cart at one stand, in virtual time: the controller with its moving parts, the head,
 * the lines that the host watches. It is moved as a real cart is: through its controller's
 * registers (cart_motor()). What a real cart's devices would send comes out of a sink, in order;
 * what really happened comes out beside it.
 *
 * Deterministic: the same scene, parameters, seed and commands give the same bytes, whatever the
 * number of threads (each sample draws from its own random stream). One cart belongs to one thread;
 * within cart_advance() samples are simulated on all of them. */
#ifndef SC_TWIN_CART_H
#define SC_TWIN_CART_H

#include "base/head_packet.h"
#include "device/motor.h"
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

/* A line that the host watches; numbers as enum edge_record_line. */
enum cart_line {
    CART_LINE_INDEX = 0,
    CART_LINE_STROBE = 1,
    CART_LINE_ESTOP = 2,
    CART_LINE_INTERLOCK = 3,
    CART_LINES
};
struct cart_edge {
    int64_t t_host_ns;
    enum cart_line line;
    bool high;    /* what the line is now; pulses: true */
    uint32_t seq; /* counts the edges of that line from 0 */
    int64_t t_ns; /* truth: when, and how the cart stood */
    struct mechanics_state state;
};

/* Receivers; each may be NULL. A failure ends cart_advance() and is returned by it. */
struct cart_sink {
    void *ctx;
    enum st (*packet)(void *ctx, const struct cart_packet *packet, struct errctx *err);
    /* What the controller has logged, straight from its memory: for tests and truth. The host
     * reads events over the controller's line (cart_motor()). */
    enum st (*index)(void *ctx, const struct idxevent *event, struct errctx *err);
    enum st (*edge)(void *ctx, const struct cart_edge *edge, struct errctx *err);
    enum st (*shot)(void *ctx, const struct cart_shot *shot,
                    struct errctx *err); /* in order of seq */
};

struct cart; /* on the heap */

/* A cart at world_from_station (true: z is the pan axis, origin where pan and tilt axes meet).
 * scene, faults (may be NULL) outlive it. At true time 0: just switched on, not homed, laser off.
 * ST_NOMEM; ST_INVALID for parameters that make no cart. */
ST_MUST_CHECK enum st cart_create(const struct scene *scene, const struct twin_config *config,
                                  const struct faults *faults,
                                  const struct pose *world_from_station, uint64_t seed,
                                  const struct cart_sink *sink, struct cart **out_cart,
                                  struct errctx *err);
void cart_destroy(struct cart *cart); /* takes NULL; motors opened on it are closed before */

/* Runs virtual time up to t_ns. ST_CANCELLED once a power loss has come; what was before it has
 * gone to the sink. */
ST_MUST_CHECK enum st cart_advance(struct cart *cart, int64_t t_ns, struct errctx *err);

/* The cart's controller behind its register map. A request takes virtual time, as on a line of 115
 * 200 baud; what happens meanwhile goes to the sink. hooks (may be NULL, else outlives the motor):
 * enter before and leave after each request; leave's status is the request's if that was good. */
struct cart_hooks {
    void *ctx;
    enum st (*enter)(void *ctx, struct errctx *err);
    enum st (*leave)(void *ctx, struct errctx *err);
    int64_t (*now_ns)(void *ctx); /* host time that the motor's status carries */
};
ST_MUST_CHECK enum st cart_motor(struct cart *cart, const struct cart_hooks *hooks,
                                 struct motor **out_motor, struct errctx *err);

/* The present time: as far as the controller has come, by cart_advance() or by requests. The head
 * follows within 0.1 s, or at once with cart_advance(cart, cart_time_ns(cart)). */
int64_t cart_time_ns(const struct cart *cart);
/* State at the time to which the head has followed. */
struct mechanics_state cart_state(const struct cart *cart);
/* What a clock shows now. */
int64_t cart_clock_ns(const struct cart *cart, enum twin_config_clock which);
const struct clocks *cart_clock(const struct cart *cart, enum twin_config_clock which);
/* Samples taken so far (sent or not) and samples sent. */
uint64_t cart_samples(const struct cart *cart);
uint64_t cart_samples_sent(const struct cart *cart);
/* The fault of that kind that is on now; NULL: none. A fault without duration is on for `step_ns`.
 */
const struct fault *cart_fault(const struct cart *cart, enum faults_kind kind, int64_t step_ns);

#endif
