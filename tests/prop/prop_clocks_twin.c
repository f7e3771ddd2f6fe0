/* The clocks on the simulated cart, which runs the controller's own firmware: is the pan angle of
 * each sample within 0.05 mrad, and is its stated sigma true? Prints the figures that
 * docs/clocks.md gives. */
#include "../support/prop.h"
#include "clock_sums.h"
#include "twin/cart.h"
#include "twin/twin_drive.h"

#include <assert.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>

#include <cmocka.h>

static const double pi = 3.14159265358979323846;

struct item { /* what came, in order of host time */
    int64_t t_host_ns;
    enum { PACKET, EVENT, EDGE } kind;
    size_t at;
};

struct taped {
    struct head_packet packet;
    size_t shots; /* when it came */
    struct clock_world_truth truth[HEAD_PACKET_MAX_SAMPLES];
};

struct shot {
    uint32_t seq;
    int64_t t_ns;
    double pan_rad;
    bool laser;
};

struct tape {
    struct cart *cart;
    struct rng rng;
    double missing;
    struct item *item;
    struct taped *packet;
    struct index_event *event;
    struct shot *shot;
    size_t items, packets, events, shots, item_cap, packet_cap, event_cap, shot_cap;
    uint64_t dropped;
    bool sweeping;
};

static void *grow(void *items, size_t size, size_t count, size_t *capacity) {
    if (count < *capacity)
        return items;
    *capacity = *capacity ? 2 * *capacity : 4096;
    void *grown = realloc(items, *capacity * size);
    assert(grown);
    return grown;
}

static void keep(struct tape *t, int kind, int64_t t_host_ns, size_t at) {
    t->item = grow(t->item, sizeof *t->item, t->items, &t->item_cap);
    t->item[t->items].kind = kind;
    t->item[t->items].at = at;
    t->item[t->items++].t_host_ns = t_host_ns;
}

static enum st take_packet(void *ctx, const struct cart_packet *packet, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    size_t size;
    t->packet = grow(t->packet, sizeof *t->packet, t->packets, &t->packet_cap);
    if (head_packet_decode(packet->bytes, packet->size, &t->packet[t->packets].packet, &size))
        return ST_OK;
    t->packet[t->packets].shots = t->shots;
    keep(t, PACKET, packet->t_host_ns, t->packets++);
    return ST_OK;
}

static enum st take_edge(void *ctx, const struct cart_edge *edge, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    if (edge->line == CART_LINE_INDEX && edge->high && rng_uniform(&t->rng) >= t->missing)
        keep(t, EDGE, edge->t_host_ns, 0);
    return ST_OK;
}

static enum st take_shot(void *ctx, const struct cart_shot *shot, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    t->shot = grow(t->shot, sizeof *t->shot, t->shots, &t->shot_cap);
    t->shot[t->shots++] =
        (struct shot){shot->seq, shot->t_ns, shot->state.pan_rad, shot->state.laser};
    return ST_OK;
}

static enum st take_event(void *ctx, const struct index_event *event, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    if (rng_uniform(&t->rng) < t->missing) {
        t->dropped++;
        return ST_OK;
    }
    t->event = grow(t->event, sizeof *t->event, t->events, &t->event_cap);
    t->event[t->events] = *event;
    t->event[t->events].seq -= t->dropped; /* as if the controller had not seen it */
    keep(t, EVENT, cart_clock_ns(t->cart, TWIN_CLOCK_HOST), t->events++);
    return ST_OK;
}

static int by_time(const void *a, const void *b) {
    const struct item *x = a, *y = b;
    if (x->t_host_ns != y->t_host_ns)
        return x->t_host_ns < y->t_host_ns ? -1 : 1;
    return x->kind != y->kind ? (x->kind > y->kind) - (x->kind < y->kind)
                              : (x->at > y->at) - (x->at < y->at);
}

/* 50 ppm between all clocks, 1 ms of the host; a sparse head, so that the test is short. */
static struct twin_config cart_of_the_task(void) {
    struct twin_config c = twin_config_default();
    c.value[TWIN_CONFIG_SAMPLE_RATE].real = 4000;
    c.value[TWIN_CONFIG_RAYS].real = 1;
    c.value[TWIN_CONFIG_HEAD_DRIFT].real = 50;
    c.value[TWIN_CONFIG_CONTROLLER_DRIFT].real = -50;
    c.value[TWIN_CONFIG_HOST_DRIFT].real = 50;
    c.value[TWIN_CONFIG_HOST_LATENCY].real = 1000;
    return c;
}

/* The truth of a packet's samples, in steps as the controller counts: found by their numbers. */
static void find_truth(const struct tape *t, struct taped *p, const struct rig *rig, double rate) {
    double per_rad = rig->pan_steps_per_turn / (2 * pi);
    size_t at = p->shots - 40;
    if (p->shots <= 40) { /* long before the sweep */
        memset(p->truth, 0, sizeof p->truth);
        return;
    }
    for (unsigned i = 0; i < p->packet.sample_count; i++) {
        uint32_t seq = p->packet.first_sample_seq + i;
        while (at + 1 < t->shots && at < p->shots + 40 && t->shot[at].seq != seq)
            at++;
        const struct shot *s = &t->shot[at];
        assert_int_equal(s->seq, seq);
        double v = (s->pan_rad - s[-1].pan_rad) * per_rad / (1e-9 * (double)(s->t_ns - s[-1].t_ns));
        p->truth[i].pan_steps =
            (s->pan_rad + rig->pan_backlash_rad / 2) * per_rad + rig->pan_zero_steps;
        p->truth[i].pan_rate_steps_s = fabs(v) < 1e-6              ? 0
                                       : fabs(v / rate - 1) < 0.01 ? rate
                                                                   : v / 2;
        p->truth[i].slip_counts = 0;
    }
}

/* Homes, sweeps `turns` revolutions of the mirror, keeps all that comes during the sweep. */
static struct tape *tape_of(const struct twin_config *config, const char *const *fault_texts,
                            uint64_t seed, double missing, int turns) {
    struct errctx err = {0};
    struct scene *scene = NULL;
    struct faults faults = {.count = 0};
    struct tape *t = calloc(1, sizeof *t);
    assert(t);
    assert_int_equal(scene_create("sphere", 7, 0.2, &scene, &err), ST_OK);
    for (size_t i = 0; fault_texts && fault_texts[i]; i++)
        assert_int_equal(faults_parse(&faults, fault_texts[i], &err), ST_OK);
    struct cart_sink sink = {t, take_packet, NULL, take_edge, take_shot};
    struct pose pose = pose_identity();
    pose.t_m = vec3_make(0, 0, 1.6);
    t->rng = rng_stream(seed, 77);
    t->missing = missing;
    assert_int_equal(cart_create(scene, config, &faults, &pose, seed, &sink, &t->cart, &err),
                     ST_OK);
    double hz = twin_config_real(config, TWIN_CONFIG_MIRROR_HZ);
    double per_turn = twin_config_real(config, TWIN_CONFIG_PAN_PER_REV);
    struct twin_drive drive = {.cart = t->cart, .mirror_rps = hz, .ctx = t, .event = take_event};
    assert_int_equal(twin_drive_open(&drive, &err), ST_OK);
    struct motor_scan scan = {
        .from_steps = 100, .to_steps = 100 + (int32_t)(per_turn * turns), .rate = per_turn * hz};
    enum st st = twin_drive_sweep(&drive, &scan, 40, &err);
    if (st)
        (void)fprintf(stderr, "%s\n", err.text);
    assert_int_equal(st, ST_OK);
    twin_drive_close(&drive);
    cart_destroy(t->cart);
    scene_destroy(scene);
    struct rig rig = twin_config_rig(config, true);
    for (size_t i = 0; i < t->packets; i++)
        find_truth(t, &t->packet[i], &rig, scan.rate);
    qsort(t->item, t->items, sizeof *t->item, by_time);
    return t;
}

static struct clock_runs play(const struct tape *t, bool online, double rate) {
    struct cart_clock_params params = cart_clock_params_default();
    struct clock_runs out = {.done = {0}};
    struct clock_runs_feed *feed = clock_runs_open(online, &params, rate);
    struct clock_world_sink sink = clock_runs_sink(feed);
    for (size_t i = 0; i < t->items; i++) {
        const struct item *is = &t->item[i];
        if (is->kind == PACKET)
            sink.packet(sink.ctx, &t->packet[is->at].packet, is->t_host_ns,
                        t->packet[is->at].truth);
        else if (is->kind == EVENT)
            sink.event(sink.ctx, &t->event[is->at], is->t_host_ns);
        else
            sink.edge(sink.ctx, is->t_host_ns);
    }
    clock_runs_close(feed, &out);
    return out;
}

static void tape_free(struct tape *t) {
    free(t->item);
    free(t->packet);
    free(t->event);
    free(t->shot);
    free(t);
}

/* What went wrong in each case. The sweep begins at about 30 s. */
static const struct {
    const char *name, *fault[4];
} cases[] = {
    {"1 % missing", {NULL}},
    {"and index_missing", {"index_missing@50+0.9", "index_missing@60", NULL}},
    {"and lost packets", {"packet_lost@50=40", "packet_lost@55+0.8", "bit_error@60+0.5=1", NULL}},
    {"and clock_jump", {"clock_jump@55=0.25", NULL}},
    {"and head_reset", {"head_reset@55=0.5", NULL}},
    {"and encoder_slip", {"encoder_slip@55=3", NULL}}};

static void the_simulated_cart_keeps_what_is_asked(void **state) {
    (void)state;
    enum { SEEDS = 3, TURNS = 200, CASES = sizeof cases / sizeof cases[0] };
    uint64_t seed = prop_seed();
    struct twin_config config = cart_of_the_task();
    double rate = twin_config_real(&config, TWIN_CONFIG_MIRROR_HZ) *
                  twin_config_real(&config, TWIN_CONFIG_PAN_PER_REV);
    struct sums all[2] = {{0}, {0}};
    print_head();
    for (int k = 0; k < CASES; k++) {
        struct sums sums[2] = {{0}, {0}};
        for (uint64_t round = 0; round < (k ? 1 : SEEDS); round++) {
            struct tape *t =
                tape_of(&config, cases[k].fault, seed + round + 10 * (uint64_t)k, 0.01, TURNS);
            for (int i = 0; i < 2; i++) {
                struct clock_runs r = play(t, i == 0, rate);
                add(&sums[i], &r);
                add(&all[i], &r);
                assert_true(r.error.moving > 1000);
                assert_true(clock_runs_mrad(r.error.rms_steps) < asked_mrad);
            }
            tape_free(t);
        }
        print(cases[k].name, "on line", &sums[0]);
        print("", "off line", &sums[1]);
    }
    for (int i = 0; i < 2; i++) {
        print("all", i ? "off line" : "on line", &all[i]);
        double share = all[i].ones / (double)all[i].moving;
        assert_true(share > share_low && share < share_high);
        assert_true((double)all[i].placed > 0.95 * (double)all[i].samples);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_simulated_cart_keeps_what_is_asked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
