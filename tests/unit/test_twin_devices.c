/* The twin behind the ops of a cart's devices: a scan and a photograph as capture would do them,
 * in virtual and in real time; what ends a world ends every device. */
#include "twin/twin_devices.h"

#include "base/clock.h"
#include "base/head_packet.h"
#include "twin/twin_drive.h"

#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* What the sinks of a cart's devices were given. */
struct tape {
    uint8_t bytes[1 << 20];
    size_t size, transfers, multiple;
    int64_t last_ns;
    struct edge_record edge[256];
    size_t edges;
    uint64_t shots;
};

static void take_bytes(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns) {
    struct tape *t = ctx;
    assert_true(t->size + size <= sizeof t->bytes);
    memcpy(t->bytes + t->size, bytes, size);
    t->size += size;
    t->transfers++;
    t->multiple += size > HEAD_PACKET_MAX_BYTES;
    t->last_ns = t_host_ns;
}

static void take_edge(void *ctx, const struct edge_record *edge) {
    struct tape *t = ctx;
    assert_true(t->edges < 256);
    t->edge[t->edges++] = *edge;
}

static void take_shot(void *ctx, const struct cart_shot *shot) {
    (void)shot;
    struct tape *t = ctx;
    t->shots++;
}

/* A world with its devices and what came from them. */
struct world {
    struct scene *scene;
    struct twin_config config;
    struct faults faults;
    struct twin_devices *twin;
    struct cart_devices cart;
    struct tape *tape;
    struct errctx err;
};

static struct world *open_world(const char *fault, bool real_time) {
    struct world *w = calloc(1, sizeof *w);
    assert_non_null(w);
    w->tape = calloc(1, sizeof *w->tape);
    assert_non_null(w->tape);
    assert_int_equal(scene_create("sphere", 1, 0.2, &w->scene, &w->err), ST_OK);
    w->config = twin_config_default();
    w->config.value[TWIN_CONFIG_SAMPLE_RATE].real = 5000;
    w->config.value[TWIN_CONFIG_MIRROR_SPIN_UP].real = 0.05;
    w->config.value[TWIN_CONFIG_CAMERA_WIDTH].real = 32;
    w->config.value[TWIN_CONFIG_CAMERA_HEIGHT].real = 48;
    w->config.value[TWIN_CONFIG_CAMERA_SAMPLES].real = 1;
    if (fault)
        assert_int_equal(faults_parse(&w->faults, fault, &w->err), ST_OK);
    struct twin_devices_spec spec = {.scene = w->scene,
                                     .config = &w->config,
                                     .faults = &w->faults,
                                     .world_from_station = {mat3_identity(), {0.1, 0.2, 1.6}},
                                     .seed = 3,
                                     .real_time = real_time,
                                     .shot = take_shot,
                                     .shot_ctx = w->tape};
    assert_int_equal(twin_devices_open(&spec, &w->twin, &w->err), ST_OK);
    w->cart = twin_devices_cart(w->twin);
    return w;
}

static void close_world(struct world *w) {
    twin_devices_close(w->twin);
    scene_destroy(w->scene);
    free(w->tape);
    free(w);
}

/* Lets time pass as capture's loop does: wait, pump head and lines. */
static enum st pass(struct world *w, double seconds) {
    struct head_sink head = {w->tape, take_bytes};
    struct lines_sink lines = {w->tape, take_edge};
    int64_t end_ns = hosttime_now_ns(w->cart.hosttime) + (int64_t)(seconds * 1e9);
    enum st st = ST_OK;
    while (!st && hosttime_now_ns(w->cart.hosttime) < end_ns) {
        int64_t next_ns = hosttime_now_ns(w->cart.hosttime) + 10000000;
        st = hosttime_wait_until(w->cart.hosttime, next_ns, &w->err);
        if (!st)
            st = w->cart.head->ops->pump(w->cart.head, 0, &head, &w->err);
        if (!st)
            st = w->cart.lines->ops->pump(w->cart.lines, 0, &lines, &w->err);
    }
    return st;
}

static struct motor_status status_of(struct world *w) {
    struct motor_status status;
    assert_int_equal(w->cart.motor->ops->status(w->cart.motor, &status, &w->err), ST_OK);
    return status;
}

/* Motors on and homed, mirror turning, laser on, head sending. */
static void make_ready(struct world *w) {
    const struct motor_ops *ops = w->cart.motor->ops;
    assert_int_equal(ops->enable(w->cart.motor, true, &w->err), ST_OK);
    assert_int_equal(ops->host_timeout(w->cart.motor, 3000, &w->err), ST_OK);
    assert_int_equal(ops->home(w->cart.motor, MOTOR_PAN, &w->err), ST_OK);
    assert_int_equal(ops->mirror(w->cart.motor, 4, &w->err), ST_OK);
    struct motor_status status = status_of(w);
    for (int i = 0; i < 200 && !(status.axis[MOTOR_PAN].homed && !status.axis[MOTOR_PAN].homing &&
                                 status.mirror_in_range);
         i++) {
        assert_int_equal(pass(w, 0.05), ST_OK);
        status = status_of(w);
    }
    assert_true(status.axis[MOTOR_PAN].homed && status.mirror_in_range);
    assert_int_equal(ops->laser(w->cart.motor, true, &w->err), ST_OK);
    assert_int_equal(w->cart.head->ops->start(w->cart.head, &w->err), ST_OK);
}

/* A short sweep; returns with everything fetched. */
static void sweep(struct world *w, double seconds) {
    const struct motor_ops *ops = w->cart.motor->ops;
    int32_t here = status_of(w).axis[MOTOR_PAN].steps;
    struct motor_scan scan = {.from_steps = here, .to_steps = here + 2000, .rate = 100};
    assert_int_equal(ops->scan_program(w->cart.motor, &scan, &w->err), ST_OK);
    assert_int_equal(ops->scan_run(w->cart.motor, true, &w->err), ST_OK);
    assert_int_equal(pass(w, seconds), ST_OK);
    assert_int_equal(status_of(w).scan_state, 2);
    assert_int_equal(ops->scan_run(w->cart.motor, false, &w->err), ST_OK);
    struct head_sink head = {w->tape, take_bytes};
    assert_int_equal(w->cart.head->ops->stop(w->cart.head, &head, &w->err), ST_OK);
}

/* Samples with a range in the tape; nothing may be missing or damaged. */
static size_t returns_of(const struct tape *t) {
    struct head_stream_stats stats = {0};
    struct head_packet p;
    size_t offset = 0, returns = 0;
    uint32_t next = 0;
    for (bool first = true; head_stream_next(t->bytes, t->size, &offset, &p, &stats) == ST_OK;
         first = false) {
        assert_true(first || p.packet_seq == next);
        next = p.packet_seq + 1;
        for (unsigned i = 0; i < p.sample_count; i++)
            returns += p.samples[i].range != HEAD_RANGE_NONE;
    }
    assert_int_equal(stats.bytes_skipped + stats.damaged, 0);
    return returns;
}

static void a_sweep_in_virtual_time_comes_through_the_devices_whole(void **state) {
    (void)state;
    struct world *w = open_world(NULL, false);
    make_ready(w);
    sweep(w, 1.0);
    assert_true(returns_of(w->tape) > 3000);
    assert_true(w->tape->multiple > 10); /* transfers of several packets, as libusb gives them */
    assert_true(w->tape->last_ns <= hosttime_now_ns(w->cart.hosttime));
    struct head_stats stats;
    w->cart.head->ops->stats(w->cart.head, &stats);
    assert_int_equal(stats.bytes, w->tape->size);
    assert_int_equal(stats.transfers, w->tape->transfers);
    close_world(w);
}

static void index_edges_and_events_are_the_same_pulses(void **state) {
    (void)state;
    struct world *w = open_world(NULL, false);
    make_ready(w);
    sweep(w, 1.5);
    struct index_event event[8];
    size_t count = 0;
    uint64_t lost = 0;
    assert_int_equal(
        w->cart.motor->ops->read_events(w->cart.motor, 0, event, 8, &count, &lost, &w->err), ST_OK);
    assert_true(count >= 5 && w->tape->edges >= count && !lost);
    for (size_t i = 1; i < count; i++) { /* two clocks, one mirror */
        double edge_s = (double)(w->tape->edge[i].t_ns - w->tape->edge[i - 1].t_ns) * 1e-9;
        double event_s = (double)(event[i].t_ns - event[i - 1].t_ns) * 1e-9;
        assert_int_equal(w->tape->edge[i].line, EDGE_RECORD_INDEX);
        assert_true(fabs(edge_s - event_s) < 0.002);
    }
    close_world(w);
}

static void the_same_calls_give_the_same_bytes(void **state) {
    (void)state;
    struct tape *first = NULL;
    for (int turn = 0; turn < 2; turn++) {
        struct world *w = open_world(NULL, false);
        make_ready(w);
        sweep(w, 0.4);
        if (turn) {
            assert_int_equal(first->size, w->tape->size);
            assert_memory_equal(first->bytes, w->tape->bytes, first->size);
            assert_int_equal(first->edges, w->tape->edges);
            assert_memory_equal(first->edge, w->tape->edge, first->edges * sizeof first->edge[0]);
            free(first);
        } else {
            first = w->tape;
            w->tape = NULL;
        }
        close_world(w);
    }
}

/* Triggers once and fetches the frame. */
static enum st photograph(struct world *w, struct camera_frame *out_frame) {
    int64_t before_ns = hosttime_now_ns(w->cart.hosttime);
    assert_int_equal(w->cart.motor->ops->trigger(w->cart.motor, &w->err), ST_OK);
    return w->cart.camera->ops->frame(w->cart.camera, before_ns, 500, out_frame, &w->err);
}

static void a_trigger_gives_a_strobe_and_a_frame(void **state) {
    (void)state;
    struct world *w = open_world(NULL, false);
    struct camera_settings settings = {.exposure_s = 0.125, .gain = 1};
    struct camera_device_ops const *camera = w->cart.camera->ops;
    assert_int_equal(camera->configure(w->cart.camera, &settings, &w->err), ST_OK);
    assert_int_equal(settings.width_px, 32);
    assert_int_equal(camera->start(w->cart.camera, &w->err), ST_OK);
    make_ready(w);
    struct camera_frame frame;
    for (uint32_t i = 0; i < 2; i++) {
        assert_int_equal(photograph(w, &frame), ST_OK);
        assert_int_equal(frame.seq, i);
        assert_int_equal(frame.format, CAMERA_FORMAT_JPEG);
        assert_true(frame.size > 200 && frame.bytes[0] == 0xff && frame.bytes[1] == 0xd8);
        assert_true(frame.settings_held);
        assert_int_equal(pass(w, 0.02), ST_OK);
        const struct edge_record *strobe = &w->tape->edge[w->tape->edges - 1];
        for (size_t k = 0; k < w->tape->edges; k++)
            strobe = w->tape->edge[k].line == EDGE_RECORD_STROBE ? &w->tape->edge[k] : strobe;
        assert_int_equal(strobe->t_ns, frame.t_ns);
        assert_int_equal(strobe->seq, i);
    }
    enum st st = camera->frame(w->cart.camera, frame.t_ns + 1, 100, &frame, &w->err);
    assert_int_equal(st, ST_TIMEOUT); /* nobody triggered */
    close_world(w);
}

static void camera_faults_drop_one_frame_and_expose_another_late(void **state) {
    (void)state;
    struct world *w = open_world("frame_dropped@0+1000", false);
    struct camera_frame frame;
    assert_int_equal(w->cart.camera->ops->start(w->cart.camera, &w->err), ST_OK);
    make_ready(w);
    assert_int_equal(photograph(w, &frame), ST_TIMEOUT);
    close_world(w);
    w = open_world("exposure_late@0+1000=3", false);
    assert_int_equal(w->cart.camera->ops->start(w->cart.camera, &w->err), ST_OK);
    make_ready(w);
    assert_int_equal(photograph(w, &frame), ST_OK);
    assert_true(frame.settings_held);
    assert_int_equal(photograph(w, &frame), ST_OK);
    assert_true(!frame.settings_held && fabs(frame.exposure_s - 3.0 / 8) < 1e-9);
    close_world(w);
}

static void emergency_stop_opens_its_chain_and_stops_the_controller(void **state) {
    (void)state;
    struct world *w = open_world("estop@0.5+0.3", false);
    struct lines_levels levels;
    assert_int_equal(w->cart.lines->ops->levels(w->cart.lines, &levels, &w->err), ST_OK);
    assert_true(levels.high & 1u << EDGE_RECORD_ESTOP);
    assert_int_equal(w->cart.motor->ops->enable(w->cart.motor, true, &w->err), ST_OK);
    assert_int_equal(pass(w, 0.7), ST_OK);
    struct motor_status status = status_of(w);
    assert_int_equal(status.state, 3);
    assert_false(status.motors_on);
    assert_int_equal(w->cart.lines->ops->levels(w->cart.lines, &levels, &w->err), ST_OK);
    assert_false(levels.high & 1u << EDGE_RECORD_ESTOP);
    assert_int_equal(pass(w, 0.4), ST_OK);
    assert_int_equal(w->tape->edges, 2);
    assert_int_equal(w->tape->edge[0].line, EDGE_RECORD_ESTOP);
    assert_int_equal(w->tape->edge[0].rising, 0);
    assert_int_equal(w->tape->edge[1].rising, 1);
    assert_int_equal(w->cart.motor->ops->clear_fault(w->cart.motor, status.fault, &w->err), ST_OK);
    close_world(w);
}

static void silence_and_noise_on_the_line_reach_the_motor(void **state) {
    (void)state;
    struct world *w = open_world("modbus_silence@0.2+1", false);
    assert_int_equal(pass(w, 0.3), ST_OK);
    struct motor_status status;
    assert_int_equal(w->cart.motor->ops->status(w->cart.motor, &status, &w->err), ST_TIMEOUT);
    assert_int_equal(pass(w, 1.0), ST_OK);
    status = status_of(w);
    assert_true(llabs(status.t_ns - hosttime_now_ns(w->cart.hosttime)) < 1000000);
    close_world(w);
    w = open_world("modbus_noise@0+1000=0.02", false);
    unsigned bad = 0;
    for (int i = 0; i < 20; i++)
        if (!w->cart.motor->ops->status(w->cart.motor, &status, &w->err))
            bad = status.frames_bad;
    assert_true(bad > 0); /* repeated, and borne */
    close_world(w);
}

static void disk_full_is_on_for_its_time(void **state) {
    (void)state;
    struct world *w = open_world("disk_full@0.2+0.3", false);
    assert_false(w->cart.disk_full(w->cart.ctx));
    assert_int_equal(pass(w, 0.3), ST_OK);
    assert_true(w->cart.disk_full(w->cart.ctx));
    assert_int_equal(pass(w, 0.3), ST_OK);
    assert_false(w->cart.disk_full(w->cart.ctx));
    close_world(w);
}

static void expect_end(struct world *w) {
    struct motor_status status;
    struct lines_levels levels;
    struct camera_frame frame;
    struct head_identity head;
    struct head_sink bytes = {w->tape, take_bytes};
    struct lines_sink edges = {w->tape, take_edge};
    const struct hosttime *time = w->cart.hosttime;
    int64_t later_ns = hosttime_now_ns(time) + 1000000;
    assert_int_equal(hosttime_wait_until(time, later_ns, &w->err), ST_CANCELLED);
    assert_int_equal(w->cart.motor->ops->status(w->cart.motor, &status, &w->err), ST_CANCELLED);
    assert_int_equal(w->cart.head->ops->pump(w->cart.head, 5, &bytes, &w->err), ST_CANCELLED);
    assert_int_equal(w->cart.head->ops->identify(w->cart.head, &head, &w->err), ST_CANCELLED);
    assert_int_equal(w->cart.lines->ops->pump(w->cart.lines, 5, &edges, &w->err), ST_CANCELLED);
    assert_int_equal(w->cart.lines->ops->levels(w->cart.lines, &levels, &w->err), ST_CANCELLED);
    assert_int_equal(w->cart.camera->ops->frame(w->cart.camera, 0, 5, &frame, &w->err),
                     ST_CANCELLED);
    assert_non_null(strstr(w->err.text, "lost power"));
}

static void power_loss_ends_every_device(void **state) {
    (void)state;
    struct world *w = open_world("power_loss@0.4", false);
    assert_int_equal(pass(w, 0.3), ST_OK);
    assert_int_equal(pass(w, 0.3), ST_CANCELLED);
    expect_end(w);
    close_world(w);
    w = open_world("power_loss@0.15", true);
    while (!pass(w, 0.02)) {
    }
    expect_end(w);
    close_world(w);
}

/* ---- real time: each device from its own thread, as capture does ---- */

struct reader {
    struct world *w;
    bool done; /* set by the main thread, under the lock */
    pthread_mutex_t lock;
};

static bool is_done(struct reader *r) {
    (void)pthread_mutex_lock(&r->lock);
    bool done = r->done;
    (void)pthread_mutex_unlock(&r->lock);
    return done;
}

static void *read_head(void *ctx) {
    struct reader *r = ctx;
    struct head_sink sink = {r->w->tape, take_bytes};
    struct errctx err = {0};
    while (!is_done(r))
        if (r->w->cart.head->ops->pump(r->w->cart.head, 20, &sink, &err))
            break;
    return NULL;
}

static void *read_lines(void *ctx) {
    struct reader *r = ctx;
    struct lines_sink sink = {r->w->tape, take_edge};
    struct errctx err = {0};
    while (!is_done(r))
        if (r->w->cart.lines->ops->pump(r->w->cart.lines, 20, &sink, &err))
            break;
    return NULL;
}

static void real_time_follows_the_hosts_clock_with_a_thread_for_each_device(void **state) {
    (void)state;
    struct world *w = open_world(NULL, true);
    struct reader r = {.w = w, .lock = PTHREAD_MUTEX_INITIALIZER};
    pthread_t head, lines;
    int64_t start_ns = clock_now_ns();
    assert_int_equal(w->cart.head->ops->start(w->cart.head, &w->err), ST_OK);
    assert_int_equal(pthread_create(&head, NULL, read_head, &r), 0);
    assert_int_equal(pthread_create(&lines, NULL, read_lines, &r), 0);
    assert_int_equal(w->cart.motor->ops->enable(w->cart.motor, true, &w->err), ST_OK);
    assert_int_equal(w->cart.motor->ops->mirror(w->cart.motor, 4, &w->err), ST_OK);
    int64_t until_ns = start_ns + 700000000;
    struct motor_status status = status_of(w);
    while (clock_now_ns() < until_ns) {
        status = status_of(w); /* a request takes its time */
        assert_true(llabs(clock_now_ns() - status.t_ns) < 500000000);
    }
    (void)pthread_mutex_lock(&r.lock);
    r.done = true;
    (void)pthread_mutex_unlock(&r.lock);
    (void)pthread_join(head, NULL);
    (void)pthread_join(lines, NULL);
    double took_s = (double)(clock_now_ns() - start_ns) * 1e-9;
    /* three quarters of each turn are sent; the mirror starts from rest */
    double samples = (double)w->tape->size / 15.1;
    assert_true(samples > 0.25 * 5000 * (took_s - 0.2) && samples < 1.1 * 5000 * took_s);
    assert_true(w->tape->edges >= 1);
    assert_true(w->tape->last_ns > start_ns && w->tape->last_ns <= clock_now_ns());
    assert_true(status.motors_on);
    close_world(w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sweep_in_virtual_time_comes_through_the_devices_whole),
        cmocka_unit_test(index_edges_and_events_are_the_same_pulses),
        cmocka_unit_test(the_same_calls_give_the_same_bytes),
        cmocka_unit_test(a_trigger_gives_a_strobe_and_a_frame),
        cmocka_unit_test(camera_faults_drop_one_frame_and_expose_another_late),
        cmocka_unit_test(emergency_stop_opens_its_chain_and_stops_the_controller),
        cmocka_unit_test(silence_and_noise_on_the_line_reach_the_motor),
        cmocka_unit_test(disk_full_is_on_for_its_time),
        cmocka_unit_test(power_loss_ends_every_device),
        cmocka_unit_test(real_time_follows_the_hosts_clock_with_a_thread_for_each_device),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
