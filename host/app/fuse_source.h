/* The samples of one station as fusion takes them, from whatever streams the site has: polar
 * samples of an import, or packets of the cart's own head with the controller's index events. */
#ifndef SC_APP_FUSE_SOURCE_H
#define SC_APP_FUSE_SOURCE_H

#include "base/cart_clock.h"
#include "base/st.h"
#include "base/vec.h"
#include "fusion/rays.h"
#include "fusion/scatter.h"
#include "site/calib.h"
#include "site/job.h"
#include "site/site.h"
#include "site/stream.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { FUSE_SOURCE_SESSIONS = 32, FUSE_SOURCE_INPUTS = 2 * FUSE_SOURCE_SESSIONS + 2 };

/* One session of the cart: a scan that was cut short and gone on with has several. */
struct fuse_source_session {
    int64_t stream_id; /* of the head's packets */
    struct sweep_index *index;
    size_t index_count;
};

struct fuse_source {
    struct site *site;
    struct stream stream; /* "polar" or "head" */
    struct vec3 origin_m; /* samples are relative to this point of the station */
    struct job_hash inputs[FUSE_SOURCE_INPUTS]; /* what the samples follow from */
    size_t input_count;
    struct noise_model noise;
    struct rays_counts counts;      /* of the last pass; head streams only */
    int64_t damaged_packets;        /* bytes that were no packet are skipped */
    struct cart_clock_report clock; /* head streams only; head.pairs 0: placed by arrival alone */
    const char *calibration;        /* "estimated", "nominal", "true"; "none" for imports */
    /* private */
    struct scatter_source source;
    struct stream_reader *reader;
    struct rays *rays;
    struct fuse_source_session session[FUSE_SOURCE_SESSIONS];
    size_t sessions, session_at; /* head streams only */
    struct rig rig;
    struct stream_chunk chunk; /* being unpacked */
    size_t chunk_at;
    int64_t chunk_head_t_ns;
    bool chunk_started;
    struct scatter_sample *ready; /* unpacked, not yet handed out */
    size_t ready_at, ready_count;
    struct scatter_sample *cache; /* the whole stream, where it fits */
    size_t cache_count;
    struct scatter_array cached;
    struct noise_meter *meter; /* while the noise is measured */
    uint32_t row, column;      /* of the polar sample before */
};

struct fuse_source_options {
    enum calib_status calibration; /* 0: the best there is: estimated, else true, else nominal */
    size_t cache_samples;          /* streams up to this size are kept in memory */
    double sigma_m;                /* 0: measured from the stream */
};

/* Opens what a station has; ST_NOT_FOUND if it has no samples. The source's noise is measured in a
 * first pass. */
ST_MUST_CHECK enum st fuse_source_open(struct site *site, int64_t station_id,
                                       const struct fuse_source_options *options,
                                       struct fuse_source *out_source, struct errctx *err);
void fuse_source_close(struct fuse_source *source); /* takes a zeroed one */

/* The record of a kind by the options' order of preference; ST_NOT_FOUND. out_text has
 * CALIB_MAX_BYTES + 1. */
ST_MUST_CHECK enum st fuse_source_calibration(struct site *site, const char *kind,
                                              enum calib_status wanted, struct calib *out_record,
                                              char *out_text, struct errctx *err);
const char *fuse_source_status_name(enum calib_status status);

#endif
