#include "app/view_notes.h"

#include "base/fileio.h"
#include "base/json.h"

#include <cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum st path_of(const char *site_path, char out[FILEIO_PATH_MAX], struct errctx *err) {
    size_t n = strlen(site_path);
    while (n > 1 && site_path[n - 1] == '/')
        n--;
    int length = snprintf(out, FILEIO_PATH_MAX, "%.*s.notes.json", (int)n, site_path);
    return length > 0 && length < FILEIO_PATH_MAX
               ? ST_OK
               : errctx_set(err, ST_INVALID, "the site's path is too long for notes beside it");
}

/* ---- reading ---- */

static double number(const cJSON *object, const char *key, bool *ok) {
    const cJSON *value = cJSON_GetObjectItemCaseSensitive(object, key);
    if (!cJSON_IsNumber(value) || !isfinite(value->valuedouble)) {
        *ok = false;
        return 0.0;
    }
    return value->valuedouble;
}

static struct vec3 place(const cJSON *object, const char *key, bool *ok) {
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(object, key);
    double v[3] = {0, 0, 0};
    for (int i = 0; i < 3; i++) {
        const cJSON *value = cJSON_GetArrayItem(list, i);
        *ok = *ok && cJSON_IsNumber(value) && isfinite(value->valuedouble);
        v[i] = *ok ? value->valuedouble : 0.0;
    }
    return vec3_make(v[0], v[1], v[2]);
}

static bool read_all(const cJSON *root, struct view_notes *out) {
    const cJSON *item;
    bool ok = cJSON_IsObject(root);
    cJSON_ArrayForEach(item, cJSON_GetObjectItemCaseSensitive(root, "notes")) {
        const char *text = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(item, "text"));
        if (!ok || !text || out->note_count == VIEW_NOTES_MAX)
            return false;
        struct view_note *note = &out->notes[out->note_count++];
        note->p_m = place(item, "place_m", &ok);
        (void)snprintf(note->text, sizeof note->text, "%s", text);
    }
    cJSON_ArrayForEach(item, cJSON_GetObjectItemCaseSensitive(root, "views")) {
        if (!ok || out->view_count == VIEW_NOTES_VIEWS_MAX)
            return false;
        struct view_pilot *p = &out->views[out->view_count++];
        double mode = number(item, "mode", &ok);
        ok = ok && mode >= 0.0 && mode < VIEW_MODES;
        p->mode = ok ? (enum view_mode)(int)mode : VIEW_ORBIT;
        p->parallel = number(item, "parallel", &ok) > 0.0;
        p->eye_m = place(item, "eye_m", &ok);
        p->pivot_m = place(item, "pivot_m", &ok);
        p->azimuth_rad = number(item, "azimuth_rad", &ok);
        p->elevation_rad = number(item, "elevation_rad", &ok);
        p->hfov_rad = number(item, "hfov_rad", &ok);
        p->width_m = number(item, "width_m", &ok);
        ok = ok && p->hfov_rad > 0.0 && p->hfov_rad < 3.14 && p->width_m > 0.0;
    }
    return ok;
}

enum st view_notes_load(const char *site_path, struct view_notes *out_notes, struct errctx *err) {
    enum { MAX_BYTES = 1 << 20 };
    char path[FILEIO_PATH_MAX];
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct errctx why = {0};
    enum st st = path_of(site_path, path, err);
    if (st)
        return st;
    memset(out_notes, 0, sizeof *out_notes);
    st = fileio_read(path, MAX_BYTES, &bytes, &size, &why);
    if (st == ST_NOT_FOUND)
        return ST_OK;
    if (st)
        return errctx_set(err, st, "%s", why.text);
    union {
        const uint8_t *bytes;
        const char *text;
    } in = {.bytes = bytes};
    cJSON *root = cJSON_ParseWithLength(in.text, size);
    if (!root || !read_all(root, out_notes)) {
        memset(out_notes, 0, sizeof *out_notes);
        st = errctx_set(err, ST_FORMAT, "%s holds no notes of the viewer", path);
    }
    cJSON_Delete(root);
    free(bytes);
    return st;
}

/* ---- writing ---- */

static void put_place(struct json *json, struct cJSON *parent, const char *key, struct vec3 p) {
    struct cJSON *list = json_array(json, parent, key);
    json_number(json, list, NULL, p.x);
    json_number(json, list, NULL, p.y);
    json_number(json, list, NULL, p.z);
}

enum st view_notes_save(const char *site_path, const struct view_notes *notes, struct errctx *err) {
    char path[FILEIO_PATH_MAX];
    enum st st = path_of(site_path, path, err);
    if (st)
        return st;
    struct json json;
    json_init_object(&json);
    struct cJSON *list = json_array(&json, NULL, "notes");
    for (int i = 0; i < notes->note_count; i++) {
        struct cJSON *one = json_object(&json, list, NULL);
        json_text(&json, one, "text", notes->notes[i].text);
        put_place(&json, one, "place_m", notes->notes[i].p_m);
    }
    list = json_array(&json, NULL, "views");
    for (int i = 0; i < notes->view_count; i++) {
        const struct view_pilot *p = &notes->views[i];
        struct cJSON *one = json_object(&json, list, NULL);
        json_integer(&json, one, "mode", (int64_t)p->mode);
        json_integer(&json, one, "parallel", p->parallel ? 1 : 0);
        put_place(&json, one, "eye_m", p->eye_m);
        put_place(&json, one, "pivot_m", p->pivot_m);
        json_number(&json, one, "azimuth_rad", p->azimuth_rad);
        json_number(&json, one, "elevation_rad", p->elevation_rad);
        json_number(&json, one, "hfov_rad", p->hfov_rad);
        json_number(&json, one, "width_m", p->width_m);
    }
    st = json_write_file(&json, path, err);
    json_fini(&json);
    return st;
}
