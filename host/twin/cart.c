#include "twin/cart.h"

#include "device/motor_sim.h"
#include "firmware/core/firmware.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Longest wait before a packet that is not full is sent. */
static const int64_t flush_ns = 20000000;
/* The head's usual setting (Nyland et al. 1999). */
static const double default_max_range_m = 6;
/* Slower, and the head says that the mirror is not at its speed. */
static const double locked_rad_s = 6;
/* A request to the controller is given up after this silence. */
static const uint64_t reply_timeout_us = 200000;
enum { BLOCK_MS = 700 };
/* The head may lag that far behind the controller between two calls of cart_advance(). */
static const int64_t follow_ns = 100000000;

/* Streams of random numbers of one cart; samples have their own. */
enum { SEED_MECHANICS = 1, SEED_CLOCKS, SEED_EVENTS };

struct cart {
    const struct scene *scene;
    const struct faults *faults;
    struct cart_sink sink;
    struct pose world_from_station;
    struct rig rig; /* true */
    struct optics optics;
    struct mechanics mechanics;
    struct clocks clock[3];
    struct rng events;
    uint64_t seed;
    double encoder_noise_counts, blind_counts, host_latency_us, ambient;
    uint32_t interval_ns;
    /* head */
    int64_t head_zero_ns; /* head clock reading that the head calls 0 (it moves with a reset) */
    int64_t sample;       /* number of the next sample: its head time is sample * interval */
    uint32_t seq_zero;    /* sample number that the head calls 0 */
    uint64_t taken, sent;
    struct head_packet packet;
    int64_t packet_t_ns; /* true time of its last sample */
    uint32_t packet_seq, packet_lost_left;
    bool reset_next;
    int64_t silent_until_ns; /* true time */
    double last_counts;
    struct mechanics_state now; /* at the last sample put into a packet */
    /* controller */
    struct motor_sim_line line;
    uint32_t next_event; /* of the controller's log */
    uint32_t edge_seq[CART_LINES];
    /* samples of the block */
    struct cart_shot *shot;
    int shot_capacity;
};

enum st cart_create(const struct scene *scene, const struct twin_config *config,
                    const struct faults *faults, const struct pose *world_from_station,
                    uint64_t seed, const struct cart_sink *sink, struct cart **out_cart,
                    struct errctx *err) {
    struct cart *c = calloc(1, sizeof *c);
    double rate = twin_config_real(config, TWIN_CONFIG_SAMPLE_RATE);
    int capacity = (int)(rate * MECHANICS_BLOCK_NS * 1e-9 * 1.01) + 16;
    struct cart_shot *shot = c ? malloc((size_t)capacity * sizeof *shot) : NULL;
    if (!c || !shot) {
        free(c);
        return errctx_set(err, ST_NOMEM, "simulated cart: out of memory");
    }
    c->shot = shot;
    c->shot_capacity = capacity;
    c->scene = scene;
    c->faults = faults;
    c->sink = *sink;
    c->world_from_station = *world_from_station;
    c->rig = twin_config_rig(config, true);
    c->optics = twin_config_optics(config);
    if (!(c->optics.max_range_m > 0))
        c->optics.max_range_m = scene->max_range_m > 0 ? scene->max_range_m : default_max_range_m;
    c->seed = seed;
    struct rng root = rng_stream(seed, 0);
    uint64_t plant_seed = rng_u64(&root) + SEED_MECHANICS;
    for (int i = 0; i < 3; i++) {
        struct clocks_spec spec = twin_config_clock(config, (enum twin_config_clock)i);
        c->clock[i] = clocks_make(&spec, rng_u64(&root) + SEED_CLOCKS);
    }
    for (size_t i = 0; faults && i < faults->count; i++)
        if (faults->list[i].kind == FAULTS_CLOCK_JUMP)
            clocks_jump(&c->clock[TWIN_CLOCK_HOST], faults->list[i].start_ns,
                        (int64_t)llround(faults->list[i].value * 1e9));
    c->events = rng_make(rng_u64(&root) + SEED_EVENTS);
    c->encoder_noise_counts = twin_config_real(config, TWIN_CONFIG_ENCODER_NOISE);
    c->blind_counts = twin_config_real(config, TWIN_CONFIG_BLIND_ARC) / 360 * HEAD_ENCODER_COUNTS;
    c->host_latency_us = twin_config_real(config, TWIN_CONFIG_HOST_LATENCY);
    c->ambient = scene->ambient;
    c->interval_ns = (uint32_t)llround(1e9 / rate);
    c->packet.interval_ns = c->interval_ns;
    c->reset_next = true;
    /* The head began to count when it was switched on, before the simulation: samples go on from
     * there. */
    int64_t shown_ns = clocks_show(&c->clock[TWIN_CLOCK_HEAD], 0);
    c->sample = shown_ns / c->interval_ns + 1;
    c->seq_zero = (uint32_t)c->sample;
    enum st st = mechanics_create(&c->mechanics, config, faults, &c->clock[TWIN_CLOCK_CONTROLLER],
                                  plant_seed, err);
    c->line = (struct motor_sim_line){c->mechanics.sim, reply_timeout_us};
    if (!st)
        st = mechanics_block(&c->mechanics, 0, 0, err);
    if (st) {
        cart_destroy(c);
        return st;
    }
    *out_cart = c;
    return ST_OK;
}

void cart_destroy(struct cart *cart) {
    if (!cart)
        return;
    mechanics_destroy(&cart->mechanics);
    free(cart->shot);
    free(cart);
}

int64_t cart_time_ns(const struct cart *cart) {
    return mechanics_reached_ns(&cart->mechanics);
}

struct mechanics_state cart_state(const struct cart *cart) {
    return mechanics_at(&cart->mechanics, (double)cart->mechanics.to_ns);
}

const struct clocks *cart_clock(const struct cart *cart, enum twin_config_clock which) {
    return &cart->clock[which];
}

int64_t cart_clock_ns(const struct cart *cart, enum twin_config_clock which) {
    return clocks_show(&cart->clock[which], cart_time_ns(cart));
}

uint64_t cart_samples(const struct cart *cart) {
    return cart->taken;
}

uint64_t cart_samples_sent(const struct cart *cart) {
    return cart->sent;
}

const struct fault *cart_fault(const struct cart *cart, enum faults_kind kind, int64_t step_ns) {
    int64_t now_ns = cart->mechanics.to_ns;
    const struct fault *f = NULL;
    if (cart->faults)
        f = faults_at(cart->faults, kind, now_ns, 1);
    for (size_t i = 0; !f && cart->faults && i < cart->faults->count; i++) {
        const struct fault *one = &cart->faults->list[i];
        if (one->kind == kind && !one->duration_ns && now_ns >= one->start_ns &&
            now_ns < one->start_ns + step_ns)
            f = one;
    }
    return f;
}

/* When the host notices something that happened at true time t. */
static int64_t host_notices(struct cart *c, int64_t t_ns) {
    double latency_ns = 0;
    if (c->host_latency_us > 0)
        latency_ns = -c->host_latency_us * 1000 * log(1 - rng_uniform(&c->events));
    return clocks_show(&c->clock[TWIN_CLOCK_HOST], t_ns + (int64_t)latency_ns);
}

static bool fault_on(const struct cart *c, enum faults_kind kind, int64_t t_ns, int64_t step_ns) {
    return c->faults && faults_at(c->faults, kind, t_ns, step_ns);
}

/* ---- head: samples ---- */

/* The beam's middle axis and its sweep during an integration around t. */
static struct optics_beam beam_at(const struct cart *c, const struct mechanics_state *s,
                                  double t_ns) {
    double half = c->optics.rays > 1 ? 0.5 * c->interval_ns : 0;
    struct rig_beam mid = rig_direction(&c->rig, s->mirror_rad, s->tilt_rad, s->pan_rad);
    struct optics_beam beam = {.origin_m = pose_apply(&c->world_from_station, mid.origin_m),
                               .dir = mat3_mulv(&c->world_from_station.r, mid.dir)};
    if (half > 0) {
        struct mechanics_state a = mechanics_at(&c->mechanics, t_ns - half);
        struct mechanics_state b = mechanics_at(&c->mechanics, t_ns + half);
        struct rig_beam from = rig_direction(&c->rig, a.mirror_rad, a.tilt_rad, a.pan_rad);
        struct rig_beam to = rig_direction(&c->rig, b.mirror_rad, b.tilt_rad, b.pan_rad);
        beam.sweep = mat3_mulv(&c->world_from_station.r, vec3_sub(to.dir, from.dir));
    }
    return beam;
}

/* Is this encoder position in the arc that the head leaves out? */
static bool blind(const struct cart *c, double counts) {
    double turn = counts / HEAD_ENCODER_COUNTS;
    double away = fabs(turn - floor(turn + 0.5)) * HEAD_ENCODER_COUNTS; /* from the index */
    return away < c->blind_counts / 2;
}

static void simulate_sample(const struct cart *c, int64_t number, double t_ns,
                            struct cart_shot *shot) {
    struct rng rng = rng_stream(c->seed ^ 0x5a3c17e9u, (uint64_t)number);
    memset(shot, 0, sizeof *shot);
    shot->seq = (uint32_t)number - c->seq_zero;
    shot->t_ns = (int64_t)t_ns;
    shot->state = mechanics_at(&c->mechanics, t_ns);
    double counts = mechanics_counts(&c->mechanics, t_ns);
    shot->counts = counts + c->encoder_noise_counts * rng_normal(&rng);
    shot->range_m = (double)NAN;
    if (blind(c, counts))
        return;
    shot->beam = beam_at(c, &shot->state, t_ns);
    if (!shot->state.laser) {
        shot->reading.flags = HEAD_SAMPLE_LASER_OFF;
        shot->reading.distance_m = (double)NAN;
        return;
    }
    optics_shoot(c->scene, &c->optics, &shot->beam, &rng, &shot->echo);
    /* Background light at the target: the scene's level, less where nothing reflects it. */
    double ambient = c->ambient * (shot->echo.energy > 0 ? 1 : 0.7);
    optics_detect(&c->optics, &shot->echo, ambient, &rng, &shot->reading);
    shot->range_m = rig_range(&c->rig, shot->reading.distance_m);
}

/* ---- head: packets ---- */

static enum st deliver(struct cart *c, const uint8_t *bytes, size_t size, uint32_t seq,
                       struct errctx *err) {
    if (!c->sink.packet)
        return ST_OK;
    struct cart_packet packet = {bytes, size, seq, host_notices(c, c->packet_t_ns + 125000),
                                 c->packet.sample_count};
    return c->sink.packet(c->sink.ctx, &packet, err);
}

/* Sends what has been gathered, with what may go wrong on the way. */
static enum st flush(struct cart *c, struct errctx *err) {
    if (!c->packet.sample_count)
        return ST_OK;
    uint8_t bytes[HEAD_PACKET_MAX_BYTES];
    size_t size = 0;
    int64_t t_ns = c->packet_t_ns, step_ns = (int64_t)c->interval_ns * c->packet.sample_count;
    c->packet.packet_seq = c->packet_seq++;
    const struct fault *wrong =
        c->faults ? faults_at(c->faults, FAULTS_PACKET_SEQUENCE, t_ns - step_ns, step_ns) : NULL;
    if (wrong)
        c->packet.packet_seq += (uint32_t)(int64_t)wrong->value;
    c->packet.flags = c->reset_next ? HEAD_PACKET_RESET : 0;
    c->packet.status = (c->now.laser ? HEAD_STATUS_LASER_ON : 0u) |
                       (c->now.mirror_rad_s > locked_rad_s ? HEAD_STATUS_MIRROR_LOCKED : 0u);
    c->reset_next = false;
    enum st st = head_packet_encode(&c->packet, bytes, &size);
    if (st)
        return errctx_set(err, ST_INTERNAL, "simulated head: a packet outside the protocol");
    const struct fault *lost =
        c->faults ? faults_at(c->faults, FAULTS_PACKET_LOST, t_ns - step_ns, step_ns) : NULL;
    if (lost && lost->duration_ns == 0)
        c->packet_lost_left = (uint32_t)lost->value;
    bool gone = c->packet_lost_left > 0 || (lost && lost->duration_ns > 0);
    if (c->packet_lost_left)
        c->packet_lost_left--;
    const struct fault *flips =
        c->faults ? faults_at(c->faults, FAULTS_BIT_ERROR, t_ns - step_ns, step_ns) : NULL;
    for (int i = 0; flips && i < (int)flips->value; i++) {
        uint32_t bit = rng_below(&c->events, (uint32_t)size * 8);
        bytes[bit / 8] ^= (uint8_t)(1u << (bit % 8));
    }
    uint32_t count = c->packet.sample_count;
    if (!gone) {
        st = deliver(c, bytes, size, c->packet.packet_seq, err);
        if (!st && fault_on(c, FAULTS_PACKET_REPEATED, t_ns - step_ns, step_ns))
            st = deliver(c, bytes, size, c->packet.packet_seq, err);
    }
    c->sent += count;
    c->packet.sample_count = 0;
    return st;
}

static void head_reset(struct cart *c, int64_t number, const struct fault *fault) {
    c->seq_zero = (uint32_t)number;
    c->head_zero_ns = number * (int64_t)c->interval_ns;
    c->packet_seq = 0;
    c->reset_next = true;
    c->silent_until_ns = fault->start_ns + (int64_t)llround(fault->value * 1e9);
}

static uint16_t to_u16(double x) {
    return (uint16_t)(x <= 0 ? 0 : x >= 1 ? 65535 : x * 65535 + 0.5);
}

/* Puts one sample into the packet under way. */
static enum st gather(struct cart *c, int64_t number, const struct cart_shot *shot,
                      struct errctx *err) {
    const struct fault *reset =
        c->faults ? faults_at(c->faults, FAULTS_HEAD_RESET, shot->t_ns, c->interval_ns) : NULL;
    enum st st = ST_OK;
    if (reset && reset->start_ns >= shot->t_ns) {
        c->packet.sample_count = 0; /* what was not sent is lost */
        head_reset(c, number, reset);
    }
    if (shot->t_ns < c->silent_until_ns)
        return ST_OK;
    uint32_t seq = (uint32_t)number - c->seq_zero;
    struct head_packet *p = &c->packet;
    bool gap = p->sample_count && p->first_sample_seq + p->sample_count != seq;
    bool old = p->sample_count && shot->t_ns - c->packet_t_ns > flush_ns;
    if (gap || old)
        st = flush(c, err);
    if (st)
        return st;
    if (!p->sample_count) {
        p->first_sample_seq = seq;
        p->head_t_ns = number * (int64_t)c->interval_ns - c->head_zero_ns;
    }
    struct head_sample *s = &p->samples[p->sample_count++];
    s->position = head_position_from_counts(shot->counts);
    s->range = head_range_from_m(shot->range_m);
    s->intensity = to_u16(shot->reading.intensity);
    s->ambient = to_u16(shot->reading.ambient);
    s->flags = shot->reading.flags;
    if (floor(shot->counts / HEAD_ENCODER_COUNTS) > floor(c->last_counts / HEAD_ENCODER_COUNTS))
        s->flags |= HEAD_SAMPLE_INDEX;
    c->last_counts = shot->counts;
    c->now = shot->state;
    c->packet_t_ns = shot->t_ns;
    return p->sample_count == HEAD_PACKET_MAX_SAMPLES ? flush(c, err) : ST_OK;
}

/* ---- controller and lines ---- */

/* An edge on one of the lines that the host watches. */
static enum st send_edge(struct cart *c, const struct mechanics_event *event, int64_t t_ns,
                         struct errctx *err) {
    static const enum cart_line line[] = {[MECHANICS_INDEX] = CART_LINE_INDEX,
                                          [MECHANICS_STROBE] = CART_LINE_STROBE,
                                          [MECHANICS_ESTOP] = CART_LINE_ESTOP,
                                          [MECHANICS_INTERLOCK] = CART_LINE_INTERLOCK};
    struct cart_edge edge = {.t_host_ns = host_notices(c, t_ns),
                             .line = line[event->kind],
                             .high = event->high,
                             .seq = c->edge_seq[line[event->kind]]++,
                             .t_ns = t_ns};
    if (!c->sink.edge)
        return ST_OK;
    edge.state = mechanics_at(&c->mechanics, (double)t_ns);
    return c->sink.edge(c->sink.ctx, &edge, err);
}

/* Hands on what the controller has logged since the last time. */
static enum st send_log(struct cart *c, struct errctx *err) {
    const struct evring *ring = &sim_firmware(c->mechanics.sim)->events;
    enum st st = ST_OK;
    if (ring->next < c->next_event) /* it has been reset */
        c->next_event = 0;
    if (ring->next - c->next_event > EVRING_SIZE)
        c->next_event = ring->next - EVRING_SIZE;
    for (; c->next_event < ring->next && !st; c->next_event++)
        if (c->sink.index)
            st = c->sink.index(c->sink.ctx, &ring->events[c->next_event % EVRING_SIZE], err);
    return st;
}

/* ---- time ---- */

/* Samples whose middle lies in the block are simulated in parallel. Returns their number. */
static int simulate_block(struct cart *c, int64_t from_ns, int64_t to_ns) {
    const struct clocks *head = &c->clock[TWIN_CLOCK_HEAD];
    double shown0 = (double)clocks_show(head, from_ns), shown1 = (double)clocks_show(head, to_ns);
    /* the clock is straight within a block */
    double rate = (double)(to_ns - from_ns) / (shown1 - shown0);
    int64_t first = c->sample;
    int count = 0;
    while (count < c->shot_capacity && (double)((first + count) * (int64_t)c->interval_ns) < shown1)
        count++;
#pragma omp parallel for schedule(dynamic, 64) if (count > 1024)
    for (int i = 0; i < count; i++) {
        double t_ns =
            (double)from_ns + ((double)((first + i) * (int64_t)c->interval_ns) - shown0) * rate;
        simulate_sample(c, first + i, t_ns, &c->shot[i]);
    }
    c->sample = first + count;
    return count;
}

static enum st send_shot(struct cart *c, int64_t number, const struct cart_shot *shot,
                         struct errctx *err) {
    c->taken++;
    if (!(vec3_norm(shot->beam.dir) > 0)) /* in the blind arc, which ends a packet */
        return c->packet.sample_count ? flush(c, err) : ST_OK;
    enum st st = gather(c, number, shot, err);
    if (!st && c->sink.shot)
        st = c->sink.shot(c->sink.ctx, shot, err);
    return st;
}

/* The controller and its plant have run up to to_ns: now what the head measures meanwhile, and all
 * that goes out, in order. */
static enum st run_block(struct cart *c, int64_t to_ns, struct errctx *err) {
    int64_t from_ns = c->mechanics.to_ns;
    enum st st = mechanics_block(&c->mechanics, from_ns, to_ns, err);
    if (st)
        return st;
    int64_t first = c->sample;
    int count = simulate_block(c, from_ns, to_ns);
    struct mechanics_event event;
    int64_t event_ns = 0;
    size_t next = 0;
    bool waiting = mechanics_event(&c->mechanics, 0, &event, &event_ns);
    for (int i = 0; i <= count && !st; i++) {
        int64_t t_ns = i < count ? c->shot[i].t_ns : to_ns;
        while (waiting && event_ns <= t_ns && !st) {
            st = send_edge(c, &event, event_ns, err);
            waiting = mechanics_event(&c->mechanics, ++next, &event, &event_ns);
        }
        if (i < count && !st)
            st = send_shot(c, first + i, &c->shot[i], err);
    }
    return st ? st : send_log(c, err);
}

/* Ends of blocks: not too long, and not beyond a loss of power. */
static int64_t next_end(const struct cart *c, int64_t end_ns) {
    int64_t from_ns = c->mechanics.to_ns;
    int64_t next_ns = end_ns - from_ns > MECHANICS_BLOCK_NS ? from_ns + MECHANICS_BLOCK_NS : end_ns;
    for (size_t i = 0; c->faults && i < c->faults->count; i++) {
        const struct fault *f = &c->faults->list[i];
        if (f->kind == FAULTS_POWER_LOSS && f->start_ns < next_ns)
            next_ns = f->start_ns > from_ns ? f->start_ns : from_ns;
    }
    return next_ns;
}

enum st cart_advance(struct cart *cart, int64_t t_ns, struct errctx *err) {
    while (cart->mechanics.to_ns < t_ns) {
        int64_t next_ns = next_end(cart, t_ns);
        if (next_ns == cart->mechanics.to_ns)
            return errctx_set(err, ST_CANCELLED, "the cart lost power at %.3f s",
                              (double)next_ns * 1e-9);
        mechanics_run(&cart->mechanics, next_ns);
        enum st st = run_block(cart, next_ns, err);
        if (st)
            return st;
    }
    return ST_OK;
}

/* ---- the controller's line ---- */

/* A line whose requests the cart follows. */
struct cart_request {
    struct cart *cart;
    struct cart_hooks hooks;
    struct motor_line inner;
};

static int begin(const struct cart_request *r, struct errctx *err) {
    enum st st = r->hooks.enter ? r->hooks.enter(r->hooks.ctx, err) : ST_OK;
    /* Without power there is nobody to ask. */
    if (!st && next_end(r->cart, r->cart->mechanics.to_ns + 1) == r->cart->mechanics.to_ns) {
        st = errctx_set(err, ST_CANCELLED, "the cart has lost power");
        if (r->hooks.leave)
            (void)r->hooks.leave(r->hooks.ctx, NULL);
    }
    return st;
}

static int end(const struct cart_request *r, int result, struct errctx *err) {
    /* Requests are short: the head follows in larger bites, which all threads can share. */
    int64_t reached_ns = mechanics_reached_ns(&r->cart->mechanics);
    bool due = reached_ns - r->cart->mechanics.to_ns > follow_ns;
    enum st st = due || r->hooks.leave ? cart_advance(r->cart, reached_ns, err) : ST_OK;
    enum st left = r->hooks.leave ? r->hooks.leave(r->hooks.ctx, st ? NULL : err) : ST_OK;
    if (st || left)
        return st ? st : left;
    return result;
}

static int request_read(void *ctx, uint16_t start, unsigned count, uint16_t *out_words,
                        struct errctx *err) {
    const struct cart_request *r = ctx;
    int st = begin(r, err);
    return st ? st : end(r, r->inner.read(r->inner.ctx, start, count, out_words, err), err);
}

static int request_read_discrete(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits,
                                 struct errctx *err) {
    const struct cart_request *r = ctx;
    int st = begin(r, err);
    return st ? st : end(r, r->inner.read_discrete(r->inner.ctx, start, count, out_bits, err), err);
}

static int request_write(void *ctx, uint16_t start, unsigned count, const uint16_t *words,
                         bool repeat, struct errctx *err) {
    const struct cart_request *r = ctx;
    int st = begin(r, err);
    return st ? st : end(r, r->inner.write(r->inner.ctx, start, count, words, repeat, err), err);
}

static int request_write_coil(void *ctx, uint16_t coil, bool on, bool repeat, struct errctx *err) {
    const struct cart_request *r = ctx;
    int st = begin(r, err);
    return st ? st : end(r, r->inner.write_coil(r->inner.ctx, coil, on, repeat, err), err);
}

static int request_write_read(void *ctx, uint16_t write_start, unsigned write_count,
                              const uint16_t *words, uint16_t read_start, unsigned read_count,
                              uint16_t *out_words, struct errctx *err) {
    const struct cart_request *r = ctx;
    int st = begin(r, err);
    return st ? st
              : end(r,
                    r->inner.write_read(r->inner.ctx, write_start, write_count, words, read_start,
                                        read_count, out_words, err),
                    err);
}

static int64_t request_now(void *ctx) {
    const struct cart_request *r = ctx;
    return r->hooks.now_ns ? r->hooks.now_ns(r->hooks.ctx)
                           : cart_clock_ns(r->cart, TWIN_CLOCK_HOST);
}

enum st cart_motor(struct cart *cart, const struct cart_hooks *hooks, struct motor **out_motor,
                   struct errctx *err) {
    struct cart_request *r = calloc(1, sizeof *r);
    if (!r)
        return errctx_set(err, ST_NOMEM, "simulated controller: out of memory");
    r->cart = cart;
    r->hooks = hooks ? *hooks : r->hooks;
    r->inner = motor_sim_line(&cart->line);
    struct motor_line line = {.ctx = r,
                              .read = request_read,
                              .read_discrete = request_read_discrete,
                              .write = request_write,
                              .write_coil = request_write_coil,
                              .write_read = request_write_read,
                              .close = free,
                              .now_ns = request_now};
    return motor_map_open(&line, BLOCK_MS, out_motor, err);
}
