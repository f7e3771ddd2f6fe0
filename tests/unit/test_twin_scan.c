/* Whole scans by the twin into a site, with what may go wrong on the way: what the site then holds
 * is what a real cart's would, and says what is missing. */
#include "base/picture.h"
#include "site/files.h"
#include "site/frame_row.h"
#include "site/station.h"
#include "site/stream.h"
#include "twin/twin_compare.h"
#include "twin/twin_scan.h"

#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <omp.h>
#include <stdlib.h>
#include <string.h>

/* One scan: a degree of sweep, frames every 120 degrees. */
struct run {
    char dir[TEMPDIR_MAX], path[TEMPDIR_MAX + 32], truth[TEMPDIR_MAX + 32];
    struct scene *scene;
    struct site *site;
    struct faults faults;
    struct twin_config config;
    struct twin_scan_stand out[2];
    struct errctx err;
    enum st st;
};

static struct twin_config small(void) {
    struct twin_config config = twin_config_default();
    config.value[TWIN_CONFIG_PAN_FROM].real = 10;
    config.value[TWIN_CONFIG_PAN_TO].real = 11;
    config.value[TWIN_CONFIG_SAMPLE_RATE].real = 2000;
    config.value[TWIN_CONFIG_RAYS].real = 2;
    config.value[TWIN_CONFIG_MIRROR_SPIN_UP].real = 0.2;
    config.value[TWIN_CONFIG_CAMERA_WIDTH].real = 24;
    config.value[TWIN_CONFIG_CAMERA_HEIGHT].real = 36;
    config.value[TWIN_CONFIG_CAMERA_SAMPLES].real = 2;
    config.value[TWIN_CONFIG_CAMERA_STEP].real = 120;
    return config;
}

static struct run *scan(const char *scene, const char *const *fault_texts, bool frames,
                        const struct twin_config *config) {
    struct run *r = calloc(1, sizeof *r);
    assert_non_null(r);
    assert_true(tempdir_make(r->dir));
    (void)snprintf(r->path, sizeof r->path, "%s/site", r->dir);
    (void)snprintf(r->truth, sizeof r->truth, "%s/truth", r->dir);
    struct site_info info;
    memset(&info, 0, sizeof info);
    assert_int_equal(scene_create(scene, 1, 0.2, &r->scene, &r->err), ST_OK);
    assert_int_equal(site_create(r->path, &info, &r->site, &r->err), ST_OK);
    for (size_t i = 0; fault_texts && fault_texts[i]; i++)
        assert_int_equal(faults_parse(&r->faults, fault_texts[i], &r->err), ST_OK);
    r->config = config ? *config : small();
    struct twin_scan what = {.scene = r->scene,
                             .config = &r->config,
                             .faults = &r->faults,
                             .stands = r->scene->stand,
                             .stand_count = 1,
                             .seed = 5,
                             .frames = frames,
                             .truth_dir = r->truth,
                             .truth_samples = true};
    r->st = twin_scan_run(&what, r->site, r->out, &r->err);
    return r;
}

static void end(struct run *r) {
    assert_int_equal(site_close(r->site, &r->err), ST_OK);
    scene_destroy(r->scene);
    tempdir_remove(r->dir);
    free(r);
}

static int64_t station_of(struct run *r) {
    struct station station;
    assert_int_equal(station_find(r->site, r->out[0].name, &station, &r->err), ST_OK);
    return station.id;
}

/* How far the samples are from where their echoes came from, with the true rig. */
static struct twin_compare compare(struct run *r) {
    char samples[TEMPDIR_MAX + 96];
    (void)snprintf(samples, sizeof samples, "%s/samples-%s.bin", r->truth, r->out[0].name);
    struct rig rig = twin_config_rig(&r->config, true);
    struct twin_compare result;
    enum st st = twin_compare_station(r->site, station_of(r), samples, &rig, &r->out[0].true_pose,
                                      &result, &r->err);
    if (st)
        fail_msg("%s", r->err.text);
    return result;
}

/* Bytes of one of the stand's streams, malloc'ed. */
static uint8_t *stream_of(struct run *r, const char *kind, size_t *out_size) {
    struct stream stream;
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    uint8_t *bytes = NULL;
    size_t size = 0;
    assert_int_equal(stream_find(r->site, station_of(r), kind, NULL, &stream, &r->err), ST_OK);
    assert_int_equal(stream_reader_open(r->site, stream.id, 0, &reader, &r->err), ST_OK);
    while (!stream_reader_next(reader, &chunk, &r->err)) {
        bytes = realloc(bytes, size + chunk.size_bytes);
        assert_non_null(bytes);
        memcpy(bytes + size, chunk.payload, chunk.size_bytes);
        size += chunk.size_bytes;
    }
    stream_reader_close(reader);
    *out_size = size;
    return bytes;
}

/* Mean grey of the stand's frames, in order; returns their number. */
static size_t frames_of(struct run *r, struct frame_row *rows, double *out_mean, size_t capacity) {
    size_t count = 0;
    assert_int_equal(frame_row_list(r->site, station_of(r), 0, rows, capacity, &count, &r->err),
                     ST_OK);
    for (size_t i = 0; i < count; i++) {
        uint8_t *bytes = NULL;
        size_t size = 0;
        struct picture picture;
        struct image_u8 rgb;
        assert_int_equal(files_read(r->site, rows[i].sha256, &bytes, &size, &r->err), ST_OK);
        assert_int_equal(picture_decode(bytes, size, "frame", &picture, &r->err), ST_OK);
        assert_int_equal(picture_to_rgb(&picture, &rgb, &r->err), ST_OK);
        double sum = 0;
        for (int k = 0; k < rgb.width_px * rgb.height_px * 3; k++)
            sum += rgb.px[k];
        out_mean[i] = sum / (rgb.width_px * rgb.height_px * 3);
        image_u8_destroy(&rgb);
        picture_destroy(&picture);
        free(bytes);
    }
    return count;
}

static void a_scan_fills_a_site_whose_samples_are_where_they_were_measured(void **state) {
    (void)state;
    struct run *r = scan("room", NULL, true, NULL);
    assert_int_equal(r->st, ST_OK);
    struct twin_compare all = compare(r);
    assert_true(all.compared > 8000 && all.median_m < 0.004);
    /* the stream begins and ends with whole packets */
    assert_true(llabs(all.samples - (int64_t)r->out[0].samples) <= HEAD_PACKET_MAX_SAMPLES);
    assert_int_equal(r->out[0].frames, 3);
    assert_true(fabs(r->out[0].mirror_hz - 4) < 0.1);
    assert_true(fabs(r->out[0].samples_a_deg_pan - 28078.0 / 360 / 4) < 0.5);
    size_t size = 0;
    uint8_t *events = stream_of(r, "index", &size);
    assert_true(size >= 28 * 20);
    for (size_t i = 28 * 10; i < 28 * 20; i++) /* in the sweep the head is level */
        assert_true(i % 28 < 20 || i % 28 >= 24 || events[i] == 0);
    free(events);
    end(r);
}

static void any_number_of_threads_gives_the_same_bytes_in_every_scene(void **state) {
    (void)state;
    static const char *const scenes[] = {"sphere", "corridor", "open_field"};
    static const char *const kinds[] = {"head", "index", "gpio"};
    for (size_t s = 0; s < 3; s++) {
        int before = omp_get_max_threads();
        omp_set_num_threads(1);
        struct run *one = scan(scenes[s], NULL, false, NULL);
        omp_set_num_threads(3);
        struct run *three = scan(scenes[s], NULL, false, NULL);
        omp_set_num_threads(before);
        for (size_t k = 0; k < 3; k++) {
            size_t size_a = 0, size_b = 0;
            uint8_t *a = stream_of(one, kinds[k], &size_a),
                    *b = stream_of(three, kinds[k], &size_b);
            assert_true(size_a > 100);
            assert_int_equal(size_a, size_b);
            assert_memory_equal(a, b, size_a);
            free(a);
            free(b);
        }
        end(one);
        end(three);
    }
}

static void camera_faults_show_in_the_frames(void **state) {
    (void)state;
    struct frame_row rows[4];
    double plain[4], mean[4];
    struct run *r = scan("room", NULL, true, NULL);
    assert_int_equal(frames_of(r, rows, plain, 4), 3);
    int64_t host0_ns = (int64_t)(1000 * 1e9); /* the host's offset */
    double second_s = (double)(rows[1].t_ns - host0_ns) * 1e-9;
    end(r);

    char text[64];
    const char *faults[] = {text, NULL};
    (void)snprintf(text, sizeof text, "frame_dropped@%.2f+2", second_s - 1);
    r = scan("room", faults, true, NULL);
    assert_int_equal(frames_of(r, rows, mean, 4), 2); /* the strobe came, the frame did not */
    assert_true(fabs(mean[0] - plain[0]) < 1 && fabs(mean[1] - plain[2]) < 1);
    end(r);

    (void)snprintf(text, sizeof text, "light_change@%.2f+2=0.3", second_s - 1);
    r = scan("room", faults, true, NULL);
    assert_int_equal(frames_of(r, rows, mean, 4), 3);
    assert_true(fabs(mean[0] - plain[0]) < 1 && fabs(mean[2] - plain[2]) < 1);
    assert_true(mean[1] < 0.75 * plain[1]);
    end(r);

    (void)snprintf(text, sizeof text, "exposure_late@%.2f+2=0.3", second_s - 1);
    r = scan("room", faults, true, NULL);
    assert_int_equal(frames_of(r, rows, mean, 4), 3);
    assert_true(fabs(mean[1] - plain[1]) < 1); /* one frame late */
    assert_true(mean[2] < 0.75 * plain[2]);
    assert_true(fabs(rows[2].exposure_s / rows[1].exposure_s - 0.3) < 1e-9);
    end(r);
}

static void a_scan_goes_on_after_the_controller_has_switched_itself_off(void **state) {
    (void)state;
    static const char *const cases[] = {"mirror_stall@16+1.5", "estop@16+1", "interlock@16+1",
                                        "modbus_silence@16+4"};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char *faults[] = {cases[i], NULL};
        struct run *r = scan("sphere", faults, false, NULL);
        if (r->st)
            fail_msg("%s: %s", cases[i], r->err.text);
        struct twin_compare all = compare(r);
        if (!(all.compared > 10000 && all.median_m < 0.004))
            fail_msg("%s: %d compared, median %g mm", cases[i], (int)all.compared,
                     all.median_m * 1000);
        assert_true(r->out[0].sweep_s > 10);
        end(r);
    }
}

static void noise_on_the_controllers_line_costs_no_event(void **state) {
    (void)state;
    const char *faults[] = {"modbus_noise@0+1000=0.003", NULL};
    struct run *clean = scan("sphere", NULL, false, NULL);
    struct run *noisy = scan("sphere", faults, false, NULL);
    assert_int_equal(noisy->st, ST_OK);
    size_t size = 0;
    uint8_t *events = stream_of(noisy, "index", &size);
    for (size_t i = 0; i < size / 28; i++) /* numbered from 0 without a gap */
        assert_int_equal(events[28 * i + 2] << 8 | events[28 * i + 3], i);
    struct twin_compare all = compare(noisy);
    assert_true(all.median_m < 0.004);
    free(events);
    end(clean);
    end(noisy);
}

static void lost_packets_are_in_the_ledger(void **state) {
    (void)state;
    const char *faults[] = {"packet_lost@18=4", "packet_repeated@19", NULL};
    struct run *r = scan("sphere", faults, false, NULL);
    struct stream stream;
    struct stream_ledger entry[4];
    size_t count = 0;
    assert_int_equal(stream_find(r->site, station_of(r), "head", NULL, &stream, &r->err), ST_OK);
    assert_int_equal(stream_ledger_list(r->site, stream.id, 0, entry, 4, &count, &r->err), ST_OK);
    assert_int_equal(count, 1);
    assert_int_equal(entry[0].end_item - entry[0].first_item, 4);
    assert_string_equal(entry[0].reason, "usb_lost");
    end(r);
}

static void a_stand_inside_something_is_refused_with_its_name(void **state) {
    (void)state;
    struct run *r = scan("sphere", NULL, false, NULL);
    struct scene_stand bad = r->scene->stand[0];
    bad.position_m.x = 4.9;
    (void)snprintf(bad.name, sizeof bad.name, "wall");
    struct twin_scan what = {
        .scene = r->scene, .config = &r->config, .stands = &bad, .stand_count = 1, .seed = 5};
    assert_int_equal(twin_scan_run(&what, r->site, r->out, &r->err), ST_INVALID);
    assert_non_null(strstr(r->err.text, "wall"));
    end(r);
}

static void a_full_disk_and_a_power_loss_end_a_scan_that_keeps_what_it_had(void **state) {
    (void)state;
    const char *full[] = {"disk_full@0+1000", NULL}, *cut[] = {"power_loss@20", NULL};
    struct run *r = scan("sphere", full, false, NULL);
    assert_int_equal(r->st, ST_FULL);
    end(r);
    struct twin_config config = small();
    config.value[TWIN_CONFIG_SAMPLE_RATE].real = 50000; /* more than a chunk before the cut */
    config.value[TWIN_CONFIG_RAYS].real = 1;
    r = scan("sphere", cut, false, &config);
    assert_int_equal(r->st, ST_CANCELLED);
    assert_non_null(strstr(r->err.text, "lost power at 20.000 s"));
    size_t size = 0;
    uint8_t *bytes = stream_of(r, "head", &size);
    assert_true(size > 1000000);
    free(bytes);
    end(r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_scan_fills_a_site_whose_samples_are_where_they_were_measured),
        cmocka_unit_test(any_number_of_threads_gives_the_same_bytes_in_every_scene),
        cmocka_unit_test(camera_faults_show_in_the_frames),
        cmocka_unit_test(a_scan_goes_on_after_the_controller_has_switched_itself_off),
        cmocka_unit_test(noise_on_the_controllers_line_costs_no_event),
        cmocka_unit_test(lost_packets_are_in_the_ledger),
        cmocka_unit_test(a_stand_inside_something_is_refused_with_its_name),
        cmocka_unit_test(a_full_disk_and_a_power_loss_end_a_scan_that_keeps_what_it_had),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
