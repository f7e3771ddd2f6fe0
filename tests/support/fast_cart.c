#include "tests/support/fast_cart.h"

#include "base/clock.h"
#include "base/head_packet.h"
#include "firmware/shared/faultcode.h"

#include <math.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    TRANSFER_PACKETS = 32,
    AT_SEQ = 8, /* packet_seq, first_sample_seq, head_t_ns follow each other */
    VARYING = 16,
    AT_CRC = HEAD_PACKET_MAX_BYTES - HEAD_PACKET_CRC_BYTES
};

struct fast_cart {
    struct motor motor; /* first */
    struct head head;
    struct lines lines;
    struct hosttime hosttime;
    double sample_hz;
    /* motor: the plan's thread */
    int64_t start_ns;
    bool motors, homed[MOTOR_AXES];
    int32_t steps[MOTOR_AXES];
    double mirror_hz;
    int64_t mirror_ns;
    struct motor_scan scan;
    int64_t scan_ns; /* 0: off */
    /* laser: two threads */
    _Atomic int64_t laser_ns; /* on since; 0: off */
    /* head's thread */
    uint8_t base[HEAD_PACKET_MAX_BYTES];
    uint32_t crc_of[VARYING][256];
    uint32_t base_crc;
    uint8_t transfer[TRANSFER_PACKETS * HEAD_PACKET_MAX_BYTES];
    uint64_t sent; /* packets since the laser went on */
    unsigned per_transfer;
    bool started;
    /* lines' thread */
    uint32_t edges;
    int64_t next_edge_ns;
    /* any */
    _Atomic uint64_t packets, late;
    void (*watch)(void *ctx, int inside);
    void *watch_ctx;
};

static struct fast_cart *of_motor(struct motor *motor) {
    union {
        struct motor *motor;
        struct fast_cart *cart;
    } u = {.motor = motor};
    return u.cart;
}

/* ---- motor ---- */

static enum st identify(struct motor *m, struct motor_identity *out, struct errctx *err) {
    (void)err;
    memset(out, 0, sizeof *out);
    out->map_version = 1;
    out->uptime_ns = clock_now_ns() - of_motor(m)->start_ns;
    return ST_OK;
}

static double swept(const struct fast_cart *c) {
    double steps = (double)(clock_now_ns() - c->scan_ns) * 1e-9 * c->scan.rate;
    return fmin(c->scan.from_steps + steps, c->scan.to_steps);
}

static enum st status(struct motor *m, struct motor_status *out, struct errctx *err) {
    struct fast_cart *c = of_motor(m);
    (void)err;
    memset(out, 0, sizeof *out);
    out->t_ns = clock_now_ns();
    out->laser_on = atomic_load(&c->laser_ns) != 0;
    out->motors_on = c->motors;
    out->state = out->laser_on ? CTLSTATE_LASER : c->motors ? CTLSTATE_READY : CTLSTATE_IDLE;
    for (int i = 0; i < MOTOR_AXES; i++) {
        out->axis[i].steps = c->steps[i];
        out->axis[i].homed = c->homed[i];
    }
    out->mirror_rps = c->mirror_hz;
    out->mirror_in_range = c->mirror_hz > 0;
    out->scan_state = SCANSTATE_OFF;
    if (c->scan_ns) {
        out->axis[MOTOR_PAN].steps = (int32_t)swept(c);
        out->scan_state = swept(c) < c->scan.to_steps ? SCANSTATE_SWEEP : SCANSTATE_DONE;
    }
    return ST_OK;
}

static enum st enable(struct motor *m, bool on, struct errctx *err) {
    (void)err;
    of_motor(m)->motors = on;
    if (!on)
        atomic_store(&of_motor(m)->laser_ns, 0);
    return ST_OK;
}

static enum st home(struct motor *m, enum motor_axis axis, struct errctx *err) {
    (void)err;
    of_motor(m)->homed[axis] = true;
    return ST_OK;
}

static enum st move(struct motor *m, enum motor_axis axis, int32_t steps, struct errctx *err) {
    (void)err;
    of_motor(m)->steps[axis] = steps;
    return ST_OK;
}

static enum st stop(struct motor *m, struct errctx *err) {
    (void)err;
    of_motor(m)->scan_ns = 0;
    return ST_OK;
}

static enum st mirror(struct motor *m, double speed_rps, struct errctx *err) {
    struct fast_cart *c = of_motor(m);
    (void)err;
    c->mirror_hz = speed_rps;
    c->mirror_ns = clock_now_ns();
    return ST_OK;
}

static enum st laser(struct motor *m, bool on, struct errctx *err) {
    (void)err;
    atomic_store(&of_motor(m)->laser_ns, on ? clock_now_ns() : 0);
    return ST_OK;
}

static enum st scan_program(struct motor *m, const struct motor_scan *scan, struct errctx *err) {
    (void)err;
    of_motor(m)->scan = *scan;
    return ST_OK;
}

static enum st scan_run(struct motor *m, bool on, struct errctx *err) {
    (void)err;
    of_motor(m)->scan_ns = on ? clock_now_ns() : 0;
    return ST_OK;
}

static enum st camera_program(struct motor *m, const struct motor_camera *camera,
                              struct errctx *err) {
    (void)m;
    (void)camera;
    (void)err;
    return ST_OK;
}

static enum st nothing(struct motor *m, struct errctx *err) {
    (void)m;
    (void)err;
    return ST_OK;
}

/* Events by the clock: number n at mirror_ns + n / hz. */
static enum st read_events(struct motor *m, uint64_t from, struct index_event *out, size_t capacity,
                           size_t *out_count, uint64_t *out_lost, struct errctx *err) {
    struct fast_cart *c = of_motor(m);
    (void)err;
    *out_count = 0;
    *out_lost = 0;
    if (c->mirror_hz <= 0)
        return ST_OK;
    int64_t turn_ns = (int64_t)(1e9 / c->mirror_hz);
    uint64_t there = (uint64_t)((clock_now_ns() - c->mirror_ns) / turn_ns);
    for (; *out_count < capacity && from < there; from++) {
        bool sweep = c->scan_ns && swept(c) < c->scan.to_steps;
        unsigned flags = INDEX_EVENT_PAN_POSITIVE | INDEX_EVENT_MIRROR_OK |
                         (sweep ? INDEX_EVENT_SWEEP | INDEX_EVENT_LASER : 0);
        out[(*out_count)++] = (struct index_event){
            .seq = from,
            .t_ns = (c->mirror_ns - c->start_ns + (int64_t)from * turn_ns) / 1000 * 1000,
            .revolution = from,
            .pan_steps = c->scan_ns ? floor(swept(c)) : c->steps[MOTOR_PAN],
            .kind = INDEX_EVENT_INDEX,
            .flags = (uint16_t)flags};
    }
    return ST_OK;
}

static enum st host_timeout(struct motor *m, unsigned timeout_ms, struct errctx *err) {
    (void)m;
    (void)timeout_ms;
    (void)err;
    return ST_OK;
}

static enum st clear_fault(struct motor *m, unsigned fault, struct errctx *err) {
    (void)m;
    (void)fault;
    (void)err;
    return ST_OK;
}

static void motor_nothing(struct motor *m) {
    (void)m;
}

static const struct motor_ops motor_ops = {
    identify,    status,       enable,       home,        move,           stop,
    mirror,      laser,        scan_program, scan_run,    camera_program, nothing,
    read_events, host_timeout, nothing,      clear_fault, nothing,        motor_nothing};

/* ---- head ---- */

static struct fast_cart *of_head(struct head *head) {
    return (struct fast_cart *)(void *)((char *)head - offsetof(struct fast_cart, head));
}

/* CRC-32 bit by bit. */
static uint32_t slow_crc(const uint8_t *bytes, size_t size) {
    uint32_t crc = 0xffffffffu;
    for (size_t i = 0; i < size; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    }
    return ~crc;
}

/* A packet, and how its checksum changes with each of the bytes that vary: it is linear. */
static bool prepare(struct fast_cart *c) {
    struct head_packet p;
    size_t size = 0;
    memset(&p, 0, sizeof p);
    p.interval_ns = (uint32_t)lrint(1e9 / c->sample_hz);
    p.status = HEAD_STATUS_LASER_ON | HEAD_STATUS_MIRROR_LOCKED;
    p.sample_count = HEAD_PACKET_MAX_SAMPLES;
    for (unsigned i = 0; i < p.sample_count; i++)
        p.samples[i] = (struct head_sample){
            .position = i << 26, .range = 5000000 + i, .intensity = 3000, .ambient = 20};
    if (head_packet_encode(&p, c->base, &size))
        return false;
    c->base_crc = slow_crc(c->base, AT_CRC);
    for (int at = 0; at < VARYING; at++)
        for (unsigned value = 0; value < 256; value++) {
            c->base[AT_SEQ + at] = (uint8_t)value;
            c->crc_of[at][value] = slow_crc(c->base, AT_CRC) ^ c->base_crc;
            c->base[AT_SEQ + at] = 0;
        }
    return true;
}

static void put(uint8_t *to, uint64_t value, int bytes) {
    for (int i = 0; i < bytes; i++)
        to[i] = (uint8_t)(value >> (8 * i));
}

/* The n-th packet; only the low bits of its samples' numbers stay those of the first one. */
static void make_packet(struct fast_cart *c, uint64_t n, uint8_t *to) {
    double t_ns = (double)n * HEAD_PACKET_MAX_SAMPLES * 1e9 / c->sample_hz;
    memcpy(to, c->base, HEAD_PACKET_MAX_BYTES);
    put(to + AT_SEQ, n, 4);
    put(to + AT_SEQ + 4, n * HEAD_PACKET_MAX_SAMPLES, 4);
    put(to + AT_SEQ + 8, (uint64_t)t_ns, 8);
    uint32_t crc = c->base_crc;
    for (int at = 0; at < VARYING; at++)
        crc ^= c->crc_of[at][to[AT_SEQ + at]];
    put(to + AT_CRC, crc, 4);
}

static enum st head_identify(struct head *head, struct head_identity *out, struct errctx *err) {
    (void)err;
    memset(out, 0, sizeof *out);
    out->protocol_version = HEAD_PACKET_VERSION;
    out->interval_ns = (uint32_t)lrint(1e9 / of_head(head)->sample_hz);
    return ST_OK;
}

static enum st head_start(struct head *head, struct errctx *err) {
    (void)err;
    of_head(head)->started = true;
    of_head(head)->sent = 0;
    return ST_OK;
}

static enum st head_pump(struct head *head, unsigned timeout_ms, const struct head_sink *sink,
                         struct errctx *err) {
    struct fast_cart *c = of_head(head);
    int64_t since_ns = atomic_load(&c->laser_ns);
    double packet_ns = HEAD_PACKET_MAX_SAMPLES * 1e9 / c->sample_hz;
    for (bool first = true;; first = false) {
        int64_t due_ns = since_ns + (int64_t)((double)(c->sent + c->per_transfer) * packet_ns);
        int64_t now_ns = clock_now_ns();
        if (!since_ns || due_ns > now_ns) {
            int64_t wait_ns = since_ns ? due_ns - now_ns : (int64_t)timeout_ms * 1000000;
            if (!first || !timeout_ms)
                return ST_OK;
            wait_ns =
                wait_ns < (int64_t)timeout_ms * 1000000 ? wait_ns : (int64_t)timeout_ms * 1000000;
            (void)hosttime_wait_until(&hosttime_real, now_ns + wait_ns, err);
            return ST_OK;
        }
        if (now_ns - due_ns > 2000000000)
            c->late++;
        for (unsigned i = 0; i < c->per_transfer; i++)
            make_packet(c, c->sent + i, c->transfer + i * HEAD_PACKET_MAX_BYTES);
        c->sent += c->per_transfer;
        if (c->watch)
            c->watch(c->watch_ctx, 1);
        sink->bytes(sink->ctx, c->transfer, (size_t)c->per_transfer * HEAD_PACKET_MAX_BYTES,
                    due_ns);
        if (c->watch)
            c->watch(c->watch_ctx, 0);
        c->packets += c->per_transfer;
    }
}

static enum st head_stop(struct head *head, const struct head_sink *sink, struct errctx *err) {
    (void)sink;
    (void)err;
    of_head(head)->started = false;
    return ST_OK;
}

static void head_stats(const struct head *head, struct head_stats *out) {
    (void)head;
    memset(out, 0, sizeof *out);
}

static void head_nothing(struct head *head) {
    (void)head;
}

static const struct head_ops head_ops = {head_identify, head_start, head_pump,
                                         head_stop,     head_stats, head_nothing};

/* ---- lines: an index edge 100 times a second ---- */

static struct fast_cart *of_lines(struct lines *lines) {
    return (struct fast_cart *)(void *)((char *)lines - offsetof(struct fast_cart, lines));
}

static enum st lines_levels(struct lines *lines, struct lines_levels *out, struct errctx *err) {
    (void)lines;
    (void)err;
    *out = (struct lines_levels){.wired = 1u << EDGE_RECORD_INDEX};
    return ST_OK;
}

static enum st lines_pump(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                          struct errctx *err) {
    struct fast_cart *c = of_lines(lines);
    const int64_t period_ns = 10000000;
    int64_t now_ns = clock_now_ns();
    if (!c->next_edge_ns)
        c->next_edge_ns = now_ns;
    if (c->next_edge_ns > now_ns && timeout_ms)
        (void)hosttime_wait_until(&hosttime_real, c->next_edge_ns, err);
    for (; c->next_edge_ns <= clock_now_ns(); c->next_edge_ns += period_ns) {
        struct edge_record edge = {c->next_edge_ns, c->edges++, EDGE_RECORD_INDEX, 1};
        if (c->watch)
            c->watch(c->watch_ctx, 1);
        sink->edge(sink->ctx, &edge);
        if (c->watch)
            c->watch(c->watch_ctx, 0);
    }
    return ST_OK;
}

static void lines_stats(const struct lines *lines, struct lines_stats *out) {
    (void)lines;
    memset(out, 0, sizeof *out);
}

static void lines_nothing(struct lines *lines) {
    (void)lines;
}

static const struct lines_ops lines_ops = {lines_levels, lines_pump, lines_stats, lines_nothing};

/* ---- the whole ---- */

struct fast_cart *fast_cart_open(double sample_hz) {
    struct fast_cart *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->motor = (struct motor){&motor_ops, 10};
    c->head.ops = &head_ops;
    c->lines.ops = &lines_ops;
    c->sample_hz = sample_hz;
    c->start_ns = clock_now_ns() - 1000000000;
    c->hosttime = hosttime_real;
    double wanted = sample_hz / HEAD_PACKET_MAX_SAMPLES / 100;
    c->per_transfer = wanted < 1                  ? 1
                      : wanted > TRANSFER_PACKETS ? TRANSFER_PACKETS
                                                  : (unsigned)wanted;
    if (prepare(c))
        return c;
    free(c);
    return NULL;
}

void fast_cart_close(struct fast_cart *cart) {
    free(cart);
}

struct cart_devices fast_cart_devices(struct fast_cart *cart) {
    return (struct cart_devices){.hosttime = &cart->hosttime,
                                 .motor = &cart->motor,
                                 .head = &cart->head,
                                 .lines = &cart->lines};
}

uint64_t fast_cart_packets(struct fast_cart *cart) {
    return cart->packets;
}

uint64_t fast_cart_late(struct fast_cart *cart) {
    return cart->late;
}

void fast_cart_watch(struct fast_cart *cart, void (*watch)(void *ctx, int inside), void *ctx) {
    cart->watch = watch;
    cart->watch_ctx = ctx;
}
