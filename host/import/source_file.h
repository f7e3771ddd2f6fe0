/* A foreign file that goes into a site as it came: its bytes, its place in the site. */
#ifndef SC_IMPORT_SOURCE_FILE_H
#define SC_IMPORT_SOURCE_FILE_H

#include "base/hash.h"
#include "base/st.h"
#include "site/job.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct source_file {
    uint8_t *bytes; /* malloc'ed, with a 0 byte behind them */
    size_t size;
    char extension[8];        /* lower case, "bin" where the name has none that a site takes */
    char stem[SITE_NAME_MAX]; /* the name without folder and extension, made fit for a site */
};

/* Reads a file of at most max_bytes. Free with source_file_destroy(), which takes NULL or zeroed.
 */
ST_MUST_CHECK enum st source_file_read(const char *path, size_t max_bytes,
                                       struct source_file *out_file, struct errctx *err);
void source_file_destroy(struct source_file *file);

/* Puts the bytes into the site (frames/) and fills the input of a job with the role. */
ST_MUST_CHECK enum st source_file_put(struct site *site, const struct source_file *file,
                                      const char *role, struct job_hash *out_input,
                                      struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
