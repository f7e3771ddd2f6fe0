#include "twin/cart.h"

#include <stdlib.h>
#include <string.h>

/* Longest wait before a packet that is not full is sent. */
static const int64_t flush_ns = 20000000;
/* The head's usual setting (Nyland et al. 1999). */
static const double default_max_range_m = 6;

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
    bool laser;
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
    /* controller */
    struct idxevent event;
    bool sweep;
    uint32_t edge_seq[2];
    bool index_was_missing;
    int64_t last_index_ns; /* true time */
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
    int capacity = (int)(rate * MECHANICS_BLOCK * MECHANICS_STEP_NS * 1e-9 * 1.01) + 16;
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
    mechanics_init(&c->mechanics, config, faults, rng_u64(&root) + SEED_MECHANICS);
    for (int i = 0; i < 3; i++) {
        struct clocks_spec spec = twin_config_clock(config, (enum twin_config_clock)i);
        c->clock[i] = clocks_make(&spec, rng_u64(&root) + SEED_CLOCKS);
    }
    for (size_t i = 0; faults && i < faults->count; i++)
        if (faults->list[i].kind == FAULTS_CLOCK_JUMP)
            clocks_jump(&c->clock[TWIN_CLOCK_HOST], faults->list[i].start_ns,
                        (int64_t)llround(faults->list[i].value * 1e9));
    c->last_index_ns = -1;
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
    *out_cart = c;
    return ST_OK;
}

void cart_destroy(struct cart *cart) {
    if (!cart)
        return;
    free(cart->shot);
    free(cart);
}

int64_t cart_time_ns(const struct cart *cart) {
    return cart->mechanics.t_ns;
}

struct mechanics_state cart_state(const struct cart *cart) {
    return mechanics_at(&cart->mechanics, (double)cart->mechanics.t_ns);
}

const struct clocks *cart_clock(const struct cart *cart, enum twin_config_clock which) {
    return &cart->clock[which];
}

int64_t cart_clock_ns(const struct cart *cart, enum twin_config_clock which) {
    return clocks_show(&cart->clock[which], cart->mechanics.t_ns);
}

uint64_t cart_samples(const struct cart *cart) {
    return cart->taken;
}

uint64_t cart_samples_sent(const struct cart *cart) {
    return cart->sent;
}

void cart_mirror(struct cart *cart, double speed_hz) {
    mechanics_mirror(&cart->mechanics, speed_hz);
}

void cart_laser(struct cart *cart, bool on) {
    cart->laser = on;
}

void cart_pan(struct cart *cart, double target_steps, double rate_steps_s, bool sweep) {
    mechanics_move(&cart->mechanics.pan, target_steps, rate_steps_s);
    cart->sweep = sweep;
}

void cart_tilt(struct cart *cart, double target_steps, double rate_steps_s) {
    mechanics_move(&cart->mechanics.tilt, target_steps, rate_steps_s);
}

bool cart_at_rest(const struct cart *cart) {
    return mechanics_at_rest(&cart->mechanics.pan) && mechanics_at_rest(&cart->mechanics.tilt);
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
    double counts = mechanics_counts(&c->mechanics, &shot->state, t_ns);
    shot->counts = counts + c->encoder_noise_counts * rng_normal(&rng);
    shot->range_m = (double)NAN;
    if (blind(c, counts))
        return;
    shot->beam = beam_at(c, &shot->state, t_ns);
    if (!c->laser) {
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
    c->packet.status = (c->laser ? HEAD_STATUS_LASER_ON : 0u) | HEAD_STATUS_MIRROR_LOCKED;
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
    c->packet_t_ns = shot->t_ns;
    return p->sample_count == HEAD_PACKET_MAX_SAMPLES ? flush(c, err) : ST_OK;
}

/* ---- controller and GPIO ---- */

static struct idxevent event_now(struct cart *c, int64_t t_ns, enum idxevent_kind kind) {
    struct mechanics_state s = mechanics_at(&c->mechanics, (double)t_ns);
    const struct mechanics_axis *pan = &c->mechanics.pan;
    struct idxevent e = c->event;
    double steps = floor(s.pan_motor_steps);
    bool moving = fabs(pan->velocity_steps_s) > 0;
    e.time_us = (uint64_t)(clocks_read(&c->clock[TWIN_CLOCK_CONTROLLER], t_ns, &c->events) / 1000);
    e.pan_steps = (int32_t)steps;
    e.tilt_steps = (int32_t)llround(s.tilt_motor_steps);
    e.pan_phase = moving ? (uint16_t)((s.pan_motor_steps - steps) * 65536) : 0;
    e.flags =
        (uint16_t)((int)kind | IDXEVENT_PAN_HOMED | IDXEVENT_TILT_HOMED | IDXEVENT_PAN_TAKEN_UP |
                   (moving ? IDXEVENT_PAN_MOVING : 0) |
                   (pan->direction > 0 ? IDXEVENT_PAN_POSITIVE : 0) |
                   (c->laser ? IDXEVENT_LASER : 0) | (c->sweep && moving ? IDXEVENT_SWEEP : 0) |
                   IDXEVENT_MIRROR_OK | (c->index_was_missing ? IDXEVENT_AFTER_MISSED : 0));
    return e;
}

static enum st send_event(struct cart *c, int64_t t_ns, enum idxevent_kind kind,
                          enum cart_line line, struct errctx *err) {
    struct idxevent e = event_now(c, t_ns, kind);
    c->event.seq++;
    c->index_was_missing = false;
    struct cart_edge edge = {host_notices(c, t_ns), line, c->edge_seq[line]++};
    enum st st = ST_OK;
    if (c->sink.index)
        st = c->sink.index(c->sink.ctx, &e, edge.t_host_ns, err);
    if (!st && c->sink.edge)
        st = c->sink.edge(c->sink.ctx, &edge, err);
    return st;
}

/* Missing while the fault lasts; a fault without duration swallows the next pulse after its start.
 */
static bool index_missing(struct cart *c, int64_t t_ns) {
    for (size_t i = 0; c->faults && i < c->faults->count; i++) {
        const struct fault *f = &c->faults->list[i];
        if (f->kind != FAULTS_INDEX_MISSING || t_ns < f->start_ns)
            continue;
        if (f->duration_ns ? t_ns < f->start_ns + f->duration_ns : c->last_index_ns < f->start_ns)
            return true;
    }
    return false;
}

static enum st index_pulse(struct cart *c, int64_t t_ns, struct errctx *err) {
    c->event.revolution++;
    bool missing = index_missing(c, t_ns);
    c->last_index_ns = t_ns;
    if (missing) {
        c->index_was_missing = true;
        return ST_OK;
    }
    return send_event(c, t_ns, IDXEVENT_INDEX, CART_LINE_INDEX, err);
}

enum st cart_strobe(struct cart *cart, struct errctx *err) {
    return send_event(cart, cart->mechanics.t_ns, IDXEVENT_STROBE, CART_LINE_STROBE, err);
}

/* ---- time ---- */

/* Samples whose middle lies in the block: simulated in parallel, then sent in order with the index
 * pulses. */
static enum st run_block(struct cart *c, struct errctx *err) {
    const struct mechanics *m = &c->mechanics;
    int64_t from_ns = m->block_t_ns, to_ns = m->t_ns;
    const struct clocks *head = &c->clock[TWIN_CLOCK_HEAD];
    double shown0 = (double)clocks_show(head, from_ns), shown1 = (double)clocks_show(head, to_ns);
    double rate =
        (double)(to_ns - from_ns) / (shown1 - shown0); /* the clock is straight within a block */
    int64_t first = c->sample;
    int count = 0;
    while (count < c->shot_capacity && (double)((first + count) * (int64_t)c->interval_ns) < shown1)
        count++;
#pragma omp parallel for schedule(dynamic, 64)
    for (int i = 0; i < count; i++) {
        double t_ns =
            (double)from_ns + ((double)((first + i) * (int64_t)c->interval_ns) - shown0) * rate;
        simulate_sample(c, first + i, t_ns, &c->shot[i]);
    }
    c->sample = first + count;
    int64_t pulse[64];
    int pulses = mechanics_index(m, pulse, 64), next = 0;
    enum st st = ST_OK;
    for (int i = 0; i <= count && !st; i++) {
        int64_t t_ns = i < count ? c->shot[i].t_ns : to_ns;
        for (; next < pulses && pulse[next] <= t_ns && !st; next++)
            st = index_pulse(c, pulse[next], err);
        if (i == count || st)
            break;
        c->taken++;
        if (vec3_norm(c->shot[i].beam.dir) > 0) {
            st = gather(c, first + i, &c->shot[i], err);
            if (!st && c->sink.shot)
                st = c->sink.shot(c->sink.ctx, &c->shot[i], err);
        } else if (c->packet.sample_count) {
            st = flush(c, err); /* the blind arc begins */
        }
    }
    return st;
}

enum st cart_advance(struct cart *cart, int64_t t_ns, struct errctx *err) {
    while (cart->mechanics.t_ns < t_ns) {
        int64_t left = (t_ns - cart->mechanics.t_ns + MECHANICS_STEP_NS - 1) / MECHANICS_STEP_NS;
        int steps = left < MECHANICS_BLOCK ? (int)left : MECHANICS_BLOCK;
        const struct fault *cut =
            cart->faults ? faults_at(cart->faults, FAULTS_POWER_LOSS, cart->mechanics.t_ns,
                                     (int64_t)steps * MECHANICS_STEP_NS)
                         : NULL;
        if (cut)
            return errctx_set(err, ST_CANCELLED, "the cart lost power at %.3f s",
                              (double)cut->start_ns * 1e-9);
        mechanics_advance(&cart->mechanics, steps);
        enum st st = run_block(cart, err);
        if (st)
            return st;
    }
    return ST_OK;
}
