#include "site/job.h"

#include "site/batch.h"
#include "site/job_row.h"
#include "site/store.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static int by_key(const void *a, const void *b) {
    const cJSON *const *x = a, *const *y = b;
    return strcmp((*x)->string, (*y)->string);
}

/* Sorts the members of all objects by key. ST_FORMAT if a key is there twice. */
static enum st sort_keys(cJSON *item) {
    for (cJSON *child = item->child; child; child = child->next) {
        enum st st = sort_keys(child);
        if (st)
            return st;
    }
    int count = cJSON_GetArraySize(item);
    if (!cJSON_IsObject(item) || count < 2)
        return ST_OK;
    cJSON **members = calloc((size_t)count, sizeof(cJSON *));
    if (!members)
        return ST_NOMEM;
    for (int i = 0; i < count; i++)
        members[i] = cJSON_DetachItemViaPointer(item, item->child);
    qsort(members, (size_t)count, sizeof(cJSON *), by_key);
    enum st st = ST_OK;
    for (int i = 0; i < count; i++) {
        if (i > 0 && !strcmp(members[i - 1]->string, members[i]->string))
            st = ST_FORMAT;
        (void)cJSON_AddItemToArray(item, members[i]); /* appends; the member keeps its key */
    }
    free(members);
    return st;
}

/* Sorted keys, no white space: free with cJSON_free(). */
static enum st canonical(const char *parameters, char **out_text, struct errctx *err) {
    if (!parameters || strlen(parameters) > JOB_PARAMETERS_MAX_BYTES)
        return errctx_set(err, ST_INVALID, "job: parameters missing or longer than %d bytes",
                          JOB_PARAMETERS_MAX_BYTES);
    cJSON *json = cJSON_ParseWithOpts(parameters, NULL, 1);
    if (!cJSON_IsObject(json)) {
        cJSON_Delete(json);
        return errctx_set(err, ST_FORMAT, "job: parameters are not a JSON object: %.80s",
                          parameters);
    }
    enum st st = sort_keys(json);
    char *text = st ? NULL : cJSON_PrintUnformatted(json);
    cJSON_Delete(json);
    if (st == ST_FORMAT)
        return errctx_set(err, st, "job: a key stands twice in its parameters: %.80s", parameters);
    if (!text)
        return errctx_set(err, ST_NOMEM, "job: no memory for its parameters");
    *out_text = text;
    return ST_OK;
}

static enum st check_job(const struct job *job, struct errctx *err) {
    if (!site_kind_is_valid(job->kind) || !site_name_is_valid(job->program))
        return errctx_set(err, ST_INVALID, "job: '%.40s' or '%.80s' is no kind or program",
                          job->kind, job->program);
    if (job->input_count > JOB_MAX_HASHES || job->output_count > JOB_MAX_HASHES)
        return errctx_set(err, ST_INVALID, "job %s: more than %d inputs or outputs", job->kind,
                          JOB_MAX_HASHES);
    for (size_t i = 0; i < job->input_count; i++)
        if (!site_kind_is_valid(job->inputs[i].role))
            return errctx_set(err, ST_INVALID, "job %s: input %zu has no valid role", job->kind, i);
    for (size_t i = 0; i < job->output_count; i++)
        if (!site_kind_is_valid(job->outputs[i].role))
            return errctx_set(err, ST_INVALID, "job %s: output %zu has no valid role", job->kind,
                              i);
    return ST_OK;
}

static enum st key_of(const struct job *job, const char *parameters,
                      uint8_t out_key[HASH_SHA256_BYTES], struct errctx *err) {
    static const char label[] = "scancart/job/1";
    const char *texts[] = {label, job->kind, parameters, job->program};
    struct hash_sha256 hash = {0};
    enum st st = hash_sha256_init(&hash);
    for (size_t i = 0; i < sizeof texts / sizeof texts[0] && !st; i++)
        st = hash_sha256_update(&hash, texts[i], strlen(texts[i]) + 1);
    for (size_t i = 0; i < job->input_count && !st; i++) {
        const struct job_hash *input = &job->inputs[i];
        st = hash_sha256_update(&hash, input->role, strlen(input->role) + 1);
        if (!st)
            st = hash_sha256_update(&hash, input->sha256, sizeof input->sha256);
    }
    if (!st)
        st = hash_sha256_final(&hash, out_key);
    hash_sha256_fini(&hash);
    return st ? errctx_set(err, ST_NOMEM, "cannot hash a job") : ST_OK;
}

enum st job_key(const struct job *job, uint8_t out_key[HASH_SHA256_BYTES], struct errctx *err) {
    char *parameters = NULL;
    uint8_t key[HASH_SHA256_BYTES];
    enum st st = check_job(job, err);
    if (!st)
        st = canonical(job->parameters, &parameters, err);
    if (!st)
        st = key_of(job, parameters, key, err);
    if (!st)
        memcpy(out_key, key, sizeof key);
    cJSON_free(parameters);
    return st;
}

static enum st insert_hashes(struct site *site, int64_t id, enum job_row_direction direction,
                             const struct job_hash *hashes, size_t count, struct errctx *err) {
    enum st st = ST_OK;
    for (size_t i = 0; i < count && !st; i++) {
        bool known = true;
        if (!hashes[i].outside)
            st = job_row_knows(site, hashes[i].sha256, &known, err);
        if (!st && !known) {
            char hex[HASH_HEX_CHARS];
            hash_to_hex(hashes[i].sha256, hex);
            st = errctx_set(err, ST_NOT_FOUND, "job: its %s %s %s is not in the site",
                            direction == JOB_ROW_INPUT ? "input" : "output", hashes[i].role, hex);
        }
        struct row_value values[] = {row_int(0),
                                     row_int(id),
                                     row_int((int64_t)direction),
                                     row_text(hashes[i].role),
                                     row_blob(hashes[i].sha256, sizeof hashes[i].sha256),
                                     row_int(hashes[i].outside)};
        if (!st)
            st = store_insert(site, STORE_JOB_HASH, values, 6, NULL, NULL, err);
    }
    return st;
}

enum st job_add(struct site *site, const struct job *job, int64_t *out_id, struct errctx *err) {
    char *parameters = NULL;
    uint8_t key[HASH_SHA256_BYTES];
    int64_t id = 0;
    enum st st = check_job(job, err);
    if (!st && !(isfinite(job->seconds) && job->seconds >= 0))
        st = errctx_set(err, ST_INVALID, "job %s: it took %g s", job->kind, job->seconds);
    if (!st)
        st = canonical(job->parameters, &parameters, err);
    if (!st)
        st = key_of(job, parameters, key, err);
    if (!st)
        st = batch_begin(site, err);
    if (st) {
        cJSON_free(parameters);
        return st;
    }
    struct row_value values[] = {row_int(0),
                                 row_text(job->kind),
                                 row_text(parameters),
                                 row_text(job->program),
                                 row_blob(key, sizeof key),
                                 row_real(job->seconds),
                                 row_int(store_now_utc_ns(site))};
    st = store_insert(site, STORE_JOB, values, 7, NULL, &id, err);
    if (!st)
        st = insert_hashes(site, id, JOB_ROW_INPUT, job->inputs, job->input_count, err);
    if (!st)
        st = insert_hashes(site, id, JOB_ROW_OUTPUT, job->outputs, job->output_count, err);
    st = batch_end(site, st, err);
    cJSON_free(parameters);
    if (!st)
        *out_id = id;
    return st;
}

enum st job_find(struct site *site, const struct job *wanted, int64_t *out_id, struct errctx *err) {
    uint8_t key[HASH_SHA256_BYTES];
    sqlite3_stmt *stmt = NULL;
    enum st st = job_key(wanted, key, err);
    if (!st)
        st = store_query(site, "SELECT * FROM job WHERE key = ?1 ORDER BY id DESC", NULL, 0, &stmt,
                         err);
    struct row_value value = row_blob(key, sizeof key);
    if (!st)
        st = row_bind(stmt, 1, &value);
    bool usable = false;
    int64_t id = 0;
    while (!st && !usable) {
        st = store_fetch(site, stmt, STORE_JOB, err);
        if (!st) {
            id = sqlite3_column_int64(stmt, 0);
            st = job_row_has_outputs(site, id, &usable, err);
        }
    }
    (void)sqlite3_reset(stmt);
    if (st == ST_NOT_FOUND)
        return errctx_set(err, st, "%s: no up-to-date job %s", site->path, wanted->kind);
    if (!st)
        *out_id = id;
    return st;
}

static enum st list_id(struct site *site, sqlite3_stmt *stmt, void *out_row, struct errctx *err) {
    (void)site;
    (void)err;
    *(int64_t *)out_row = sqlite3_column_int64(stmt, 0);
    return ST_OK;
}

enum st job_list(struct site *site, const char *kind, int64_t after_id, int64_t *out_ids,
                 size_t capacity, size_t *out_count, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    struct row_value value = kind ? row_text(kind) : row_null();
    enum st st = store_query(
        site, "SELECT * FROM job WHERE id > ?1 AND (?2 IS NULL OR kind = ?2) ORDER BY id",
        &after_id, 1, &stmt, err);
    if (!st)
        st = row_bind(stmt, 2, &value);
    return st ? st
              : store_list_bound(site, stmt, STORE_JOB, list_id, out_ids, sizeof *out_ids, capacity,
                                 out_count, err);
}

void job_free(struct job *job) {
    free(job);
}
