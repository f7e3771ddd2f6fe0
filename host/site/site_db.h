/* The file site.db itself: recognising one, its pragmas, and making a new one so that it is there
 * whole or not at all. Only for host/site. */
#ifndef SC_SITE_SITE_DB_H
#define SC_SITE_SITE_DB_H

#include "base/st.h"
#include "site/store.h"

#include <stdbool.h>

/* The name of a database until it is complete. */
#define SITE_DB_NEW "site.db.new"

/* ST_OK if PATH/site.db is an SQLite file by its first bytes. ST_NOT_FOUND, ST_FORMAT,
 * ST_PERMISSION. */
ST_MUST_CHECK enum st site_db_identify(const char *site_path, struct errctx *err);

/* Reads application id and schema version into the handle. ST_UNSUPPORTED for a newer one,
 * ST_FORMAT for another program's database. */
ST_MUST_CHECK enum st site_db_version(struct site *site, struct errctx *err);

/* Durability and checkpoints of a writer; page size and log of a new database. */
ST_MUST_CHECK enum st site_db_prepare_writer(struct site *site, struct errctx *err);
ST_MUST_CHECK enum st site_db_prepare_new(struct site *site, struct errctx *err);

/* What site_create() made and must undo on failure. */
struct site_db_new {
    bool folder, locked;
};

/* Makes the folder (or takes an empty one), locks it, makes the folders in it. */
ST_MUST_CHECK enum st site_db_make_folder(struct site *site, struct site_db_new *out_made,
                                          struct errctx *err);
/* Renames the closed new database into place and flushes the folder. */
ST_MUST_CHECK enum st site_db_publish(struct site *site, struct errctx *err);
void site_db_unmake(struct site *site, const struct site_db_new *made);

#endif
