#include "twin/twin_config.h"

#include "base/config.h"

#include <cyaml/cyaml.h>
#include <stdlib.h>
#include <string.h>

static const double deg = 3.14159265358979323846 / 180;

struct key {
    const char *section, *name;
    int has_nominal;
    double nominal, real, min, max;
    const char *what;
};

static const struct key keys[TWIN_CONFIG_COUNT] = {
#define X(id, section, name, has_nominal, nominal, real, min, max, what)                           \
    {section, name, has_nominal, nominal, real, min, max, what},
    TWIN_CONFIG_KEYS(X)
#undef X
};

struct twin_config twin_config_default(void) {
    struct twin_config config;
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++) {
        config.value[i].nominal = keys[i].nominal;
        config.value[i].real = keys[i].real;
    }
    return config;
}

struct twin_config twin_config_ideal(void) {
    static const enum twin_config_key zero[] = {
        TWIN_CONFIG_STAND_SIGMA,       TWIN_CONFIG_STAND_YAW_SIGMA,  TWIN_CONFIG_ENCODER_NOISE,
        TWIN_CONFIG_DIVERGENCE,        TWIN_CONFIG_APERTURE,         TWIN_CONFIG_MIN_RANGE,
        TWIN_CONFIG_ECHO_SEEN,         TWIN_CONFIG_ECHO_USABLE,      TWIN_CONFIG_SIGMA_FLOOR,
        TWIN_CONFIG_SIGMA_SHOT,        TWIN_CONFIG_BIAS_DECADE,      TWIN_CONFIG_SATURATION_BIAS,
        TWIN_CONFIG_INTENSITY_NOISE,   TWIN_CONFIG_OUTLIERS,         TWIN_CONFIG_DROPOUTS,
        TWIN_CONFIG_QUANTUM,           TWIN_CONFIG_MIRROR_WANDER,    TWIN_CONFIG_MIRROR_RIPPLE,
        TWIN_CONFIG_HEAD_OFFSET,       TWIN_CONFIG_HEAD_DRIFT,       TWIN_CONFIG_HEAD_WANDER,
        TWIN_CONFIG_CONTROLLER_OFFSET, TWIN_CONFIG_CONTROLLER_DRIFT, TWIN_CONFIG_CONTROLLER_WANDER,
        TWIN_CONFIG_CONTROLLER_JITTER, TWIN_CONFIG_HOST_OFFSET,      TWIN_CONFIG_HOST_DRIFT,
        TWIN_CONFIG_HOST_WANDER,       TWIN_CONFIG_HOST_LATENCY,     TWIN_CONFIG_CAMERA_VIGNETTE,
        TWIN_CONFIG_CAMERA_NOISE};
    struct twin_config config = twin_config_default();
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++)
        if (keys[i].has_nominal)
            config.value[i].real = config.value[i].nominal;
    for (size_t i = 0; i < sizeof zero / sizeof zero[0]; i++)
        config.value[zero[i]].real = 0;
    config.value[TWIN_CONFIG_RAYS].real = 1;
    config.value[TWIN_CONFIG_MAX_RANGE].real = 1000;
    config.value[TWIN_CONFIG_AMBIGUITY].real = 10000;
    config.value[TWIN_CONFIG_ECHO_SATURATES].real = 1e9;
    return config;
}

void twin_config_set_quality(struct twin_config *config, enum twin_config_quality quality) {
    static const double steps[] = {12, 4, 3}, rays[] = {1, 4, 8}, width[] = {384, 576, 1152};
    static const double samples[] = {4, 8, 16};
    config->value[TWIN_CONFIG_PAN_PER_REV].real = steps[quality];
    config->value[TWIN_CONFIG_RAYS].real = rays[quality];
    config->value[TWIN_CONFIG_CAMERA_WIDTH].real = width[quality];
    config->value[TWIN_CONFIG_CAMERA_HEIGHT].real = width[quality] * 1.5;
    config->value[TWIN_CONFIG_CAMERA_SAMPLES].real = samples[quality];
}

/* The schema for libcyaml, made from the table: sections of keys; a key with a nominal value is a
 * mapping of two numbers. */
struct schema {
    cyaml_schema_value_t number, top_value;
    cyaml_schema_field_t pair[3];
    cyaml_schema_field_t section[16][TWIN_CONFIG_COUNT + 1];
    cyaml_schema_field_t top[17];
    struct config_range range[2 * TWIN_CONFIG_COUNT];
    char range_key[2 * TWIN_CONFIG_COUNT][64];
    size_t range_count;
};

static cyaml_schema_field_t field(const char *key, size_t offset, cyaml_schema_value_t value) {
    cyaml_schema_field_t f;
    memset(&f, 0, sizeof f);
    f.key = key;
    f.data_offset = (uint32_t)offset;
    f.value = value;
    return f;
}

static cyaml_schema_value_t mapping(const cyaml_schema_field_t *fields, enum cyaml_flag flags,
                                    size_t size) {
    cyaml_schema_value_t v;
    memset(&v, 0, sizeof v);
    v.type = CYAML_MAPPING;
    v.flags = flags;
    v.data_size = (uint32_t)size;
    v.mapping.fields = fields;
    return v;
}

static void add_range(struct schema *s, const struct key *k, const char *suffix) {
    char *key = s->range_key[s->range_count];
    (void)snprintf(key, sizeof s->range_key[0], "%s.%s%s", k->section, k->name, suffix);
    struct config_range range = {key, k->min, k->max, ""};
    s->range[s->range_count++] = range;
}

static void make_schema(struct schema *s) {
    memset(s, 0, sizeof *s);
    s->number.type = CYAML_FLOAT;
    s->number.flags = CYAML_FLAG_OPTIONAL;
    s->number.data_size = sizeof(double);
    s->pair[0] = field("nominal", offsetof(struct twin_config_value, nominal), s->number);
    s->pair[1] = field("true", offsetof(struct twin_config_value, real), s->number);
    int sections = 0, in_section = 0;
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++) {
        const struct key *k = &keys[i];
        if (i == 0 || strcmp(k->section, keys[i - 1].section)) {
            /* A section covers the whole struct, so that its fields' offsets are the struct's. */
            s->top[sections] = field(
                k->section, 0,
                mapping(s->section[sections], CYAML_FLAG_OPTIONAL, sizeof(struct twin_config)));
            sections++;
            in_section = 0;
        }
        size_t at = (size_t)i * sizeof(struct twin_config_value);
        s->section[sections - 1][in_section++] =
            k->has_nominal
                ? field(k->name, at,
                        mapping(s->pair, CYAML_FLAG_OPTIONAL, sizeof(struct twin_config_value)))
                : field(k->name, at + offsetof(struct twin_config_value, real), s->number);
        if (k->has_nominal)
            add_range(s, k, ".nominal");
        add_range(s, k, k->has_nominal ? ".true" : "");
    }
    s->top_value = mapping(s->top, CYAML_FLAG_POINTER, sizeof(struct twin_config));
}

enum st twin_config_load(const char *path, struct twin_config *config, struct errctx *err) {
    struct schema *s = malloc(sizeof *s);
    if (!s)
        return errctx_set(err, ST_NOMEM, "%s: out of memory", path);
    make_schema(s);
    struct config_schema schema = {&s->top_value, s->range, s->range_count};
    void *value = NULL;
    struct config *file = NULL;
    enum st st = config_load(path, &schema, &value, &file, err);
    if (!st) {
        const struct twin_config *read = value;
        for (int i = 0; i < TWIN_CONFIG_COUNT; i++) {
            char key[80];
            (void)snprintf(key, sizeof key, "%s.%s%s", keys[i].section, keys[i].name,
                           keys[i].has_nominal ? ".true" : "");
            if (config_has(file, key))
                config->value[i].real = read->value[i].real;
            (void)snprintf(key, sizeof key, "%s.%s.nominal", keys[i].section, keys[i].name);
            if (keys[i].has_nominal && config_has(file, key))
                config->value[i].nominal = read->value[i].nominal;
        }
        config_free(&schema, value);
    }
    config_destroy(file);
    free(s);
    return st;
}

enum st twin_config_set(struct twin_config *config, const char *text, struct errctx *err) {
    const char *equals = strchr(text, '=');
    size_t length = equals ? (size_t)(equals - text) : strlen(text);
    static const char nominal[] = ".nominal";
    size_t suffix = sizeof nominal - 1;
    bool is_nominal = length > suffix && !strncmp(text + length - suffix, nominal, suffix);
    size_t name_length = is_nominal ? length - suffix : length;
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++) {
        char key[80];
        int n = snprintf(key, sizeof key, "%s.%s", keys[i].section, keys[i].name);
        if ((size_t)n != name_length || strncmp(key, text, name_length))
            continue;
        char *end = NULL;
        double value = equals ? strtod(equals + 1, &end) : 0;
        if (!equals || end == equals + 1 || *end)
            return errctx_set(err, ST_FORMAT, "'%s': expected %s=NUMBER", text, key);
        if (!(value >= keys[i].min && value <= keys[i].max))
            return errctx_set(err, ST_INVALID, "%s: %g is not within %g..%g", key, value,
                              keys[i].min, keys[i].max);
        if (is_nominal && !keys[i].has_nominal)
            return errctx_set(err, ST_INVALID, "%s has no nominal value", key);
        *(is_nominal ? &config->value[i].nominal : &config->value[i].real) = value;
        return ST_OK;
    }
    return errctx_set(err, ST_NOT_FOUND,
                      "the twin has no parameter '%.*s' (scancart twin config prints them all)",
                      (int)name_length, text);
}

enum st twin_config_write(const struct twin_config *config, FILE *out, struct errctx *err) {
    (void)fprintf(
        out, "# The simulated cart: what it is thought to be (nominal) and what it is (true).\n"
             "# Units are in the keys; ratios have none.\n");
    for (int i = 0; i < TWIN_CONFIG_COUNT; i++) {
        const struct key *k = &keys[i];
        const struct twin_config_value *v = &config->value[i];
        if (i == 0 || strcmp(k->section, keys[i - 1].section))
            (void)fprintf(out, "%s%s:\n", i ? "\n" : "", k->section);
        if (k->has_nominal)
            (void)fprintf(out, "  %s: {nominal: %.15g, true: %.15g}", k->name, v->nominal, v->real);
        else
            (void)fprintf(out, "  %s: %.15g", k->name, v->real);
        (void)fprintf(out, k->what[0] ? "  # %s\n" : "\n", k->what);
    }
    return ferror(out) ? errctx_set(err, ST_IO, "cannot write the twin's parameters") : ST_OK;
}

struct rig twin_config_rig(const struct twin_config *config, bool real) {
#define V(key)                                                                                     \
    (real ? config->value[TWIN_CONFIG_##key].real : config->value[TWIN_CONFIG_##key].nominal)
    struct rig rig = rig_nominal();
    struct mat3 shaft_z = so3_exp(vec3_make(0, 0, V(SHAFT_YAW) * 1e-3));
    struct mat3 shaft_x = so3_exp(vec3_make(V(SHAFT_ROLL) * 1e-3, 0, 0));
    struct mat3 laser_z = so3_exp(vec3_make(0, 0, V(LASER_YAW) * 1e-3));
    struct mat3 laser_x = so3_exp(vec3_make(V(LASER_ROLL) * 1e-3, 0, 0));
    rig.shaft = vec3_unit(mat3_mulv(&shaft_z, mat3_mulv(&shaft_x, rig.shaft)));
    rig.laser = vec3_unit(mat3_mulv(&laser_z, mat3_mulv(&laser_x, rig.laser)));
    rig.mirror_angle_rad = V(MIRROR_ANGLE) * deg;
    rig.mirror_m = vec3_scale(vec3_make(V(MIRROR_X), V(MIRROR_Y), V(MIRROR_Z)), 1e-3);
    rig.mirror_path_m = V(MIRROR_PATH) * 1e-3;
    rig.range_scale = V(RANGE_SCALE);
    rig.range_offset_m = V(RANGE_OFFSET) * 1e-3;
    rig.encoder_horizon_counts = V(HORIZON);
    rig.encoder_ecc_cos_rad = V(ECC_COS) * 1e-3;
    rig.encoder_ecc_sin_rad = V(ECC_SIN) * 1e-3;
    rig.pan_steps_per_turn = V(PAN_STEPS);
    rig.pan_backlash_rad = V(BACKLASH) * 1e-3;
    rig.tilt_steps_per_turn = V(TILT_STEPS);
    rig.tilt_zero_steps = V(TILT_ZERO);
    return rig;
}

struct rig_camera twin_config_camera(const struct twin_config *config, bool real) {
    struct rig_camera c;
    memset(&c, 0, sizeof c);
    c.camera.width_px = (int32_t)(config->value[TWIN_CONFIG_CAMERA_WIDTH].real + 0.5);
    c.camera.height_px = (int32_t)(config->value[TWIN_CONFIG_CAMERA_HEIGHT].real + 0.5);
    c.camera.fx_px = V(CAMERA_FX) * c.camera.width_px;
    c.camera.fy_px = c.camera.fx_px * V(CAMERA_ASPECT);
    c.camera.cx_px = V(CAMERA_CX) * c.camera.width_px - 0.5; /* pixel 0 is a centre */
    c.camera.cy_px = V(CAMERA_CY) * c.camera.height_px - 0.5;
    c.camera.k1 = V(CAMERA_K1);
    c.camera.k2 = V(CAMERA_K2);
    c.camera.p1 = V(CAMERA_P1);
    c.camera.p2 = V(CAMERA_P2);
    c.head_from_cam = rig_camera_nominal_pose();
    struct mat3 z = so3_exp(vec3_make(0, 0, V(CAMERA_YAW) * 1e-3));
    struct mat3 y = so3_exp(vec3_make(0, V(CAMERA_PITCH) * 1e-3, 0));
    struct mat3 x = so3_exp(vec3_make(V(CAMERA_ROLL) * 1e-3, 0, 0));
    struct mat3 zy = mat3_mul(&z, &y), zyx = mat3_mul(&zy, &x);
    c.head_from_cam.r = mat3_mul(&zyx, &c.head_from_cam.r);
    c.head_from_cam.t_m = vec3_scale(vec3_make(V(CAMERA_X), V(CAMERA_Y), V(CAMERA_Z)), 1e-3);
    return c;
#undef V
}

struct optics twin_config_optics(const struct twin_config *config) {
#define R(key) config->value[TWIN_CONFIG_##key].real
    struct optics optics = {.rays = (int)(R(RAYS) + 0.5),
                            .divergence_rad = R(DIVERGENCE) * 1e-3,
                            .aperture_m = R(APERTURE) * 1e-3,
                            .min_range_m = R(MIN_RANGE),
                            .max_range_m = R(MAX_RANGE),
                            .ambiguity_m = R(AMBIGUITY),
                            .echo_seen = R(ECHO_SEEN),
                            .echo_usable = R(ECHO_USABLE),
                            .echo_saturates = R(ECHO_SATURATES),
                            .echo_reference = R(ECHO_REFERENCE),
                            .sigma_floor_m = R(SIGMA_FLOOR) * 1e-3,
                            .sigma_shot_m = R(SIGMA_SHOT) * 1e-3,
                            .ambient_noise = R(AMBIENT_NOISE),
                            .bias_per_decade_m = R(BIAS_DECADE) * 1e-3,
                            .saturation_bias_m = R(SATURATION_BIAS) * 1e-3,
                            .intensity_noise = R(INTENSITY_NOISE),
                            .outlier_probability = R(OUTLIERS),
                            .dropout_probability = R(DROPOUTS),
                            .quantum_m = R(QUANTUM) * 1e-3};
    return optics;
}

struct clocks_spec twin_config_clock(const struct twin_config *config,
                                     enum twin_config_clock which) {
    struct clocks_spec head = {R(HEAD_OFFSET), R(HEAD_DRIFT), R(HEAD_WANDER), 0};
    struct clocks_spec controller = {R(CONTROLLER_OFFSET), R(CONTROLLER_DRIFT),
                                     R(CONTROLLER_WANDER), R(CONTROLLER_JITTER)};
    struct clocks_spec host = {R(HOST_OFFSET), R(HOST_DRIFT), R(HOST_WANDER), 0};
    return which == TWIN_CLOCK_HEAD ? head : which == TWIN_CLOCK_CONTROLLER ? controller : host;
#undef R
}
