#include "site/custody_log.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

enum st custody_log_first(const uint8_t uuid[16], uint8_t out_link[HASH_SHA256_BYTES]) {
    static const char label[] = "scancart/custody/1";
    uint8_t bytes[sizeof label + 16];
    memcpy(bytes, label, sizeof label);
    memcpy(bytes + sizeof label, uuid, 16);
    return hash_sha256(bytes, sizeof bytes, out_link);
}

enum st custody_log_link(const uint8_t before[HASH_SHA256_BYTES], const struct custody_event *event,
                         uint8_t out_link[HASH_SHA256_BYTES]) {
    uint8_t numbers[16];
    row_put_i64(numbers, event->sequence);
    row_put_i64(numbers + 8, event->utc_ns);
    const char *texts[] = {event->who, event->program, event->what, event->detail};
    struct hash_sha256 hash = {0};
    enum st st = hash_sha256_init(&hash);
    if (!st)
        st = hash_sha256_update(&hash, before, HASH_SHA256_BYTES);
    if (!st)
        st = hash_sha256_update(&hash, numbers, sizeof numbers);
    for (size_t i = 0; i < sizeof texts / sizeof texts[0] && !st; i++)
        st = hash_sha256_update(&hash, texts[i], strlen(texts[i]) + 1);
    if (!st)
        st = hash_sha256_final(&hash, out_link);
    hash_sha256_fini(&hash);
    return st;
}

enum st custody_log_read(sqlite3_stmt *stmt, struct custody_event *out_event, struct errctx *err) {
    struct custody_event event = {.sequence = sqlite3_column_int64(stmt, 0),
                                  .utc_ns = sqlite3_column_int64(stmt, 1)};
    enum st st = row_get_text(stmt, 2, event.who, sizeof event.who, err);
    if (!st)
        st = row_get_text(stmt, 3, event.program, sizeof event.program, err);
    if (!st)
        st = row_get_text(stmt, 4, event.what, sizeof event.what, err);
    if (!st)
        st = row_get_text(stmt, 5, event.detail, sizeof event.detail, err);
    if (!st)
        st = row_get_blob(stmt, 6, event.link, sizeof event.link, err);
    if (!st)
        *out_event = event;
    return st;
}

/* The newest event, or link 0 with sequence 0 before the first. */
static enum st newest(struct site *site, struct custody_event *out_event, struct errctx *err) {
    enum st st = custody_last(site, out_event, err);
    if (st != ST_NOT_FOUND)
        return st;
    struct site_info info;
    st = site_get_info(site, &info, err);
    if (st)
        return st;
    *out_event = (struct custody_event){0};
    if (custody_log_first(info.uuid, out_event->link))
        return errctx_set(err, ST_NOMEM, "cannot hash a custody event");
    return ST_OK;
}

enum st custody_log(struct site *site, const char *what, const char *detail, struct errctx *err) {
    struct custody_event before, event = {.utc_ns = store_now_utc_ns(site)};
    enum st st = newest(site, &before, err);
    if (st)
        return st;
    event.sequence = before.sequence + 1;
    (void)snprintf(event.who, sizeof event.who, "%s", site->who);
    (void)snprintf(event.program, sizeof event.program, "%s", site->program);
    (void)snprintf(event.what, sizeof event.what, "%s", what);
    (void)snprintf(event.detail, sizeof event.detail, "%s", detail);
    if (custody_log_link(before.link, &event, event.link))
        return errctx_set(err, ST_NOMEM, "cannot hash a custody event");
    struct row_value values[] = {row_int(event.sequence),
                                 row_int(event.utc_ns),
                                 row_text(event.who),
                                 row_text(event.program),
                                 row_text(event.what),
                                 row_text(event.detail),
                                 row_blob(event.link, sizeof event.link)};
    return store_insert(site, STORE_CUSTODY, values, sizeof values / sizeof values[0], NULL, NULL,
                        err);
}

enum st custody_logf(struct site *site, struct errctx *err, const char *what, const char *format,
                     ...) {
    char detail[SITE_TEXT_MAX];
    va_list args;
    va_start(args, format);
    int n = vsnprintf(detail, sizeof detail, format, args);
    va_end(args);
    if (n < 0 || (size_t)n >= sizeof detail)
        return errctx_set(err, ST_INTERNAL, "custody detail of %s is too long", what);
    return custody_log(site, what, detail, err);
}

enum st custody_log_open(struct site *site, struct errctx *err) {
    site->logged = true;
    return custody_logf(site, err, "opened", "{\"after\":\"%s\"}", site->clean ? "seal" : "crash");
}

enum st custody_log_seal(struct site *site, struct errctx *err) {
    uint8_t seal[HASH_SHA256_BYTES];
    char text[HASH_HEX_CHARS];
    if (digest_seal(site->digests, seal))
        return errctx_set(err, ST_NOMEM, "cannot hash the seal");
    hash_to_hex(seal, text);
    return custody_logf(site, err, "sealed", "{\"digest\":\"%s\"}", text);
}
