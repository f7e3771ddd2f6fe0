/* The simulated cart: with everything switched off its samples are exact; what it sends is well
 * formed; every fault shows where it should. */
#include "base/sweep.h"
#include "twin/cart.h"
#include "twin/twin_drive.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static const double pi = 3.14159265358979323846;
/* What the brief promises: a sample reconstructed by the rig model lies on its surface. */
static const double on_surface_m = 1e-6;

/* When the tape begins, true time: by then the cart is homed, its mirror turns, its laser is on.
 * Times on the tape and of faults count from there. */
static const int64_t tape_ns = 5000000000;

/* Everything a cart sends, kept. */
struct tape {
    bool on;
    struct cart_shot shot[20000];
    size_t shots;
    struct idxevent event[64];
    size_t events;
    struct cart_edge edge[64];
    size_t edges;
    uint8_t bytes[1 << 19];
    size_t size;
    int64_t arrival_ns[2000];
    size_t packets;
};

static enum st keep_packet(void *ctx, const struct cart_packet *packet, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    if (!t->on)
        return ST_OK;
    assert_true(t->size + packet->size <= sizeof t->bytes && t->packets < 2000);
    memcpy(t->bytes + t->size, packet->bytes, packet->size);
    t->size += packet->size;
    t->arrival_ns[t->packets++] = packet->t_host_ns;
    return ST_OK;
}

static enum st keep_index(void *ctx, const struct idxevent *event, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    assert_true(t->events < 64);
    if (t->on)
        t->event[t->events++] = *event;
    return ST_OK;
}

static enum st keep_edge(void *ctx, const struct cart_edge *edge, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    assert_true(t->edges < 64);
    if (t->on)
        t->edge[t->edges++] = *edge;
    return ST_OK;
}

static enum st keep_shot(void *ctx, const struct cart_shot *shot, struct errctx *err) {
    (void)err;
    struct tape *t = ctx;
    assert_true(t->shots < 20000);
    if (t->on) {
        t->shot[t->shots] = *shot;
        t->shot[t->shots++].t_ns -= tape_ns;
    }
    return ST_OK;
}

static struct pose stand(void) {
    struct pose world_from_station = {so3_exp(vec3_make(0.01, -0.02, 0.6)), {0.3, -0.2, 1.6}};
    return world_from_station;
}

/* Homes the cart, brings the mirror up, switches the laser on. */
static void make_ready(struct twin_drive *drive, bool laser) {
    struct errctx err = {0};
    assert_int_equal(twin_drive_open(drive, &err), ST_OK);
    const struct motor_ops *ops = drive->motor->ops;
    assert_int_equal(ops->mirror(drive->motor, drive->mirror_rps, &err), ST_OK);
    while (!drive->status.mirror_in_range)
        assert_int_equal(twin_drive_wait(drive, 0.1, &err), ST_OK);
    assert_int_equal(ops->laser(drive->motor, laser, &err), ST_OK);
}

/* Runs a cart in a scene for `run_s` after it has been made ready, panning at 300 steps/s from 0.1
 * s before on. */
static struct tape *record(const char *scene_name, const struct twin_config *config,
                           const char *const *fault_texts, uint64_t seed, double run_s) {
    struct errctx err = {0};
    struct scene *scene = NULL;
    assert_int_equal(scene_create(scene_name, 7, 0.2, &scene, &err), ST_OK);
    struct faults faults = {.count = 0};
    for (size_t i = 0; fault_texts && fault_texts[i]; i++) {
        assert_int_equal(faults_parse(&faults, fault_texts[i], &err), ST_OK);
        faults.list[i].start_ns += tape_ns;
    }
    struct tape *tape = calloc(1, sizeof *tape);
    assert_non_null(tape);
    struct cart_sink sink = {tape, keep_packet, keep_index, keep_edge, keep_shot};
    struct pose pose = stand();
    struct cart *cart = NULL;
    assert_int_equal(cart_create(scene, config, &faults, &pose, seed, &sink, &cart, &err), ST_OK);
    struct twin_drive drive = {.cart = cart,
                               .mirror_rps = twin_config_real(config, TWIN_CONFIG_MIRROR_HZ)};
    make_ready(&drive, true);
    const struct motor_ops *ops = drive.motor->ops;
    int32_t here = drive.status.axis[MOTOR_PAN].steps;
    struct motor_scan sweep = {.from_steps = here, .to_steps = 13900, .rate = 300};
    assert_int_equal(ops->host_timeout(drive.motor, 5000, &err), ST_OK);
    assert_int_equal(ops->scan_program(drive.motor, &sweep, &err), ST_OK);
    assert_true(cart_time_ns(cart) < tape_ns - 200000000);
    assert_int_equal(cart_advance(cart, tape_ns - 100000000, &err), ST_OK);
    assert_int_equal(ops->scan_run(drive.motor, true, &err), ST_OK);
    assert_int_equal(cart_advance(cart, tape_ns, &err), ST_OK);
    tape->on = true;
    enum st st = cart_advance(cart, tape_ns + (int64_t)(run_s * 1e9), &err);
    assert_true(st == ST_OK || st == ST_CANCELLED);
    twin_drive_close(&drive);
    cart_destroy(cart);
    scene_destroy(scene);
    return tape;
}

/* A fast, sparse cart for tests: 5 kHz, quick spin-up. */
static struct twin_config quick(struct twin_config config) {
    config.value[TWIN_CONFIG_SAMPLE_RATE].real = 5000;
    config.value[TWIN_CONFIG_MIRROR_SPIN_UP].real = 0.05;
    return config;
}

static struct vec3 reconstruct(const struct rig *rig, const struct cart_shot *s) {
    struct pose pose = stand();
    double theta = rig_mirror_angle(rig, s->counts);
    return pose_apply(&pose,
                      rig_point(rig, theta, s->state.tilt_rad, s->state.pan_rad, s->range_m));
}

static void ideal_samples_lie_on_a_sphere_within_1_um(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_ideal());
    struct rig rig = twin_config_rig(&config, false);
    struct tape *tape = record("sphere", &config, NULL, 1, 0.8);
    assert_true(tape->shots > 2000);
    for (size_t i = 0; i < tape->shots; i++) {
        struct vec3 p = reconstruct(&rig, &tape->shot[i]);
        double off_m = vec3_norm(vec3_sub(p, vec3_make(0, 0, 1.6))) - 5;
        assert_true(fabs(off_m) < on_surface_m);
    }
    free(tape);
}

static void ideal_samples_lie_on_the_walls_of_the_room_within_1_um(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_ideal());
    struct rig rig = twin_config_rig(&config, false);
    struct tape *tape = record("room", &config, NULL, 1, 0.8);
    size_t on_shell = 0;
    for (size_t i = 0; i < tape->shots; i++) {
        const struct cart_shot *s = &tape->shot[i];
        if (s->echo.part > 3) /* the first four parts are floor, ceiling and the walls */
            continue;
        struct vec3 p = reconstruct(&rig, s);
        double x = fabs(fabs(p.x) - 3), y = fabs(fabs(p.y) - 2.5);
        double z = fmin(fabs(p.z), fabs(p.z - (double)2.8f)); /* corners are float */
        assert_true(fmin(fmin(x, y), z) < on_surface_m);
        on_shell++;
    }
    assert_true(on_shell > 1000);
    free(tape);
}

static void
misaligned_samples_lie_on_the_surface_with_the_true_rig_and_off_it_with_the_nominal(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_ideal()), real = twin_config_default();
    for (int i = TWIN_CONFIG_MIRROR_ANGLE; i <= TWIN_CONFIG_TILT_ZERO; i++)
        config.value[i].real = real.value[i].real;
    struct rig truth = twin_config_rig(&config, true), nominal = twin_config_rig(&config, false);
    struct tape *tape = record("sphere", &config, NULL, 1, 0.6);
    double sum = 0;
    for (size_t i = 0; i < tape->shots; i++) {
        struct vec3 c = vec3_make(0, 0, 1.6), p = reconstruct(&truth, &tape->shot[i]);
        assert_true(fabs(vec3_norm(vec3_sub(p, c)) - 5) < on_surface_m);
        struct vec3 q = reconstruct(&nominal, &tape->shot[i]);
        sum += vec3_norm(vec3_sub(p, q));
    }
    assert_true(sum / (double)tape->shots > 0.02);
    free(tape);
}

static void packets_carry_every_sample_once_and_in_order(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_default());
    struct tape *tape = record("room", &config, NULL, 3, 1.0);
    struct head_stream_stats stats = {0};
    struct head_packet p;
    size_t offset = 0, n = 0;
    uint32_t next_packet = 0;
    while (head_stream_next(tape->bytes, tape->size, &offset, &p, &stats) == ST_OK) {
        next_packet = n ? next_packet : p.packet_seq;
        assert_int_equal(p.packet_seq, next_packet++);
        for (unsigned i = 0; i < p.sample_count; i++) {
            const struct cart_shot *s = &tape->shot[n];
            if (!n && p.first_sample_seq + i < s->seq) /* the tape begins within a packet */
                continue;
            n++;
            assert_int_equal(p.first_sample_seq + i, s->seq);
            assert_int_equal(p.samples[i].flags & 0x0f, s->reading.flags);
            if (isnan(s->range_m))
                assert_int_equal(p.samples[i].range, HEAD_RANGE_NONE);
            else
                assert_true(fabs(head_range_m(p.samples[i].range) - s->range_m) < on_surface_m);
        }
    }
    assert_int_equal(stats.bytes_skipped, 0);
    assert_true(n + HEAD_PACKET_MAX_SAMPLES >= tape->shots && n > 2000);
    for (size_t i = 1; i < tape->packets; i++)
        assert_true(tape->arrival_ns[i] > tape->arrival_ns[i - 1] - 2000000);
    free(tape);
}

static void index_events_follow_the_mirror_and_count_pan_steps(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_default());
    struct tape *tape = record("room", &config, NULL, 3, 1.6);
    assert_true(tape->events >= 5);
    assert_int_equal(tape->events, tape->edges);
    for (size_t i = 1; i < tape->events; i++) {
        const struct idxevent *a = &tape->event[i - 1], *b = &tape->event[i];
        assert_int_equal(b->seq, a->seq + 1);
        assert_int_equal(b->revolution, a->revolution + 1);
        assert_true(tape->edge[i].t_host_ns > tape->edge[i - 1].t_host_ns);
        if (i < 3) /* spinning up, pan accelerating */
            continue;
        double dt = (double)(b->time_us - a->time_us) * 1e-6;
        double steps =
            b->pan_steps + b->pan_phase / 65536.0 - a->pan_steps - a->pan_phase / 65536.0;
        assert_true(fabs(dt - 0.25) < 0.01);
        assert_true(fabs(steps - 300 * dt) < 0.1);
    }
    free(tape);
}

static void same_seed_gives_same_bytes_and_another_seed_others(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_default());
    struct tape *a = record("room", &config, NULL, 3, 0.4),
                *b = record("room", &config, NULL, 3, 0.4);
    struct tape *c = record("room", &config, NULL, 4, 0.4);
    assert_int_equal(a->size, b->size);
    assert_memory_equal(a->bytes, b->bytes, a->size);
    assert_true(a->size != c->size || memcmp(a->bytes, c->bytes, a->size));
    free(a);
    free(b);
    free(c);
}

/* Packets that decode, their sequence numbers, and what was skipped. */
struct summary {
    uint32_t seq[2000];
    size_t packets, repeats, gaps, backwards, resets;
    uint64_t skipped;
};

static struct summary summarise(const struct tape *tape) {
    struct summary s = {.packets = 0};
    struct head_stream_stats stats = {0};
    struct head_packet p;
    size_t offset = 0;
    while (head_stream_next(tape->bytes, tape->size, &offset, &p, &stats) == ST_OK) {
        if (s.packets && !(p.flags & HEAD_PACKET_RESET)) {
            uint32_t before = s.seq[s.packets - 1];
            s.repeats += p.packet_seq == before;
            s.gaps += p.packet_seq > before + 1;
            s.backwards += p.packet_seq < before;
        }
        s.resets += s.packets && (p.flags & HEAD_PACKET_RESET);
        s.seq[s.packets++] = p.packet_seq;
    }
    s.skipped = stats.bytes_skipped;
    return s;
}

static struct tape *with_fault(const char *fault, double run_s) {
    struct twin_config config = quick(twin_config_default());
    const char *faults[] = {fault, NULL};
    return record("sphere", &config, faults, 3, run_s);
}

static void packet_faults_show_in_the_stream(void **state) {
    (void)state;
    struct tape *t = with_fault("packet_lost@0.5=3", 0.8);
    struct summary s = summarise(t);
    assert_int_equal(s.gaps, 1);
    assert_int_equal(s.repeats + s.backwards + s.resets, 0);
    free(t);
    t = with_fault("packet_repeated@0.5", 0.8);
    s = summarise(t);
    assert_int_equal(s.repeats, 1);
    assert_int_equal(s.gaps, 0);
    free(t);
    t = with_fault("packet_sequence@0.5=100", 0.8);
    s = summarise(t);
    assert_int_equal(s.gaps, 1);
    assert_int_equal(s.backwards, 1);
    free(t);
    t = with_fault("bit_error@0.5=2", 0.8);
    s = summarise(t);
    assert_int_equal(s.gaps, 1);
    assert_true(s.skipped > 0);
    free(t);
    t = with_fault("head_reset@0.5=0.1", 0.8);
    s = summarise(t);
    assert_int_equal(s.resets, 1);
    free(t);
}

static void missing_index_leaves_a_gap_that_the_controller_reports(void **state) {
    (void)state;
    struct tape *t = with_fault("index_missing@0.8", 1.6);
    size_t after = 0, jumps = 0;
    for (size_t i = 1; i < t->events; i++) {
        assert_int_equal(t->event[i].seq, t->event[i - 1].seq + 1);
        jumps += t->event[i].revolution == t->event[i - 1].revolution + 2;
        after += (t->event[i].flags & IDXEVENT_AFTER_MISSED) != 0;
    }
    assert_int_equal(jumps, 1);
    assert_int_equal(after, 1);
    free(t);
}

/* Mean speed of the mirror between two true times, Hz. */
static double speed_hz(const struct tape *t, double from_s, double to_s) {
    const struct cart_shot *a = NULL, *b = NULL;
    for (size_t i = 0; i < t->shots; i++) {
        double at_s = (double)t->shot[i].t_ns * 1e-9;
        a = at_s >= from_s && !a ? &t->shot[i] : a;
        b = at_s <= to_s ? &t->shot[i] : b;
    }
    return (b->state.mirror_rad - a->state.mirror_rad) / (2 * pi) /
           ((double)(b->t_ns - a->t_ns) * 1e-9);
}

static void mirror_faults_change_its_speed(void **state) {
    (void)state;
    struct tape *t = with_fault("mirror_surge@0.8+0.4=1.5", 2.4);
    assert_true(fabs(speed_hz(t, 0.5, 0.78) - 4) < 0.1);
    assert_true(speed_hz(t, 0.85, 0.95) > 4.5); /* then the controller takes it back */
    assert_true(fabs(speed_hz(t, 2.0, 2.39) - 4) < 0.2);
    free(t);
}

static void blocked_mirror_stands_and_the_controller_switches_the_laser_off(void **state) {
    (void)state;
    struct tape *t = with_fault("mirror_stall@0.6+0.6", 1.0);
    for (size_t i = 0; i < t->shots; i++) {
        const struct cart_shot *s = &t->shot[i];
        if (s->t_ns < 590000000)
            assert_true(s->state.laser && s->state.mirror_rad_s > 24);
        if (s->t_ns > 700000000) { /* it does not wait for the next index pulse */
            assert_true(s->state.mirror_rad_s < 0.001 && !s->state.laser);
            assert_int_equal(s->reading.flags, HEAD_SAMPLE_LASER_OFF);
        }
    }
    free(t);
}

static void pan_faults_part_the_head_from_the_counted_steps(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_default());
    double a_step = 2 * pi / config.value[TWIN_CONFIG_PAN_STEPS].real;
    struct tape *healthy = with_fault("light_change@0", 1.0);
    struct mechanics_state h = healthy->shot[healthy->shots - 1].state;
    struct tape *t = with_fault("missed_steps@0.5=7", 1.0);
    struct mechanics_state s = t->shot[t->shots - 1].state;
    assert_true(fabs(s.pan_motor_steps - h.pan_motor_steps) < 1e-9);
    assert_true(fabs(h.pan_rad - s.pan_rad - 7 * a_step) < 1e-9);
    free(t);
    t = with_fault("pan_stall@0.5+0.2", 1.0);
    s = t->shot[t->shots - 1].state;
    assert_true(fabs(h.pan_rad - s.pan_rad - 60 * a_step) < a_step);
    free(t);
    free(healthy);
}

static void encoder_slip_shifts_the_counts(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_ideal());
    const char *faults[] = {"encoder_slip@0.5=5", NULL};
    struct rig rig = twin_config_rig(&config, true);
    struct tape *t = record("sphere", &config, faults, 3, 0.8);
    double first = t->shot[0].counts - rig_encoder_counts(&rig, t->shot[0].state.mirror_rad);
    const struct cart_shot *last = &t->shot[t->shots - 1];
    assert_true(fabs(first) < 1e-6);
    assert_true(fabs(last->counts - rig_encoder_counts(&rig, last->state.mirror_rad) - 5) < 1e-6);
    free(t);
}

static void clock_jump_moves_the_host_alone(void **state) {
    (void)state;
    struct tape *a = with_fault("light_change@0", 1.2), *b = with_fault("clock_jump@0.8=0.25", 1.2);
    assert_int_equal(a->events, b->events);
    size_t n = a->events - 1;
    assert_true(b->edge[0].t_host_ns == a->edge[0].t_host_ns);
    assert_true(b->edge[n].t_host_ns - a->edge[n].t_host_ns == 250000000);
    assert_true(b->event[n].time_us == a->event[n].time_us);
    free(a);
    free(b);
}

static void power_loss_ends_everything(void **state) {
    (void)state;
    struct tape *t = with_fault("power_loss@0.5", 1.0);
    assert_true(t->shots > 100);
    assert_true(t->shot[t->shots - 1].t_ns < 500000000);
    free(t);
}

static void laser_off_sends_samples_that_say_so(void **state) {
    (void)state;
    struct errctx err = {0};
    struct scene *scene = NULL;
    assert_int_equal(scene_create("sphere", 7, 0.2, &scene, &err), ST_OK);
    struct twin_config config = quick(twin_config_default());
    struct tape *tape = calloc(1, sizeof *tape);
    assert_non_null(tape);
    tape->on = true;
    struct cart_sink sink = {tape, keep_packet, keep_index, keep_edge, keep_shot};
    struct pose pose = stand();
    struct cart *cart = NULL;
    assert_int_equal(cart_create(scene, &config, NULL, &pose, 1, &sink, &cart, &err), ST_OK);
    assert_int_equal(cart_advance(cart, 500000000, &err), ST_OK);
    for (size_t i = 0; i < tape->shots; i++)
        assert_int_equal(tape->shot[i].reading.flags, HEAD_SAMPLE_LASER_OFF);
    assert_true(tape->shots > 100);
    cart_destroy(cart);
    scene_destroy(scene);
    free(tape);
}

/* Index events as a reader of the streams has them. */
static size_t index_of(const struct tape *t, struct sweep_index *out) {
    for (size_t i = 0; i < t->events; i++) {
        const struct idxevent *e = &t->event[i];
        struct sweep_index one = {.t_host_ns = t->edge[i].t_host_ns,
                                  .revolution = e->revolution,
                                  .pan_steps = e->pan_steps + e->pan_phase / 65536.0,
                                  .tilt_steps = e->tilt_steps,
                                  .pan_direction = e->flags & IDXEVENT_PAN_POSITIVE ? 1 : -1,
                                  .sweep = (e->flags & IDXEVENT_SWEEP) != 0};
        out[i] = one;
    }
    return t->events;
}

/* Largest distance of a point made from the streams to the echo it came from; counts what was
 * placed. */
static double worst_m(const struct tape *t, const struct twin_config *config, size_t *out_placed) {
    struct sweep_index index[64];
    struct sweep sweep;
    struct rig rig = twin_config_rig(config, true);
    struct pose pose = stand();
    struct head_stream_stats stats = {0};
    struct head_packet p;
    struct sweep_place place[HEAD_PACKET_MAX_SAMPLES];
    double worst = 0;
    size_t offset = 0, packet = 0;
    *out_placed = 0;
    sweep_init(&sweep, index, index_of(t, index));
    while (head_stream_next(t->bytes, t->size, &offset, &p, &stats) == ST_OK) {
        sweep_packet(&sweep, &p, t->arrival_ns[packet++], place);
        for (unsigned i = 0; i < p.sample_count; i++) {
            struct vec3 q = pose_apply(&pose, sweep_point(&rig, &place[i], &p.samples[i]));
            if (!vec3_is_finite(q))
                continue;
            size_t n = 0;
            while (n < t->shots && t->shot[n].seq != p.first_sample_seq + i)
                n++;
            const struct cart_shot *s = &t->shot[n];
            if (s->t_ns < 700000000) /* the pan's ramp is no straight line between two pulses */
                continue;
            struct vec3 truth = vec3_madd(s->beam.origin_m, s->beam.dir, s->echo.distance_m);
            worst = fmax(worst, vec3_norm(vec3_sub(q, truth)));
            ++*out_placed;
        }
    }
    return worst;
}

static void sweep_puts_recorded_samples_back_on_the_surface(void **state) {
    (void)state;
    struct twin_config config = quick(twin_config_ideal());
    config.value[TWIN_CONFIG_SAMPLE_RATE].real = 1000;
    size_t placed = 0, placed_missing = 0;
    struct tape *t = record("sphere", &config, NULL, 1, 2.2);
    assert_true(worst_m(t, &config, &placed) < 2e-5); /* a position is latched to 1/65536 step */
    assert_true(placed > 700);
    free(t);
    const char *faults[] = {"index_missing@1.2", NULL};
    t = record("sphere", &config, faults, 1, 2.2);
    assert_true(worst_m(t, &config, &placed_missing) <
                2e-5); /* bridged: the revolution is counted */
    assert_int_equal(placed, placed_missing);
    free(t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ideal_samples_lie_on_a_sphere_within_1_um),
        cmocka_unit_test(ideal_samples_lie_on_the_walls_of_the_room_within_1_um),
        cmocka_unit_test(
            misaligned_samples_lie_on_the_surface_with_the_true_rig_and_off_it_with_the_nominal),
        cmocka_unit_test(packets_carry_every_sample_once_and_in_order),
        cmocka_unit_test(index_events_follow_the_mirror_and_count_pan_steps),
        cmocka_unit_test(same_seed_gives_same_bytes_and_another_seed_others),
        cmocka_unit_test(packet_faults_show_in_the_stream),
        cmocka_unit_test(missing_index_leaves_a_gap_that_the_controller_reports),
        cmocka_unit_test(mirror_faults_change_its_speed),
        cmocka_unit_test(blocked_mirror_stands_and_the_controller_switches_the_laser_off),
        cmocka_unit_test(pan_faults_part_the_head_from_the_counted_steps),
        cmocka_unit_test(encoder_slip_shifts_the_counts),
        cmocka_unit_test(clock_jump_moves_the_host_alone),
        cmocka_unit_test(power_loss_ends_everything),
        cmocka_unit_test(laser_off_sends_samples_that_say_so),
        cmocka_unit_test(sweep_puts_recorded_samples_back_on_the_surface),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
