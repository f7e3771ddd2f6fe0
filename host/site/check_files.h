/* The part of site_check() that walks the folders. Only for host/site. */
#ifndef SC_SITE_CHECK_FILES_H
#define SC_SITE_CHECK_FILES_H

#include "site/check_walk.h"

#include <stdbool.h>

/* Every row of table file has its file with the right bytes; what else lies about is a warning. */
ST_MUST_CHECK enum st check_files(struct check_walk *walk);

/* True if no process holds the writer's lock just now. */
bool check_files_no_writer(const char *site_path);

#endif
