#include "tests/support/fake_cart.h"

#include "base/head_packet.h"
#include "device/motor_sim.h"
#include "firmware/shared/regmap.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { PIXELS_WIDE = 24, PIXELS_HIGH = 16, EDGES = 4096, BYTES = 8 << 20 };

struct fake_cart {
    struct head head_base; /* first: the ops get a pointer to it */
    struct fake_cart_spec spec;
    struct sim *sim;
    struct motor *motor;
    struct sim_observer observer;
    struct hosttime hosttime;
    /* head */
    bool laser, started, reset;
    double next_sample_us, interval_us;
    struct head_packet packet;
    uint64_t packets, samples, lose_at, lose_count, spoil_at, repeat_at, reset_at;
    uint8_t *bytes; /* [BYTES], what has been sent and not been taken */
    size_t size;
    uint64_t dropped; /* bytes that nobody took */
    uint32_t last_position;
    /* lines */
    struct edge_record edge[EDGES];
    size_t edges;
    uint32_t edge_seq;
    /* camera */
    uint8_t pixels[PIXELS_HIGH * PIXELS_WIDE * 3];
    unsigned photographs, no_frame;
    bool disk_full;
};

struct lines_holder {
    struct lines lines;
    struct fake_cart *cart;
};
struct camera_holder {
    struct camera_device camera;
    struct fake_cart *cart;
};
struct holders {
    struct fake_cart cart;
    struct lines_holder lines;
    struct camera_holder camera;
};

static int64_t host_ns(const struct fake_cart *c, double us) {
    return c->spec.host_offset_ns + (int64_t)llrint(us * 1000);
}

/* ---- what the world does ---- */

static void send_packet(struct fake_cart *c) {
    uint8_t bytes[HEAD_PACKET_MAX_BYTES];
    size_t size = 0;
    struct head_packet *p = &c->packet;
    if (!p->sample_count)
        return;
    if (c->packets == c->reset_at) {
        c->reset = true;
        c->spec.first_packet = (uint32_t)(0 - c->packets);
    }
    p->packet_seq = c->spec.first_packet + (uint32_t)c->packets;
    p->flags = c->reset ? HEAD_PACKET_RESET : 0;
    p->status = HEAD_STATUS_LASER_ON | HEAD_STATUS_MIRROR_LOCKED;
    c->reset = false;
    uint64_t number = c->packets++;
    if (!head_packet_encode(p, bytes, &size) && c->started &&
        (number < c->lose_at || number >= c->lose_at + c->lose_count)) {
        if (c->spec.head_version)
            bytes[4] = (uint8_t)c->spec.head_version;
        if (number == c->spoil_at)
            bytes[40] ^= 16;
        for (int twice = 0; twice < (number == c->repeat_at ? 2 : 1); twice++)
            if (c->size + size <= BYTES) {
                memcpy(c->bytes + c->size, bytes, size);
                c->size += size;
            } else {
                c->dropped += size;
            }
    }
    p->sample_count = 0;
}

static void take_sample(struct fake_cart *c, double t_us, double rev) {
    const double blind_from = 0.625, blind_to = 0.875; /* around straight down */
    double turn = rev - floor(rev);
    uint32_t seq = c->spec.first_sample + (uint32_t)c->samples++;
    if (turn >= blind_from && turn < blind_to) {
        send_packet(c);
        return;
    }
    struct head_packet *p = &c->packet;
    if (!p->sample_count) {
        p->first_sample_seq = seq;
        p->head_t_ns = c->spec.head_t_ns + (int64_t)llrint(t_us * 1000);
        p->interval_ns = (uint32_t)lrint(c->interval_us * 1000);
    }
    struct head_sample *s = &p->samples[p->sample_count++];
    s->position = head_position_from_counts(turn * HEAD_ENCODER_COUNTS);
    s->range = head_range_from_m(2 + (double)(c->samples % 1000) * 0.001);
    s->intensity = (uint16_t)(1000 + c->samples % 50000);
    s->ambient = 7;
    s->flags = s->position < c->last_position ? HEAD_SAMPLE_INDEX : 0;
    if (c->samples % 97 == 0) {
        s->range = HEAD_RANGE_NONE;
        s->flags |= HEAD_SAMPLE_NO_RETURN;
    }
    c->last_position = s->position;
    if (p->sample_count == HEAD_PACKET_MAX_SAMPLES)
        send_packet(c);
}

static void on_mirror(void *ctx, uint64_t t0_us, uint64_t t1_us, double rev0, double rps0,
                      double acceleration) {
    struct fake_cart *c = ctx;
    if (!c->laser)
        return;
    if (c->next_sample_us < (double)t0_us)
        c->next_sample_us = (double)t0_us;
    for (; c->next_sample_us < (double)t1_us; c->next_sample_us += c->interval_us) {
        double t = (c->next_sample_us - (double)t0_us) * 1e-6;
        take_sample(c, c->next_sample_us, rev0 + rps0 * t + acceleration / 2 * t * t);
    }
}

static void on_laser(void *ctx, uint64_t t_us, bool on) {
    struct fake_cart *c = ctx;
    (void)t_us;
    c->laser = on;
    if (!on)
        send_packet(c);
}

static void on_pulse(void *ctx, double exact_us) {
    struct fake_cart *c = ctx;
    if (c->edges < EDGES)
        c->edge[c->edges++] =
            (struct edge_record){host_ns(c, exact_us), c->edge_seq, EDGE_RECORD_INDEX, 1};
    c->edge_seq++;
}

/* ---- time ---- */

static int64_t now_ns(void *ctx) {
    const struct fake_cart *c = ctx;
    return host_ns(c, (double)sim_now_us(c->sim));
}

static bool power_gone(const struct fake_cart *c) {
    return c->spec.power_ns && (int64_t)sim_now_us(c->sim) * 1000 >= c->spec.power_ns;
}

static enum st wait_until(void *ctx, int64_t t_ns, struct errctx *err) {
    struct fake_cart *c = ctx;
    int64_t us = (t_ns - c->spec.host_offset_ns + 999) / 1000;
    if (us > 0)
        sim_advance_to(c->sim, (uint64_t)us);
    return power_gone(c) ? errctx_set(err, ST_CANCELLED, "the power went") : ST_OK;
}

/* ---- head ---- */

static struct fake_cart *of_head(struct head *head) {
    union {
        struct head *head;
        struct fake_cart *cart;
    } u = {.head = head};
    return u.cart;
}

static enum st head_identify(struct head *head, struct head_identity *out, struct errctx *err) {
    struct fake_cart *c = of_head(head);
    (void)err;
    memset(out, 0, sizeof *out);
    (void)snprintf(out->product, sizeof out->product, "fake head");
    (void)snprintf(out->serial, sizeof out->serial, "1");
    out->protocol_version = HEAD_PACKET_VERSION;
    out->interval_ns = (uint32_t)lrint(c->interval_us * 1000);
    return ST_OK;
}

static enum st head_start(struct head *head, struct errctx *err) {
    struct fake_cart *c = of_head(head);
    (void)err;
    c->started = true;
    c->size = 0;
    return ST_OK;
}

static enum st head_pump(struct head *head, unsigned timeout_ms, const struct head_sink *sink,
                         struct errctx *err) {
    struct fake_cart *c = of_head(head);
    (void)timeout_ms;
    if (power_gone(c))
        return errctx_set(err, ST_CANCELLED, "the power went");
    if (c->size && sink)
        sink->bytes(sink->ctx, c->bytes, c->size, now_ns(c));
    c->size = 0;
    if (c->spec.handed_over)
        *c->spec.handed_over = c->packets;
    return ST_OK;
}

static enum st head_stop(struct head *head, const struct head_sink *sink, struct errctx *err) {
    enum st st = head_pump(head, 0, sink, err);
    of_head(head)->started = false;
    return st;
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

/* ---- lines ---- */

static struct fake_cart *of_lines(struct lines *lines) {
    union {
        struct lines *lines;
        struct lines_holder *holder;
    } u = {.lines = lines};
    return u.holder->cart;
}

static enum st lines_levels(struct lines *lines, struct lines_levels *out, struct errctx *err) {
    uint32_t open = sim_truth(of_lines(lines)->sim).inputs;
    (void)err;
    (void)open;
    *out = (struct lines_levels){.wired = 1u << EDGE_RECORD_INDEX};
    return ST_OK;
}

static enum st lines_pump(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                          struct errctx *err) {
    struct fake_cart *c = of_lines(lines);
    (void)timeout_ms;
    (void)err;
    for (size_t i = 0; i < c->edges; i++)
        sink->edge(sink->ctx, &c->edge[i]);
    c->edges = 0;
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

/* ---- camera ---- */

static struct fake_cart *of_camera(struct camera_device *camera) {
    union {
        struct camera_device *camera;
        struct camera_holder *holder;
    } u = {.camera = camera};
    return u.holder->cart;
}

static enum st camera_identify(struct camera_device *camera, struct camera_device_identity *out,
                               struct errctx *err) {
    (void)camera;
    (void)err;
    memset(out, 0, sizeof *out);
    return ST_OK;
}

static enum st camera_configure(struct camera_device *camera, struct camera_settings *settings,
                                struct errctx *err) {
    (void)camera;
    (void)err;
    settings->width_px = PIXELS_WIDE;
    settings->height_px = PIXELS_HIGH;
    return ST_OK;
}

static enum st camera_nothing(struct camera_device *camera, struct errctx *err) {
    (void)camera;
    (void)err;
    return ST_OK;
}

static enum st camera_frame(struct camera_device *camera, int64_t after_ns, unsigned timeout_ms,
                            struct camera_frame *out, struct errctx *err) {
    struct fake_cart *c = of_camera(camera);
    if (c->photographs == c->no_frame) {
        sim_advance(c->sim, (uint64_t)timeout_ms * 1000);
        return errctx_set(err, ST_TIMEOUT, "the camera gives no frame");
    }
    sim_advance(c->sim, 20000);
    int pan = (int)lrint(sim_truth(c->sim).head_steps[0]);
    for (size_t i = 0; i < sizeof c->pixels; i++)
        c->pixels[i] = (uint8_t)(i * 7 + (size_t)(pan + 100000));
    memset(out, 0, sizeof *out);
    out->bytes = c->pixels;
    out->size = sizeof c->pixels;
    out->width_px = PIXELS_WIDE;
    out->height_px = PIXELS_HIGH;
    out->stride_bytes = PIXELS_WIDE * 3;
    out->format = CAMERA_FORMAT_RGB24;
    out->seq = c->photographs++;
    out->t_ns = after_ns + 5000000;
    out->exposure_s = 0.01;
    out->gain = 1;
    out->settings_held = true;
    return ST_OK;
}

static void camera_close(struct camera_device *camera) {
    (void)camera;
}

static const struct camera_device_ops camera_ops = {
    camera_identify, camera_configure, camera_nothing, camera_frame, camera_nothing, camera_close};

/* ---- the whole ---- */

static bool disk_is_full(void *ctx) {
    return ((const struct fake_cart *)ctx)->disk_full;
}

static bool power_up(struct fake_cart *c) {
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    for (int i = 0; i < HAL_AXES; i++)
        config.axis[i].start = config.axis[i].home_edge + 300;
    c->sim = sim_create(&config);
    struct errctx err = {0};
    if (!c->sim || motor_sim_open(c->sim, &c->motor, &err))
        return false;
    (void)sim_write1(c->sim, REGMAP_ADDR_commission_save, 0x5afe);
    c->observer = (struct sim_observer){.laser = on_laser, .pulse = on_pulse, .mirror = on_mirror};
    sim_observe(c->sim, &c->observer, c);
    return true;
}

struct fake_cart *fake_cart_open(const struct fake_cart_spec *spec) {
    struct holders *h = calloc(1, sizeof *h);
    if (!h)
        return NULL;
    struct fake_cart *c = &h->cart;
    c->spec = *spec;
    c->head_base.ops = &head_ops;
    c->bytes = malloc(BYTES);
    c->interval_us = 1e6 / (spec->sample_hz > 0 ? spec->sample_hz : 2000);
    c->lose_at = c->spoil_at = c->repeat_at = c->reset_at = UINT64_MAX;
    c->no_frame = UINT32_MAX;
    c->reset = !spec->head_goes_on;
    c->hosttime = (struct hosttime){c, now_ns, wait_until, true};
    h->lines = (struct lines_holder){{&lines_ops}, c};
    h->camera = (struct camera_holder){{&camera_ops}, c};
    if (c->bytes && power_up(c))
        return c;
    fake_cart_close(c);
    return NULL;
}

void fake_cart_close(struct fake_cart *cart) {
    if (!cart)
        return;
    motor_close(cart->motor);
    sim_destroy(cart->sim);
    free(cart->bytes);
    free(cart); /* the first member of its holder */
}

struct cart_devices fake_cart_devices(struct fake_cart *cart) {
    union {
        struct fake_cart *cart;
        struct holders *holders;
    } u = {.cart = cart};
    struct cart_devices devices = {.hosttime = &cart->hosttime,
                                   .motor = cart->motor,
                                   .head = &cart->head_base,
                                   .lines = cart->spec.no_lines ? NULL : &u.holders->lines.lines,
                                   .camera =
                                       cart->spec.no_camera ? NULL : &u.holders->camera.camera,
                                   .disk_full = disk_is_full,
                                   .ctx = cart};
    return devices;
}

struct sim *fake_cart_sim(struct fake_cart *cart) {
    return cart->sim;
}

void fake_cart_lose(struct fake_cart *cart, uint64_t packet, uint64_t count) {
    cart->lose_at = packet;
    cart->lose_count = count;
}

void fake_cart_spoil(struct fake_cart *cart, uint64_t packet) {
    cart->spoil_at = packet;
}

void fake_cart_repeat(struct fake_cart *cart, uint64_t packet) {
    cart->repeat_at = packet;
}

void fake_cart_reset_head(struct fake_cart *cart, uint64_t packet) {
    cart->reset_at = packet;
}

void fake_cart_disk_full(struct fake_cart *cart, bool full) {
    cart->disk_full = full;
}

void fake_cart_no_frame(struct fake_cart *cart, unsigned photograph) {
    cart->no_frame = photograph;
}

uint64_t fake_cart_packets(const struct fake_cart *cart) {
    return cart->packets;
}

uint64_t fake_cart_samples(const struct fake_cart *cart) {
    return cart->samples;
}
