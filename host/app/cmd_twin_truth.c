#include "app/cmd_twin.h"

#include "app/app.h"
#include "base/fileio.h"
#include "base/json.h"
#include "base/rig_yaml.h"
#include "site/calib.h"
#include "site/station.h"
#include "twin/twin_compare.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char about[] =
    "With a scene: what rays really meet. Each --ray is an origin and a direction; the answer is "
    "the first surface with its "
    "distance, normal and material, and what is behind it if that is glass.\n\n"
    "With --site and --truth (of a scan with --truth-samples): how far the recorded samples are "
    "from where their echoes came "
    "from, reconstructed once with the true and once with the nominal calibration.\n\n"
    "Example: scancart twin truth room --ray 0,0,1.6,1,0,0\n"
    "Example: scancart twin truth --site my-site --truth my-truth";

struct options {
    const char **ray;
    char *site, *truth;
    long scene_seed;
    double detail;
    bool json;
};

static enum st parse_ray(const char *text, struct trace_ray *out_ray, struct errctx *err) {
    double v[6];
    const char *at = text;
    for (int i = 0; i < 6; i++) {
        char *end = NULL;
        v[i] = strtod(at, &end);
        if (end == at || *end != (i < 5 ? ',' : '\0'))
            return errctx_set(err, ST_INVALID, "--ray '%s' is not OX,OY,OZ,DX,DY,DZ", text);
        at = end + 1;
    }
    struct vec3 d = vec3_make(v[3], v[4], v[5]);
    double norm = vec3_norm(d);
    if (!(norm > 1e-9) || !isfinite(v[0] + v[1] + v[2] + norm))
        return errctx_set(err, ST_INVALID, "--ray '%s' has no direction", text);
    struct trace_ray ray = {{v[0], v[1], v[2]}, vec3_scale(d, 1 / norm), 0, INFINITY};
    *out_ray = ray;
    return ST_OK;
}

static void hit_text(const char *what, const struct scene *scene, const struct trace_hit *hit,
                     uint16_t material) {
    (void)printf("%s %.6f m at (%.6f, %.6f, %.6f), normal (%.4f, %.4f, %.4f), %s\n", what, hit->t_m,
                 hit->p_m.x, hit->p_m.y, hit->p_m.z, hit->normal.x, hit->normal.y, hit->normal.z,
                 scene->material[material].name);
}

static void hit_json(struct json *json, struct cJSON *parent, const char *key,
                     const struct scene *scene, const struct trace_hit *hit, uint16_t material) {
    struct cJSON *o = json_object(json, parent, key);
    json_number(json, o, "distance_m", hit->t_m);
    const double p[6] = {hit->p_m.x,    hit->p_m.y,    hit->p_m.z,
                         hit->normal.x, hit->normal.y, hit->normal.z};
    struct cJSON *point = json_array(json, o, "point_m"), *normal = json_array(json, o, "normal");
    for (int i = 0; i < 6; i++)
        json_number(json, i < 3 ? point : normal, NULL, p[i]);
    json_text(json, o, "material", scene->material[material].name);
    json_number(json, o, "albedo_ir", (double)scene->material[material].albedo_ir);
}

static enum st rays(const struct options *o, const char *name, struct errctx *err) {
    struct scene *scene = NULL;
    enum st st = cmd_twin_scene(name, o->scene_seed, o->detail, &scene, err);
    struct json json;
    json_init_array(&json);
    for (size_t i = 0; o->ray && o->ray[i] && !st; i++) {
        struct trace_ray ray;
        struct scene_truth truth;
        st = parse_ray(o->ray[i], &ray, err);
        if (st)
            break;
        scene_truth_of(scene, &ray, &truth);
        struct cJSON *one = json_object(&json, NULL, NULL);
        json_boolean(&json, one, "hit", truth.hit);
        if (truth.hit)
            hit_json(&json, one, "first", scene, &truth.first, truth.first_material);
        if (truth.behind)
            hit_json(&json, one, "behind_glass", scene, &truth.second, truth.second_material);
        if (o->json)
            continue;
        if (truth.hit)
            hit_text("first ", scene, &truth.first, truth.first_material);
        else
            (void)printf("nothing\n");
        if (truth.behind)
            hit_text("behind", scene, &truth.second, truth.second_material);
    }
    if (!st && o->json)
        st = json_write(&json, stdout, err);
    json_fini(&json);
    scene_destroy(scene);
    return st;
}

/* ---- a site against its truth ---- */

static enum st read_rig(struct site *site, enum calib_status status, struct rig *out_rig,
                        struct errctx *err) {
    struct calib record;
    char text[RIG_YAML_MAX_BYTES + 1];
    enum st st = calib_find(site, "rig", NULL, status, &record, err);
    if (!st)
        st = calib_read(site, record.id, NULL, text, sizeof text, err);
    return st ? st : rig_yaml_read(text, record.size_bytes, "rig", out_rig, err);
}

/* world_from_station_true of a stand from truth.json. */
static enum st true_pose(const char *dir, const char *stand, struct pose *out_pose,
                         struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    uint8_t *text = NULL;
    size_t size = 0;
    enum st st = fileio_join(dir, "truth.json", path, err);
    if (!st)
        st = fileio_read(path, 1 << 22, &text, &size, err);
    if (st)
        return st;
    cJSON *root = cJSON_ParseWithLength((const char *)text, size), *s = NULL;
    st = errctx_set(err, ST_NOT_FOUND, "%s: no stand '%s'", path, stand);
    cJSON_ArrayForEach(s, cJSON_GetObjectItem(root, "stands")) {
        const char *name = cJSON_GetStringValue(cJSON_GetObjectItem(s, "name"));
        cJSON *m = cJSON_GetObjectItem(s, "world_from_station_true");
        if (!name || strcmp(name, stand) || cJSON_GetArraySize(m) != 16)
            continue;
        double v[16];
        for (int i = 0; i < 16; i++)
            v[i] = cJSON_GetNumberValue(cJSON_GetArrayItem(m, i));
        struct pose pose = {{{v[0], v[1], v[2], v[4], v[5], v[6], v[8], v[9], v[10]}},
                            {v[3], v[7], v[11]}};
        *out_pose = pose;
        st = pose_orthonormality_error(&pose.r) < 1e-6
                 ? ST_OK
                 : errctx_set(err, ST_FORMAT, "%s: a bad pose", path);
    }
    cJSON_Delete(root);
    free(text);
    return st;
}

static void report(const struct options *o, struct json *json, const char *stand, const char *with,
                   const struct twin_compare *c) {
    if (!o->json) {
        (void)printf(
            "%-10s %-8s %lld samples, %lld compared: median %.2f mm, rms %.2f mm, 95 %% %.2f mm; "
            "along the beam %+.2f +- %.2f mm; %lld mixed, %lld outliers left out\n",
            stand, with, (long long)c->samples, (long long)c->compared, c->median_m * 1000,
            c->rms_m * 1000, c->p95_m * 1000, c->radial_mean_m * 1000, c->radial_sigma_m * 1000,
            (long long)c->mixed, (long long)c->outliers);
        return;
    }
    struct cJSON *j = json_object(json, NULL, NULL);
    json_text(json, j, "stand", stand);
    json_text(json, j, "calibration", with);
    json_integer(json, j, "samples", c->samples);
    json_integer(json, j, "compared", c->compared);
    json_integer(json, j, "mixed", c->mixed);
    json_integer(json, j, "outliers", c->outliers);
    json_number(json, j, "median_m", c->median_m);
    json_number(json, j, "rms_m", c->rms_m);
    json_number(json, j, "p95_m", c->p95_m);
    json_number(json, j, "radial_mean_m", c->radial_mean_m);
    json_number(json, j, "radial_sigma_m", c->radial_sigma_m);
}

static enum st compare_stand(const struct options *o, struct site *site,
                             const struct station *station, struct json *json, struct errctx *err) {
    char name[SITE_NAME_MAX + 16], path[FILEIO_PATH_MAX];
    struct pose pose;
    (void)snprintf(name, sizeof name, "samples-%s.bin", station->name);
    enum st st = fileio_join(o->truth, name, path, err);
    if (!st)
        st = true_pose(o->truth, station->name, &pose, err);
    for (int truth = 1; truth >= 0 && !st; truth--) {
        struct rig rig;
        struct twin_compare result;
        st = read_rig(site, truth ? CALIB_TRUE : CALIB_NOMINAL, &rig, err);
        if (!st)
            st = twin_compare_station(site, station->id, path, &rig, &pose, &result, err);
        if (!st)
            report(o, json, station->name, truth ? "true" : "nominal", &result);
    }
    return st;
}

static enum st compare(const struct options *o, struct errctx *err) {
    struct site *site = NULL;
    struct station station;
    enum st st = site_open(o->site, SITE_READ, &site, err);
    struct json json;
    json_init_array(&json);
    size_t count = 1;
    for (int64_t after = 0; !st;) {
        st = station_list(site, after, &station, 1, &count, err);
        if (st || !count)
            break;
        st = compare_stand(o, site, &station, &json, err);
        after = station.id;
    }
    if (!st && o->json)
        st = json_write(&json, stdout, err);
    json_fini(&json);
    (void)site_close(site, NULL);
    return st;
}

int cmd_twin_truth(int argc, const char **argv) {
    struct options o = {.scene_seed = 1, .detail = 1};
    const struct poptOption options[] = {
        {"ray", 'r', POPT_ARG_ARGV, &o.ray, 0, "a ray (repeat for more), metres",
         "OX,OY,OZ,DX,DY,DZ"},
        {"site", 0, POPT_ARG_STRING, &o.site, 0, "a scanned site", "SITE"},
        {"truth", 0, POPT_ARG_STRING, &o.truth, 0, "its truth", "DIR"},
        {"scene-seed", 0, POPT_ARG_LONG, &o.scene_seed, 0, "of the scene (1)", "N"},
        {"detail", 0, POPT_ARG_DOUBLE, &o.detail, 0, "of the scene, 0.1 to 1 (1)", "PART"},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "twin truth",
                              .synopsis = "SCENE --ray ... | --site SITE --truth DIR [--json]",
                              .about = about,
                              .options = options,
                              .out_json = &o.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    const char *scene = poptGetArg(context);
    struct errctx err = {0};
    int status;
    if (scene && o.ray && !o.site && !poptPeekArg(context))
        status = rays(&o, scene, &err) ? app_fail("twin truth", &err) : APP_DONE;
    else if (!scene && !o.ray && o.site && o.truth)
        status = compare(&o, &err) ? app_fail("twin truth", &err) : APP_DONE;
    else
        status = app_usage_error("twin truth", "give a scene and --ray, or --site and --truth");
    (void)poptFreeContext(context);
    app_free_options(options);
    return status;
}
