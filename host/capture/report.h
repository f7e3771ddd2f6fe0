/* What a scan was worth, from the site alone: covered share of the sphere, samples and what became
 * of them, the ledger, how well the clocks fit, how regular mirror and pan were. Independent of
 * what the session counted; the two must agree. */
#ifndef SC_CAPTURE_REPORT_H
#define SC_CAPTURE_REPORT_H

#include "base/cart_clock.h"
#include "base/rig.h"
#include "base/st.h"
#include "capture/head_ledger.h"
#include "site/site.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { REPORT_REASONS = 12 };

struct report_loss {
    char reason[SITE_NAME_MAX];
    int64_t entries, items;
};

struct report {
    uint32_t sessions;
    /* the head, counted again from what is stored */
    struct head_ledger_totals head;
    int64_t ledger_packets;                  /* in the site's ledger */
    struct report_loss loss[REPORT_REASONS]; /* of all streams */
    size_t losses;
    int64_t index_events, index_missing; /* stored; in the ledger */
    int64_t edges;
    int64_t frames;
    int64_t payload_bytes, stored_bytes;
    /* geometry; all samples of the sweep that could be placed, from the sweep's station */
    uint64_t placed, unplaced;
    double sphere_covered; /* part of 4 pi that a beam went to, in cells of 1 degree; NaN: no rig */
    double sphere_returned;              /* part of it that gave a range */
    double pan_from_steps, pan_to_steps; /* of the sweep's index events; NaN: none */
    /* clocks, the worst of the sessions */
    struct cart_clock_report clock;
    bool has_clock;
    /* regularity, over the sweep's turns */
    uint64_t turns;
    double mirror_hz, mirror_hz_sigma;
    double pan_step, pan_step_sigma; /* motor steps a turn */
    double pan_step_worst;           /* largest deviation from the mean */
};

/* Reads the station's streams once. rig: NULL if there is none: then no geometry. Errors of the
 * site; ST_NOT_FOUND if there is no head stream. Damaged chunks are counted as unplaced. Cost:
 * about 15 million samples a second. */
ST_MUST_CHECK enum st report_make(struct site *site, int64_t station_id, const struct rig *rig,
                                  struct report *out_report, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
