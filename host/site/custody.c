#include "site/custody.h"

#include "site/batch.h"
#include "site/custody_log.h"

enum st custody_add(struct site *site, const char *what, const char *detail_json,
                    struct errctx *err) {
    if (!site_kind_is_valid(what))
        return errctx_set(err, ST_INVALID, "custody: '%.40s' is not a kind of event", what);
    enum st st = row_check_json(detail_json, "custody detail", err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    st = custody_log(site, what, detail_json ? detail_json : "", err);
    return batch_end(site, st, err);
}

enum st custody_last(struct site *site, struct custody_event *out_event, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st =
        store_query(site, "SELECT * FROM custody ORDER BY id DESC LIMIT 1", NULL, 0, &stmt, err);
    if (!st)
        st = store_fetch(site, stmt, STORE_CUSTODY, err);
    if (st)
        return st == ST_NOT_FOUND ? errctx_set(err, st, "%s has no custody events", site->path)
                                  : st;
    st = custody_log_read(stmt, out_event, err);
    (void)sqlite3_reset(stmt);
    return st;
}

static enum st list_custody_log_read(struct site *site, sqlite3_stmt *stmt, void *out_row,
                                     struct errctx *err) {
    (void)site;
    return custody_log_read(stmt, out_row, err);
}

enum st custody_list(struct site *site, int64_t after_sequence, struct custody_event *out_events,
                     size_t capacity, size_t *out_count, struct errctx *err) {
    return store_list(site, "SELECT * FROM custody WHERE id > ?1 ORDER BY id", &after_sequence, 1,
                      STORE_CUSTODY, list_custody_log_read, out_events, sizeof *out_events,
                      capacity, out_count, err);
}
