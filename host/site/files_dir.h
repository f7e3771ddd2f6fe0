/* Names of the folders of a site and of the files in them. Only for host/site. */
#ifndef SC_SITE_FILES_DIR_H
#define SC_SITE_FILES_DIR_H

#include "base/fileio.h"
#include "base/hash.h"
#include "base/st.h"
#include "site/files.h"
#include "site/row.h"

#include <stdbool.h>
#include <stdint.h>

enum { FILES_DIR_KINDS = 3 };

/* "frames", "photos", "tiles"; NULL for another number. */
const char *files_dir_name(int kind);

/* 1..7 of a-z 0-9 */
bool files_dir_extension_is_valid(const char *extension);

/* "photos/<64 digits>.tif" */
enum { FILES_DIR_NAME_MAX = 96 };
void files_dir_file(const struct files_entry *entry, char out_name[FILES_DIR_NAME_MAX]);

/* The row of table file that a statement stands on (SELECT *). ST_DAMAGED if it makes no sense. */
ST_MUST_CHECK enum st files_dir_entry(sqlite3_stmt *stmt, struct files_entry *out_entry,
                                      struct errctx *err);

/* True for what an interrupted write of ours may leave. */
bool files_dir_is_leftover(const char *name);

/* Removes leftovers of a crashed writer; only the holder of the lock may. */
void files_dir_sweep(const char *site_path);

#endif
