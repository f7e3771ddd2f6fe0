#include "site/photo_json.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEXT_MAX = 64 * 1024 };

#define FORMAT_NAME    "scancart 3D photograph"
#define FORMAT_VERSION 1.0

/* cJSON prints 15 digits where they come close; 17 come back exactly. */
static bool add_number(cJSON *to, const char *name, double value) {
    char text[32];
    (void)snprintf(text, sizeof text, "%.17g", value);
    cJSON *item = cJSON_CreateRaw(text);
    if (!item)
        return false;
    bool ok = name ? cJSON_AddItemToObject(to, name, item) : cJSON_AddItemToArray(to, item);
    if (!ok)
        cJSON_Delete(item);
    return ok;
}

static bool add_numbers(cJSON *to, const char *name, const double *values, int count) {
    cJSON *array = cJSON_AddArrayToObject(to, name);
    bool ok = array != NULL;
    for (int i = 0; ok && i < count; i++)
        ok = add_number(array, NULL, values[i]);
    return ok;
}

static bool add_all(cJSON *root, const struct photo *photo, const struct photo_tiff_info *info) {
    const struct camera *c = &photo->camera;
    const struct vec3 t = photo->station_from_cam.t_m;
    const double t_m[3] = {t.x, t.y, t.z};
    cJSON *camera = NULL, *pose = NULL;
    return cJSON_AddStringToObject(root, "format", FORMAT_NAME) &&
           add_number(root, "version", FORMAT_VERSION) &&
           cJSON_AddStringToObject(root, "name", info->name) &&
           cJSON_AddStringToObject(root, "length_unit", info->length_unit) &&
           (camera = cJSON_AddObjectToObject(root, "camera")) != NULL &&
           add_number(camera, "width_px", c->width_px) &&
           add_number(camera, "height_px", c->height_px) && add_number(camera, "fx_px", c->fx_px) &&
           add_number(camera, "fy_px", c->fy_px) && add_number(camera, "cx_px", c->cx_px) &&
           add_number(camera, "cy_px", c->cy_px) &&
           (pose = cJSON_AddObjectToObject(root, "station_from_cam")) != NULL &&
           add_numbers(pose, "r", photo->station_from_cam.r.m, 9) &&
           add_numbers(pose, "t_m", t_m, 3);
}

char *photo_json_print(const struct photo *photo, const struct photo_tiff_info *info) {
    cJSON *root = cJSON_CreateObject();
    char *text = NULL;
    if (root && add_all(root, photo, info))
        text = cJSON_PrintUnformatted(root);
    cJSON_Delete(root);
    return text;
}

static enum st get_number(const cJSON *from, const char *name, double *out, struct errctx *err) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(from, name);
    if (!cJSON_IsNumber(item) || !isfinite(item->valuedouble))
        return errctx_set(err, ST_FORMAT, "no number '%s'", name);
    *out = item->valuedouble;
    return ST_OK;
}

static enum st get_side(const cJSON *from, const char *name, int32_t *out, struct errctx *err) {
    double value = 0;
    enum st st = get_number(from, name, &value, err);
    if (st)
        return st;
    if (!(value >= 1.0 && value <= 65536.0) || value != floor(value))
        return errctx_set(err, ST_FORMAT, "'%s' is %g, not 1 to 65536", name, value);
    *out = (int32_t)value;
    return ST_OK;
}

static enum st get_numbers(const cJSON *from, const char *name, double *out, int count,
                           struct errctx *err) {
    const cJSON *array = cJSON_GetObjectItemCaseSensitive(from, name);
    if (!cJSON_IsArray(array) || cJSON_GetArraySize(array) != count)
        return errctx_set(err, ST_FORMAT, "no %d numbers '%s'", count, name);
    const cJSON *item = array->child;
    for (int i = 0; i < count; i++, item = item->next) {
        if (!cJSON_IsNumber(item) || !isfinite(item->valuedouble))
            return errctx_set(err, ST_FORMAT, "'%s' holds something that is not a number", name);
        out[i] = item->valuedouble;
    }
    return ST_OK;
}

static enum st get_text(const cJSON *from, const char *name, char *out, size_t capacity,
                        struct errctx *err) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(from, name);
    if (!cJSON_IsString(item) || strlen(item->valuestring) >= capacity)
        return errctx_set(err, ST_FORMAT, "no text '%s' of less than %zu bytes", name, capacity);
    memcpy(out, item->valuestring, strlen(item->valuestring) + 1);
    return ST_OK;
}

static enum st get_all(const cJSON *root, struct photo *photo, struct photo_tiff_info *info,
                       struct errctx *err) {
    const cJSON *format = cJSON_GetObjectItemCaseSensitive(root, "format");
    if (!cJSON_IsString(format) || strcmp(format->valuestring, FORMAT_NAME))
        return errctx_set(err, ST_FORMAT, "it does not say '%s'", FORMAT_NAME);
    double version = 0, t_m[3];
    enum st st = get_number(root, "version", &version, err);
    if (st)
        return st;
    if (version != FORMAT_VERSION)
        return errctx_set(err, ST_FORMAT, "version %g is not known to this program", version);
    const cJSON *camera = cJSON_GetObjectItemCaseSensitive(root, "camera");
    const cJSON *pose = cJSON_GetObjectItemCaseSensitive(root, "station_from_cam");
    struct camera *c = &photo->camera;
    if ((st = get_text(root, "name", info->name, sizeof info->name, err)) ||
        (st = get_text(root, "length_unit", info->length_unit, sizeof info->length_unit, err)) ||
        (st = get_side(camera, "width_px", &c->width_px, err)) ||
        (st = get_side(camera, "height_px", &c->height_px, err)) ||
        (st = get_number(camera, "fx_px", &c->fx_px, err)) ||
        (st = get_number(camera, "fy_px", &c->fy_px, err)) ||
        (st = get_number(camera, "cx_px", &c->cx_px, err)) ||
        (st = get_number(camera, "cy_px", &c->cy_px, err)) ||
        (st = get_numbers(pose, "r", photo->station_from_cam.r.m, 9, err)) ||
        (st = get_numbers(pose, "t_m", t_m, 3, err)))
        return st;
    photo->station_from_cam.t_m = vec3_make(t_m[0], t_m[1], t_m[2]);
    return ST_OK;
}

enum st photo_json_parse(const char *text, struct photo *out_photo,
                         struct photo_tiff_info *out_info, struct errctx *err) {
    size_t length = strlen(text);
    cJSON *root = length <= TEXT_MAX ? cJSON_ParseWithLength(text, length + 1) : NULL;
    if (!root)
        return errctx_set(err, ST_FORMAT, "not JSON: this is not a 3D photograph of scancart");
    struct photo photo = {0};
    struct photo_tiff_info info = {{0}, {0}};
    enum st st = get_all(root, &photo, &info, err);
    cJSON_Delete(root);
    if (st)
        return st;
    out_photo->camera = photo.camera;
    out_photo->station_from_cam = photo.station_from_cam;
    *out_info = info;
    return ST_OK;
}
