/* What a station's scan has got so far, from the site alone: which pan positions the sweep has
 * covered and which photographs are there, so that a scan that was cut short goes on from the first
 * missing position. */
#ifndef SC_CAPTURE_RESUME_H
#define SC_CAPTURE_RESUME_H

#include "base/st.h"
#include "capture/scan_plan.h"
#include "site/site.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { RESUME_MAX_SPANS = 512 };

/* Pan positions [from, to], steps. */
struct resume_span {
    double from_steps, to_steps;
};

struct resume {
    uint32_t sessions;                         /* head streams; 0: nothing has been scanned here */
    struct scan_plan plan;                     /* as it was meant */
    struct resume_span span[RESUME_MAX_SPANS]; /* covered, ascending, apart */
    size_t spans;
    bool end_seen;  /* a session has measured until the pan was at rest at the sweep's end */
    double covered; /* part of the sweep, 0 to 1 */
    bool photo[SCAN_PLAN_MAX_PASSES][SCAN_PLAN_MAX_PHOTOS]; /* is there */
    uint32_t photos;
    int64_t last_stream_id;     /* of the newest head stream */
    char device[SITE_NAME_MAX]; /* name of the first */
    struct scan_plan rest; /* what is still to do: an empty sweep and no passes if all is there */
    bool complete;
};

/* Reads it. ST_NOT_FOUND: the station has no head stream (sessions 0 too). ST_FORMAT: its first one
 * does not say what was planned. Cost: the headers of all chunks, all index events. A pan position
 * is covered if it lies between two index events of the sweep, at most two missed pulses apart,
 * that came no later than the last head packet stored. The sweep is complete up to its end, which
 * lies up to a turn behind its last event, only where an event behind the end says so. */
ST_MUST_CHECK enum st resume_find(struct site *site, int64_t station_id, struct resume *out_resume,
                                  struct errctx *err);

/* Name of the streams of the next session: "twin", "twin.2", ... */
void resume_next_device(const struct resume *resume, char out_name[SITE_NAME_MAX]);

/* Adds a span to spans kept in order, joining what is at most `near` apart. False: no room. */
bool resume_add_span(struct resume_span *spans, size_t *count, size_t capacity,
                     struct resume_span span, double near);

#ifdef __cplusplus
}
#endif
#endif
