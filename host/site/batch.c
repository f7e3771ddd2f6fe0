#include "site/batch.h"

#include "site/custody_log.h"

#include <string.h>

static enum st open_transaction(struct site *site, struct errctx *err) {
    enum st st = store_exec(site, "BEGIN IMMEDIATE", err);
    if (st)
        return st;
    memcpy(site->digests_before, site->digests, sizeof site->digests);
    site->logged_before = site->logged;
    return site->logged ? ST_OK : custody_log_open(site, err);
}

static void roll_back(struct site *site) {
    /* Fails harmlessly if SQLite has rolled back by itself, as it does on a full disk. */
    (void)sqlite3_exec(site->db, "ROLLBACK", NULL, NULL, NULL);
    memcpy(site->digests, site->digests_before, sizeof site->digests);
    site->logged = site->logged_before;
}

static enum st close_transaction(struct site *site, enum st st, struct errctx *err) {
    if (!st)
        st = digest_save(site, err);
    if (!st)
        st = store_exec(site, "COMMIT", err);
    if (st)
        roll_back(site);
    else
        site->changed = true;
    return st;
}

enum st batch_begin(struct site *site, struct errctx *err) {
    if (site->mode != SITE_WRITE)
        return errctx_set(err, ST_PERMISSION, "%s is open for reading only", site->path);
    if (site->in_batch) {
        if (site->batch_failed && err)
            *err = site->batch_err;
        return site->batch_failed;
    }
    enum st st = open_transaction(site, err);
    if (st)
        roll_back(site);
    return st;
}

enum st batch_end(struct site *site, enum st st, struct errctx *err) {
    if (!site->in_batch)
        return close_transaction(site, st, err);
    if (st && !site->batch_failed) {
        site->batch_failed = st;
        site->batch_err = (struct errctx){.st = st};
        if (err)
            site->batch_err = *err;
    }
    return st;
}

bool site_in_batch(const struct site *site) {
    return site->in_batch;
}

enum st site_begin(struct site *site, struct errctx *err) {
    if (site->in_batch)
        return errctx_set(err, ST_INVALID, "a batch is open already");
    enum st st = batch_begin(site, err);
    if (st)
        return st;
    site->in_batch = true;
    site->batch_failed = ST_OK;
    return ST_OK;
}

enum st site_commit(struct site *site, struct errctx *err) {
    if (!site->in_batch)
        return errctx_set(err, ST_INVALID, "no batch is open");
    site->in_batch = false;
    enum st failed = site->batch_failed;
    site->batch_failed = ST_OK;
    if (failed && err)
        *err = site->batch_err;
    return close_transaction(site, failed, err);
}

void site_rollback(struct site *site) {
    if (!site->in_batch)
        return;
    site->in_batch = false;
    site->batch_failed = ST_OK;
    roll_back(site);
}
