#include "base/rig_yaml.h"

#include "base/config.h"

#include <cyaml/cyaml.h>
#include <stdio.h>
#include <string.h>

/* One number of the text: its key and where it lies in the struct. */
struct entry {
    const char *key;
    size_t offset;
    double min, max;
    const char *unit;
};

#define AT(type, member) offsetof(struct type, member)

static const struct entry rig_entries[] = {
    {"shaft_x", AT(rig, shaft.x), -1, 1, ""},
    {"shaft_y", AT(rig, shaft.y), -1, 1, ""},
    {"shaft_z", AT(rig, shaft.z), -1, 1, ""},
    {"laser_x", AT(rig, laser.x), -1, 1, ""},
    {"laser_y", AT(rig, laser.y), -1, 1, ""},
    {"laser_z", AT(rig, laser.z), -1, 1, ""},
    {"mirror_angle_rad", AT(rig, mirror_angle_rad), 0.5, 1.1, "rad"},
    {"mirror_x_m", AT(rig, mirror_m.x), -1, 1, "m"},
    {"mirror_y_m", AT(rig, mirror_m.y), -1, 1, "m"},
    {"mirror_z_m", AT(rig, mirror_m.z), -1, 1, "m"},
    {"mirror_path_m", AT(rig, mirror_path_m), -1, 1, "m"},
    {"range_scale", AT(rig, range_scale), 0.5, 2, ""},
    {"range_offset_m", AT(rig, range_offset_m), -10, 10, "m"},
    {"encoder_counts_per_turn", AT(rig, encoder_counts_per_turn), 16, 16777216, "counts"},
    {"encoder_horizon_counts", AT(rig, encoder_horizon_counts), -16777216, 16777216, "counts"},
    {"encoder_ecc_cos_rad", AT(rig, encoder_ecc_cos_rad), -0.1, 0.1, "rad"},
    {"encoder_ecc_sin_rad", AT(rig, encoder_ecc_sin_rad), -0.1, 0.1, "rad"},
    {"pan_steps_per_turn", AT(rig, pan_steps_per_turn), 100, 1e8, "steps"},
    {"pan_zero_steps", AT(rig, pan_zero_steps), -1e9, 1e9, "steps"},
    {"pan_backlash_rad", AT(rig, pan_backlash_rad), 0, 0.1, "rad"},
    {"tilt_steps_per_turn", AT(rig, tilt_steps_per_turn), 100, 1e8, "steps"},
    {"tilt_zero_steps", AT(rig, tilt_zero_steps), -1e9, 1e9, "steps"},
};

/* The camera as numbers; sizes are doubles here so that one schema does. */
struct flat_camera {
    double width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2, k3, p1, p2;
    double wx_rad, wy_rad, wz_rad, x_m, y_m, z_m; /* head_from_cam: rotation vector, offset */
};

static const struct entry camera_entries[] = {
    {"width_px", AT(flat_camera, width_px), 1, 65536, "px"},
    {"height_px", AT(flat_camera, height_px), 1, 65536, "px"},
    {"fx_px", AT(flat_camera, fx_px), 1, 1e6, "px"},
    {"fy_px", AT(flat_camera, fy_px), 1, 1e6, "px"},
    {"cx_px", AT(flat_camera, cx_px), -65536, 131072, "px"},
    {"cy_px", AT(flat_camera, cy_px), -65536, 131072, "px"},
    {"k1", AT(flat_camera, k1), -100, 100, ""},
    {"k2", AT(flat_camera, k2), -100, 100, ""},
    {"k3", AT(flat_camera, k3), -100, 100, ""},
    {"p1", AT(flat_camera, p1), -10, 10, ""},
    {"p2", AT(flat_camera, p2), -10, 10, ""},
    {"head_from_cam_wx_rad", AT(flat_camera, wx_rad), -4, 4, "rad"},
    {"head_from_cam_wy_rad", AT(flat_camera, wy_rad), -4, 4, "rad"},
    {"head_from_cam_wz_rad", AT(flat_camera, wz_rad), -4, 4, "rad"},
    {"head_from_cam_x_m", AT(flat_camera, x_m), -10, 10, "m"},
    {"head_from_cam_y_m", AT(flat_camera, y_m), -10, 10, "m"},
    {"head_from_cam_z_m", AT(flat_camera, z_m), -10, 10, "m"},
};

enum { MAX_ENTRIES = 32 };

static double value_at(const void *base, size_t offset) {
    double value;
    memcpy(&value, (const char *)base + offset, sizeof value);
    return value;
}

static enum st write_entries(const void *base, const struct entry *entries, size_t count,
                             char *out_text, size_t capacity) {
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        int n = snprintf(out_text + used, capacity - used, "%s: %.17g\n", entries[i].key,
                         value_at(base, entries[i].offset));
        if (n < 0 || (size_t)n >= capacity - used)
            return ST_NOMEM;
        used += (size_t)n;
    }
    return ST_OK;
}

static enum st read_entries(const char *text, size_t size, const char *name,
                            const struct entry *entries, size_t count, void *out, size_t out_size,
                            struct errctx *err) {
    cyaml_schema_field_t field[MAX_ENTRIES + 1];
    struct config_range range[MAX_ENTRIES];
    cyaml_schema_value_t top;
    memset(field, 0, sizeof field);
    memset(&top, 0, sizeof top);
    for (size_t i = 0; i < count; i++) {
        field[i].key = entries[i].key;
        field[i].data_offset = (uint32_t)entries[i].offset;
        field[i].value.type = CYAML_FLOAT;
        field[i].value.data_size = sizeof(double);
        struct config_range one = {entries[i].key, entries[i].min, entries[i].max, entries[i].unit};
        range[i] = one;
    }
    top.type = CYAML_MAPPING;
    top.flags = CYAML_FLAG_POINTER;
    top.data_size = (uint32_t)out_size;
    top.mapping.fields = field;
    struct config_schema schema = {&top, range, count};
    void *value = NULL;
    enum st st = config_load_text(text, size, name, &schema, &value, NULL, err);
    if (st)
        return st;
    memcpy(out, value, out_size);
    config_free(&schema, value);
    return ST_OK;
}

enum st rig_yaml_write(const struct rig *rig, char *out_text, size_t capacity) {
    return write_entries(rig, rig_entries, sizeof rig_entries / sizeof rig_entries[0], out_text,
                         capacity);
}

enum st rig_yaml_read(const char *text, size_t size, const char *name, struct rig *out_rig,
                      struct errctx *err) {
    struct rig rig;
    enum st st = read_entries(text, size, name, rig_entries,
                              sizeof rig_entries / sizeof rig_entries[0], &rig, sizeof rig, err);
    if (st)
        return st;
    st = rig_check(&rig, err);
    if (st) {
        (void)errctx_prefix(err, st, "%s", name);
        return ST_FORMAT;
    }
    *out_rig = rig;
    return ST_OK;
}

enum st rig_yaml_write_camera(const struct rig_camera *cam, char *out_text, size_t capacity) {
    const struct camera *c = &cam->camera;
    struct vec3 w = so3_log(&cam->head_from_cam.r), t = cam->head_from_cam.t_m;
    struct flat_camera flat = {c->width_px, c->height_px, c->fx_px, c->fy_px, c->cx_px, c->cy_px,
                               c->k1,       c->k2,        c->k3,    c->p1,    c->p2,    w.x,
                               w.y,         w.z,          t.x,      t.y,      t.z};
    return write_entries(&flat, camera_entries, sizeof camera_entries / sizeof camera_entries[0],
                         out_text, capacity);
}

enum st rig_yaml_read_camera(const char *text, size_t size, const char *name,
                             struct rig_camera *out_cam, struct errctx *err) {
    struct flat_camera f;
    enum st st = read_entries(text, size, name, camera_entries,
                              sizeof camera_entries / sizeof camera_entries[0], &f, sizeof f, err);
    if (st)
        return st;
    if (f.width_px != floor(f.width_px) || f.height_px != floor(f.height_px))
        return errctx_set(err, ST_FORMAT, "%s: width_px and height_px are whole numbers", name);
    struct rig_camera cam = {
        .camera = {.width_px = (int32_t)f.width_px,
                   .height_px = (int32_t)f.height_px,
                   .fx_px = f.fx_px,
                   .fy_px = f.fy_px,
                   .cx_px = f.cx_px,
                   .cy_px = f.cy_px,
                   .k1 = f.k1,
                   .k2 = f.k2,
                   .p1 = f.p1,
                   .p2 = f.p2,
                   .k3 = f.k3},
        .head_from_cam = {so3_exp(vec3_make(f.wx_rad, f.wy_rad, f.wz_rad)), {f.x_m, f.y_m, f.z_m}}};
    st = camera_check(&cam.camera, err);
    if (st) {
        (void)errctx_prefix(err, st, "%s", name);
        return ST_FORMAT;
    }
    *out_cam = cam;
    return ST_OK;
}
