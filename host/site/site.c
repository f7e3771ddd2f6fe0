#include "site/site.h"

#include "base/fileio.h"
#include "site/batch.h"
#include "site/custody.h"
#include "site/custody_log.h"
#include "site/files_dir.h"
#include "site/migrate.h"
#include "site/site_db.h"
#include "site/store.h"
#include "site/writer_lock.h"

#include <math.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

bool site_name_is_valid(const char *name) {
    size_t n = strlen(name);
    if (n < 1 || n >= SITE_NAME_MAX)
        return false;
    for (const uint8_t *c = (const uint8_t *)name; *c;) {
        size_t more = *c < 0x80                 ? 0
                      : *c >= 0xc2 && *c < 0xe0 ? 1
                      : *c >= 0xe0 && *c < 0xf0 ? 2
                      : *c >= 0xf0 && *c < 0xf5 ? 3
                                                : 9;
        if (more == 9 || *c < ' ' || *c == 0x7f || *c == '/' || *c == '\\')
            return false;
        for (c++; more > 0; more--, c++)
            if ((*c & 0xc0) != 0x80)
                return false;
    }
    return true;
}

bool site_kind_is_valid(const char *kind) {
    size_t n = strspn(kind, "abcdefghijklmnopqrstuvwxyz0123456789-_.");
    return n >= 1 && n < SITE_KIND_MAX && kind[n] == '\0';
}

const char *site_path(const struct site *site) {
    return site->path;
}

enum site_mode site_mode_of(const struct site *site) {
    return site->mode;
}

void site_set_actor(struct site *site, const char *who, const char *program) {
    if (who)
        (void)snprintf(site->who, sizeof site->who, "%s", who);
    if (program)
        (void)snprintf(site->program, sizeof site->program, "%s", program);
}

void site_set_clock(struct site *site, int64_t utc_ns) {
    site->fixed_utc_ns = utc_ns;
}

static enum st check_georef(const struct site_georef *georef, struct errctx *err) {
    enum { EPSG_MAX = 999999 };
    const double offset_max_m = 1e9; /* no coordinate system of the earth needs more */
    const struct vec3 o = georef->offset_m;
    if (georef->epsg < 0 || georef->epsg > EPSG_MAX)
        return errctx_set(err, ST_INVALID, "EPSG code %d is not in 0..%d", (int)georef->epsg,
                          EPSG_MAX);
    if (!vec3_is_finite(o) || fabs(o.x) > offset_max_m || fabs(o.y) > offset_max_m ||
        fabs(o.z) > offset_max_m)
        return errctx_set(err, ST_INVALID, "the offset must be three numbers within 1e9 m");
    if (georef->epsg == 0 && (o.x != 0 || o.y != 0 || o.z != 0))
        return errctx_set(err, ST_INVALID, "an offset needs an EPSG code to mean something");
    return ST_OK;
}

static enum st insert_georef(struct site *site, const struct site_georef *georef,
                             struct errctx *err) {
    const double offset[3] = {georef->offset_m.x, georef->offset_m.y, georef->offset_m.z};
    uint8_t bytes[sizeof offset];
    row_put_doubles(bytes, offset, 3);
    struct row_value values[] = {row_int(0), row_int(georef->epsg), row_blob(bytes, sizeof bytes),
                                 row_int(store_now_utc_ns(site))};
    return store_insert(site, STORE_GEOREF, values, 4, NULL, NULL, err);
}

enum st site_set_georef(struct site *site, const struct site_georef *georef, struct errctx *err) {
    enum st st = check_georef(georef, err);
    if (!st)
        st = batch_begin(site, err);
    if (st)
        return st;
    st = insert_georef(site, georef, err);
    if (!st)
        st = custody_logf(site, err, "georef", "{\"epsg\":%d,\"offset_m\":[%.17g,%.17g,%.17g]}",
                          (int)georef->epsg, georef->offset_m.x, georef->offset_m.y,
                          georef->offset_m.z);
    return batch_end(site, st, err);
}

static enum st read_georef(struct site *site, struct site_georef *out_georef, struct errctx *err) {
    sqlite3_stmt *stmt = NULL;
    enum st st =
        store_query(site, "SELECT * FROM georef ORDER BY id DESC LIMIT 1", NULL, 0, &stmt, err);
    if (!st)
        st = store_fetch(site, stmt, STORE_GEOREF, err);
    if (st == ST_NOT_FOUND) {
        *out_georef = (struct site_georef){0};
        return ST_OK;
    }
    if (st)
        return st;
    double offset[3];
    struct site_georef georef = {0};
    st = row_get_int32(stmt, 1, &georef.epsg, err);
    if (!st)
        st = row_get_doubles(stmt, 2, offset, 3, err);
    (void)sqlite3_reset(stmt);
    if (st)
        return st;
    georef.offset_m = vec3_make(offset[0], offset[1], offset[2]);
    *out_georef = georef;
    return ST_OK;
}

enum st site_get_info(struct site *site, struct site_info *out_info, struct errctx *err) {
    struct site_info info = {.schema_version = site->schema_version};
    sqlite3_stmt *stmt = NULL;
    enum st st = store_fetch_id(site, STORE_SITE, 1, &stmt, err);
    if (st == ST_NOT_FOUND)
        return errctx_set(err, ST_DAMAGED, "%s/site.db: table site is empty", site->path);
    if (st)
        return st;
    st = row_get_blob(stmt, 1, info.uuid, sizeof info.uuid, err);
    if (!st)
        st = row_get_text(stmt, 2, info.name, sizeof info.name, err);
    info.created_utc_ns = sqlite3_column_int64(stmt, 3);
    (void)sqlite3_reset(stmt);
    if (!st)
        st = read_georef(site, &info.georef, err);
    if (!st)
        *out_info = info;
    return st;
}

/* The login name, or the number of a user without one. */
static void name_user(char *out_who, size_t capacity) {
    char room[4096];
    struct passwd entry, *found = NULL;
    if (getpwuid_r(geteuid(), &entry, room, sizeof room, &found) == 0 && found)
        (void)snprintf(out_who, capacity, "%s", found->pw_name);
    else
        (void)snprintf(out_who, capacity, "uid %ld", (long)geteuid());
}

static enum st new_handle(const char *path, enum site_mode mode, struct site **out_site,
                          struct errctx *err) {
    if (strlen(path) < 1 || strlen(path) > FILEIO_PATH_MAX - FILES_DIR_NAME_MAX - 32)
        return errctx_set(err, ST_INVALID, "'%.80s' is no usable path", path);
    struct site *site = calloc(1, sizeof *site);
    if (!site)
        return errctx_set(err, ST_NOMEM, "no memory to open %s", path);
    (void)snprintf(site->path, sizeof site->path, "%s", path);
    for (size_t n = strlen(site->path); n > 1 && site->path[n - 1] == '/'; n--)
        site->path[n - 1] = '\0';
    site->mode = mode;
    site->lock_fd = -1;
    name_user(site->who, sizeof site->who);
    (void)snprintf(site->program, sizeof site->program, "scancart %s", SCANCART_VERSION);
    *out_site = site;
    return ST_OK;
}

static void free_handle(struct site *site) {
    store_close(site);
    writer_lock_release(site->lock_fd);
    free(site);
}

enum st site_close(struct site *site, struct errctx *err) {
    if (!site)
        return ST_OK;
    site_rollback(site);
    enum st st = ST_OK;
    if (site->mode == SITE_WRITE && site->changed) {
        st = batch_begin(site, err);
        if (!st)
            st = batch_end(site, custody_log_seal(site, err), err);
    }
    free_handle(site); /* the last connection to close folds the log into site.db */
    return st;
}

/* What a writer needs to know before it adds anything. */
static enum st start_writer(struct site *site, struct errctx *err) {
    struct custody_event last;
    enum st st = digest_load(site, site->digests, err);
    if (!st)
        st = custody_last(site, &last, err);
    if (st)
        return st;
    site->clean = !strcmp(last.what, "sealed");
    if (site->schema_version < MIGRATE_NEWEST) {
        int32_t from = site->schema_version;
        st = batch_begin(site, err);
        if (st)
            return st;
        st = migrate_to(site, MIGRATE_NEWEST, err);
        if (!st)
            st = custody_logf(site, err, "upgraded", "{\"from\":%d,\"to\":%d}", (int)from,
                              MIGRATE_NEWEST);
        st = batch_end(site, st, err);
    }
    if (!st)
        files_dir_sweep(site->path);
    return st;
}

static enum st open_handle(struct site *site, struct errctx *err) {
    enum st st = site_db_identify(site->path, err);
    if (!st && site->mode == SITE_WRITE)
        st = writer_lock_take(site->path, &site->lock_fd, err);
    if (!st)
        st = store_open(site, "site.db", false, err);
    if (!st)
        st = site_db_version(site, err);
    if (!st && migrate_verify(site, site->schema_version, err))
        st = errctx_prefix(err, ST_DAMAGED, "%s/site.db", site->path);
    if (!st && site->mode == SITE_WRITE)
        st = site_db_prepare_writer(site, err);
    if (!st && site->mode == SITE_WRITE)
        st = start_writer(site, err);
    return st;
}

enum st site_open(const char *path, enum site_mode mode, struct site **out_site,
                  struct errctx *err) {
    struct site *site = NULL;
    enum st st = new_handle(path, mode, &site, err);
    if (!st)
        st = open_handle(site, err);
    if (!st && site->schema_version < MIGRATE_NEWEST) { /* a reader: upgrade, then read */
        struct site *writer = NULL;
        st = site_open(path, SITE_WRITE, &writer, err);
        if (!st)
            st = site_close(writer, err);
        if (st)
            (void)errctx_prefix(err, ST_UNSUPPORTED,
                                "%s is of schema version %d and cannot be upgraded to %d", path,
                                (int)site->schema_version, MIGRATE_NEWEST);
        free_handle(site);
        return st ? ST_UNSUPPORTED : site_open(path, mode, out_site, err);
    }
    if (st) {
        if (site)
            free_handle(site);
        return st;
    }
    *out_site = site;
    return ST_OK;
}

/* Fills an empty database: schema, who we are, the first custody event. */
static enum st fill_new(struct site *site, const struct site_info *info, struct errctx *err) {
    uint8_t uuid[16];
    sqlite3_randomness(sizeof uuid, uuid);
    uuid[6] = (uint8_t)((uuid[6] & 0x0f) | 0x40); /* RFC 4122, version 4 */
    uuid[8] = (uint8_t)((uuid[8] & 0x3f) | 0x80);
    site->logged = true; /* "created" takes the place of "opened" */
    enum st st = batch_begin(site, err);
    if (st)
        return st;
    st = migrate_to(site, MIGRATE_NEWEST, err);
    struct row_value values[] = {row_int(1), row_blob(uuid, sizeof uuid), row_text(info->name),
                                 row_int(store_now_utc_ns(site))};
    if (!st)
        st = store_insert(site, STORE_SITE, values, 4, NULL, NULL, err);
    if (!st && info->georef.epsg)
        st = insert_georef(site, &info->georef, err);
    if (!st)
        st = custody_log(site, "created", "", err);
    if (!st)
        st = custody_log_seal(site, err);
    return batch_end(site, st, err);
}

enum st site_create(const char *path, const struct site_info *info, struct site **out_site,
                    struct errctx *err) {
    struct site_info wanted = *info;
    struct site *site = NULL;
    enum st st = new_handle(path, SITE_WRITE, &site, err);
    if (st)
        return st;
    if (!wanted.name[0])
        (void)snprintf(wanted.name, sizeof wanted.name, "%.*s", SITE_NAME_MAX - 1,
                       fileio_basename(site->path));
    if (!site_name_is_valid(wanted.name))
        st = errctx_set(err, ST_INVALID, "'%s' cannot be the name of a site", wanted.name);
    if (!st)
        st = check_georef(&wanted.georef, err);
    struct site_db_new made = {0};
    if (!st)
        st = site_db_make_folder(site, &made, err);
    if (!st)
        st = store_open(site, SITE_DB_NEW, true, err);
    if (!st)
        st = site_db_prepare_new(site, err);
    if (!st)
        st = fill_new(site, &wanted, err);
    store_close(site);
    if (!st)
        st = site_db_publish(site, err);
    if (st)
        site_db_unmake(site, &made);
    free_handle(site);
    return st ? st : site_open(path, SITE_WRITE, out_site, err);
}
