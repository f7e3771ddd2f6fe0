/* Jobs: which inputs, parameters and program version made which outputs. What is up to date is
 * found again by its key and not made twice; what is shown can be followed back to what was
 * measured. */
#ifndef SC_SITE_JOB_H
#define SC_SITE_JOB_H

#include "base/hash.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { JOB_MAX_HASHES = 65536, JOB_PARAMETERS_MAX_BYTES = 1 << 20 };

/* One input or output. A hash in a site is the hash of a file (files.h), of a calibration record
 * (calib.h), a link of a stream's chain (stream.h), or another job's key; an input from outside has
 * outside = true. */
struct job_hash {
    char role[SITE_KIND_MAX]; /* "frame", "stream", "camera", "photo", ... */
    uint8_t sha256[HASH_SHA256_BYTES];
    bool outside; /* an imported file that is not in the site */
};

struct job {
    int64_t id;                    /* output only */
    char kind[SITE_KIND_MAX];      /* "import.photo", "fuse.photo", ... */
    const char *parameters;        /* JSON object; stored with sorted keys and no white space */
    char program[SITE_NAME_MAX];   /* name and version of what computes; part of the key */
    const struct job_hash *inputs; /* in an order that the kind fixes */
    size_t input_count;
    const struct job_hash *outputs;
    size_t output_count;
    double seconds;
    int64_t utc_ns; /* output only */
};

/* Stores a finished job; id, utc_ns are ignored. Of jobs with the same key the newest
 * counts.
 * ST_FORMAT if the parameters are not a JSON object; ST_NOT_FOUND if an input or output that is not
 * `outside` is not in the site; ST_INVALID. */
ST_MUST_CHECK enum st job_add(struct site *site, const struct job *job, int64_t *out_id,
                              struct errctx *err);

/* The job with the same kind, parameters, program and inputs, if all its outputs are still in the
 * site: then there is nothing to do. ST_NOT_FOUND: it must run. From `wanted` outputs, id, seconds
 * are ignored. The result is read with job_read(). */
ST_MUST_CHECK enum st job_find(struct site *site, const struct job *wanted, int64_t *out_id,
                               struct errctx *err);

/* A whole job in one allocation; free it with job_free(). */
ST_MUST_CHECK enum st job_read(struct site *site, int64_t id, struct job **out_job,
                               struct errctx *err);
void job_free(struct job *job); /* takes NULL */

/* Ids of jobs of a kind (NULL: all) in order, see station_list(). */
ST_MUST_CHECK enum st job_list(struct site *site, const char *kind, int64_t after_id,
                               int64_t *out_ids, size_t capacity, size_t *out_count,
                               struct errctx *err);

/* The key: SHA-256 over kind, canonical parameters, program and inputs. */
ST_MUST_CHECK enum st job_key(const struct job *job, uint8_t out_key[HASH_SHA256_BYTES],
                              struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
