#include "twin/twin_truth.h"

#include "base/fileio.h"
#include "base/json.h"

#include <errno.h>
#include <math.h>
#include <string.h>

static void put(uint8_t *at, uint64_t value, int bytes) {
    for (int i = 0; i < bytes; i++)
        at[i] = (uint8_t)(value >> (8 * i));
}

static uint64_t get(const uint8_t *at, int bytes) {
    uint64_t value = 0;
    for (int i = bytes - 1; i >= 0; i--)
        value = value << 8 | at[i];
    return value;
}

static uint32_t bits_of(float x) {
    uint32_t u;
    memcpy(&u, &x, sizeof u);
    return u;
}

static float float_of(uint64_t bits) {
    uint32_t u = (uint32_t)bits;
    float x;
    memcpy(&x, &u, sizeof x);
    return x;
}

void twin_truth_encode(const struct twin_truth_sample *sample,
                       uint8_t out_bytes[TWIN_TRUTH_SAMPLE_BYTES]) {
    put(out_bytes, sample->seq, 4);
    put(out_bytes + 4, sample->part, 2);
    out_bytes[6] = sample->echoes;
    out_bytes[7] = sample->mixed;
    put(out_bytes + 8, (uint64_t)sample->t_ns, 8);
    for (int i = 0; i < 3; i++)
        put(out_bytes + 16 + 4 * i, bits_of(sample->point_m[i]), 4);
    put(out_bytes + 28, bits_of(sample->distance_m), 4);
    put(out_bytes + 32, bits_of(sample->nearest_m), 4);
    put(out_bytes + 36, bits_of(sample->farthest_m), 4);
}

struct twin_truth_sample twin_truth_decode(const uint8_t bytes[TWIN_TRUTH_SAMPLE_BYTES]) {
    struct twin_truth_sample s = {.seq = (uint32_t)get(bytes, 4),
                                  .part = (uint16_t)get(bytes + 4, 2),
                                  .echoes = bytes[6],
                                  .mixed = bytes[7],
                                  .t_ns = (int64_t)get(bytes + 8, 8),
                                  .distance_m = float_of(get(bytes + 28, 4)),
                                  .nearest_m = float_of(get(bytes + 32, 4)),
                                  .farthest_m = float_of(get(bytes + 36, 4))};
    for (int i = 0; i < 3; i++)
        s.point_m[i] = float_of(get(bytes + 16 + 4 * i, 4));
    return s;
}

struct twin_truth_sample twin_truth_of_shot(const struct cart_shot *shot) {
    const struct optics_echo *e = &shot->echo;
    struct vec3 p = vec3_madd(shot->beam.origin_m, shot->beam.dir, e->distance_m);
    struct twin_truth_sample s = {.seq = shot->seq,
                                  .part = e->part,
                                  .echoes = e->echoes,
                                  .mixed = e->mixed,
                                  .t_ns = shot->t_ns,
                                  .point_m = {(float)p.x, (float)p.y, (float)p.z},
                                  .distance_m = (float)e->distance_m,
                                  .nearest_m = (float)e->nearest_m,
                                  .farthest_m = (float)e->farthest_m};
    return s;
}

static void pose_json(struct json *json, struct cJSON *parent, const char *key,
                      const struct pose *pose) {
    struct cJSON *m = json_array(json, parent, key);
    struct mat4 h = pose_to_mat4(pose);
    for (int i = 0; i < 16; i++)
        json_number(json, m, NULL, h.m[i]);
}

static void stand_json(struct json *json, struct cJSON *list, const struct twin_scan_stand *s) {
    struct cJSON *o = json_object(json, list, NULL);
    json_text(json, o, "name", s->name);
    pose_json(json, o, "world_from_station_true", &s->true_pose);
    pose_json(json, o, "world_from_station_nominal", &s->nominal_pose);
    json_integer(json, o, "samples", (int64_t)s->samples);
    json_integer(json, o, "returns", (int64_t)s->returns);
    json_integer(json, o, "no_returns", (int64_t)s->no_returns);
    json_integer(json, o, "dropped", (int64_t)s->dropped);
    json_integer(json, o, "saturated", (int64_t)s->saturated);
    json_integer(json, o, "mixed", (int64_t)s->mixed);
    json_integer(json, o, "packets", (int64_t)s->packets);
    json_integer(json, o, "bytes", (int64_t)s->bytes);
    json_integer(json, o, "index_events", (int64_t)s->index_events);
    json_integer(json, o, "frames", (int64_t)s->frames);
    json_number(json, o, "sweep_s", s->sweep_s);
    json_number(json, o, "mirror_hz", s->mirror_hz);
    json_number(json, o, "samples_a_deg_mirror", s->samples_a_deg_mirror);
    json_number(json, o, "samples_a_deg_pan", s->samples_a_deg_pan);
    json_number(json, o, "range_error_mean_m", s->error_mean_m);
    json_number(json, o, "range_error_sigma_m", s->error_sigma_m);
}

static enum st write_yaml(const struct twin_config *config, const char *path, struct errctx *err) {
    FILE *file = fopen(path, "w");
    if (!file)
        return errctx_set(err, fileio_status(errno), "%s: %s", path, strerror(errno));
    enum st st = twin_config_write(config, file, err);
    if (fclose(file) && !st)
        st = errctx_set(err, ST_IO, "%s: %s", path, strerror(errno));
    return st;
}

enum st twin_truth_write(const struct twin_scan *scan, const char *dir,
                         const struct twin_scan_stand *stands, struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    enum st st = fileio_mkdirs(dir, err);
    if (!st)
        st = fileio_join(dir, "twin.yaml", path, err);
    if (!st)
        st = write_yaml(scan->config, path, err);
    if (!st)
        st = fileio_join(dir, "truth.json", path, err);
    if (st)
        return st;
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "scene", scan->scene->name);
    json_integer(&json, NULL, "scene_seed", (int64_t)scan->scene->seed);
    json_integer(&json, NULL, "triangles", (int64_t)scan->scene->mesh.triangle_count);
    json_integer(&json, NULL, "seed", (int64_t)scan->seed);
    struct cJSON *faults = json_array(&json, NULL, "faults");
    for (size_t i = 0; scan->faults && i < scan->faults->count; i++) {
        const struct fault *f = &scan->faults->list[i];
        struct cJSON *o = json_object(&json, faults, NULL);
        json_text(&json, o, "name", faults_info_of(f->kind)->name);
        json_number(&json, o, "start_s", (double)f->start_ns * 1e-9);
        json_number(&json, o, "duration_s", (double)f->duration_ns * 1e-9);
        json_number(&json, o, "value", f->value);
    }
    struct cJSON *list = json_array(&json, NULL, "stands");
    for (size_t i = 0; i < scan->stand_count; i++)
        stand_json(&json, list, &stands[i]);
    st = json_write_file(&json, path, err);
    json_fini(&json);
    return st;
}
