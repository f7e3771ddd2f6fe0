/* What a scan is to do, and what it will take: time, samples, bytes. Pure arithmetic: no device, no
 * site. Pan positions are motor steps from the home position's zero, as the crew commands them by
 * the nominal figure of steps a turn. */
#ifndef SC_CAPTURE_SCAN_PLAN_H
#define SC_CAPTURE_SCAN_PLAN_H

#include "base/st.h"
#include "device/camera_device.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum scan_plan_quality { SCAN_PLAN_PREVIEW, SCAN_PLAN_FIELD, SCAN_PLAN_SURVEY };

enum { SCAN_PLAN_MAX_PHOTOS = 64, SCAN_PLAN_MAX_PASSES = 4 };

/* One round of photographs at one tilt. */
struct scan_plan_pass {
    int32_t tilt_steps;
    uint32_t count;
    int32_t pan_steps[SCAN_PLAN_MAX_PHOTOS]; /* ascending */
};

struct scan_plan {
    int32_t pan_from_steps, pan_to_steps; /* of the sweep, from < to; equal: no sweep (all there) */
    int32_t tilt_steps;                   /* during the sweep */
    double steps_per_revolution;          /* pan steps while the mirror turns once */
    double mirror_hz;
    double pan_steps_per_turn, tilt_steps_per_turn; /* nominal */
    uint32_t pass_count;
    struct scan_plan_pass pass[SCAN_PLAN_MAX_PASSES];
    struct camera_settings camera; /* locked for all passes */
    double settle_s;               /* at rest before a photograph */
};

/* What it will take. Upper bounds: a head that leaves out its blind arc sends less. */
struct scan_plan_forecast {
    double sweep_s, total_s; /* total: homing, spin-up, photographs too */
    uint64_t samples, bytes;
};

/* A full panorama: pan -90 to 90 degrees (the beam goes both ways), tilt 0, mirror at 4 Hz, one
 * pass of 9 photographs 40 degrees apart; 12 (preview), 4 (field) or 3 (survey) steps a revolution.
 */
struct scan_plan scan_plan_default(enum scan_plan_quality quality);

/* Pan range in degrees of the nominal turn, rounded to whole steps outwards. */
void scan_plan_set_range(struct scan_plan *plan, double from_deg, double to_deg);

/* Replaces all passes by `passes` rounds at the given tilts, `step_deg` apart. ST_INVALID for more
 * than there is room for. */
ST_MUST_CHECK enum st scan_plan_set_passes(struct scan_plan *plan, const double *tilt_deg,
                                           size_t passes, double step_deg, struct errctx *err);

/* ST_INVALID with the value that makes no sense. */
ST_MUST_CHECK enum st scan_plan_check(const struct scan_plan *plan, struct errctx *err);

/* sample_hz: of the head; frame_bytes: of one photograph as stored. */
struct scan_plan_forecast scan_plan_predict(const struct scan_plan *plan, double sample_hz,
                                            uint64_t frame_bytes);

/* Photographs in all passes. */
uint32_t scan_plan_photos(const struct scan_plan *plan);

/* Pan speed of the sweep, steps/s. */
double scan_plan_rate(const struct scan_plan *plan);

#ifdef __cplusplus
}
#endif
#endif
