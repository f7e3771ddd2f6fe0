/* Calibration records: text blobs (YAML or JSON) as the calibration wrote them, by hash. Never
 * changed; a newer record of the same kind and name is added. */
#ifndef SC_SITE_CALIB_H
#define SC_SITE_CALIB_H

#include "base/hash.h"
#include "base/st.h"
#include "site/site.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum calib_status {
    CALIB_NOMINAL = 1,   /* from a drawing or a data sheet */
    CALIB_ESTIMATED = 2, /* from measurements */
    CALIB_TRUE = 3       /* what a simulator used; never for a real device */
};

enum calib_format { CALIB_YAML = 1, CALIB_JSON = 2 };

enum { CALIB_MAX_BYTES = 1 << 20 };

struct calib {
    int64_t id;
    char kind[SITE_KIND_MAX]; /* "rig", "camera", ... */
    char name[SITE_NAME_MAX]; /* the device: a serial number or a role */
    enum calib_status status;
    enum calib_format format;
    uint8_t sha256[HASH_SHA256_BYTES]; /* of the text; what a job names as its input */
    size_t size_bytes;
    int64_t utc_ns;
};

/* Adds a record; of `record` kind, name, status and format are used. The same text, kind, name and
 * status again gives the id of the record that is there. ST_INVALID for bad names, empty or too
 * large text. */
ST_MUST_CHECK enum st calib_add(struct site *site, const struct calib *record, const void *text,
                                size_t size_bytes, int64_t *out_id, struct errctx *err);

/* The same for a YAML text. */
ST_MUST_CHECK enum st calib_add_yaml(struct site *site, const char *kind, const char *name,
                                     enum calib_status status, const char *text, int64_t *out_id,
                                     struct errctx *err);

/* The newest record of that kind and, unless NULL, that name and status (0: any). ST_NOT_FOUND. */
ST_MUST_CHECK enum st calib_find(struct site *site, const char *kind, const char *name,
                                 enum calib_status status, struct calib *out_record,
                                 struct errctx *err);

/* Copies a record's text, verified against its hash, and a final 0: `capacity` must be at least
 * size_bytes + 1 (ST_NOMEM otherwise). ST_DAMAGED if the hash does not match. out_record may be
 * NULL. */
ST_MUST_CHECK enum st calib_read(struct site *site, int64_t id, struct calib *out_record,
                                 char *out_text, size_t capacity, struct errctx *err);

/* Pages through the records in the order of id, see station_list(). */
ST_MUST_CHECK enum st calib_list(struct site *site, int64_t after_id, struct calib *out_records,
                                 size_t capacity, size_t *out_count, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
