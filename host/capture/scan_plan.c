#include "capture/scan_plan.h"

#include "base/head_packet.h"

#include <math.h>
#include <string.h>

/* What does not follow from the plan, as measured on the cart's controller: for the forecast alone.
 */
static const double homing_s = 25, spin_up_s = 8, approach_s = 8, finish_s = 14;
static const double slew_steps_s = 4000, slew_ramp_s = 0.8, expose_s = 0.5;

enum { INDEX_EVENT_BYTES = 28, EDGE_BYTES = 16 };

struct scan_plan scan_plan_default(enum scan_plan_quality quality) {
    struct scan_plan plan;
    memset(&plan, 0, sizeof plan);
    plan.pan_steps_per_turn = plan.tilt_steps_per_turn = 28000;
    plan.mirror_hz = 4;
    plan.steps_per_revolution = quality == SCAN_PLAN_PREVIEW ? 12
                                : quality == SCAN_PLAN_FIELD ? 4
                                                             : 3;
    plan.settle_s = 0.3;
    plan.camera = (struct camera_settings){.exposure_s = (double)NAN,
                                           .gain = (double)NAN,
                                           .focus_diopter = (double)NAN,
                                           .white_balance_k = (double)NAN};
    scan_plan_set_range(&plan, -90, 90);
    const double level_deg = 0, step_deg = 40;
    struct errctx err;
    if (scan_plan_set_passes(&plan, &level_deg, 1, step_deg, &err)) /* 9 fit */
        plan.pass_count = 0;
    return plan;
}

void scan_plan_set_range(struct scan_plan *plan, double from_deg, double to_deg) {
    double steps_a_deg = plan->pan_steps_per_turn / 360;
    plan->pan_from_steps = (int32_t)floor(from_deg * steps_a_deg);
    plan->pan_to_steps = (int32_t)ceil(to_deg * steps_a_deg);
}

enum st scan_plan_set_passes(struct scan_plan *plan, const double *tilt_deg, size_t passes,
                             double step_deg, struct errctx *err) {
    if (!(step_deg >= 1 && step_deg <= 360))
        return errctx_set(err, ST_INVALID, "photographs %g degrees apart: 1 to 360 are possible",
                          step_deg);
    uint32_t count = (uint32_t)ceil(360 / step_deg - 1e-6);
    if (passes > SCAN_PLAN_MAX_PASSES || count > SCAN_PLAN_MAX_PHOTOS)
        return errctx_set(err, ST_INVALID, "%zu rounds of %u photographs: at most %d of %d", passes,
                          count, SCAN_PLAN_MAX_PASSES, SCAN_PLAN_MAX_PHOTOS);
    for (size_t p = 0; p < passes; p++) {
        struct scan_plan_pass *pass = &plan->pass[p];
        if (!(fabs(tilt_deg[p]) <= 60))
            return errctx_set(err, ST_INVALID, "photographs at tilt %g: -60 to 60 are possible",
                              tilt_deg[p]);
        pass->tilt_steps = (int32_t)floor(tilt_deg[p] / 360 * plan->tilt_steps_per_turn + 0.5);
        pass->count = count;
        for (uint32_t i = 0; i < count; i++)
            pass->pan_steps[i] =
                (int32_t)floor((-0.5 + ((double)i + 0.5) / count) * plan->pan_steps_per_turn + 0.5);
    }
    plan->pass_count = (uint32_t)passes;
    return ST_OK;
}

enum st scan_plan_check(const struct scan_plan *plan, struct errctx *err) {
    if (!(plan->mirror_hz >= 0.5 && plan->mirror_hz <= 50))
        return errctx_set(err, ST_INVALID, "mirror at %g turns/s: 0.5 to 50 are possible",
                          plan->mirror_hz);
    if (!(plan->steps_per_revolution >= 0.01 && plan->steps_per_revolution <= 1000))
        return errctx_set(err, ST_INVALID, "%g pan steps a mirror turn: 0.01 to 1000 are possible",
                          plan->steps_per_revolution);
    if (!(plan->pan_steps_per_turn >= 100 && plan->tilt_steps_per_turn >= 100))
        return errctx_set(err, ST_INVALID, "fewer than 100 motor steps a turn");
    if (plan->pan_from_steps > plan->pan_to_steps)
        return errctx_set(err, ST_INVALID, "the sweep ends (%.2f deg) before it begins (%.2f deg)",
                          plan->pan_to_steps * 360 / plan->pan_steps_per_turn,
                          plan->pan_from_steps * 360 / plan->pan_steps_per_turn);
    double most = plan->pan_steps_per_turn / 2;
    if (plan->pan_from_steps < -most || plan->pan_to_steps > most)
        return errctx_set(err, ST_INVALID, "the pan turns from -180 to 180 degrees");
    if (scan_plan_rate(plan) > 4000)
        return errctx_set(err, ST_INVALID,
                          "a sweep of %.0f pan steps/s; 4000 are possible: choose a finer "
                          "resolution or a slower mirror",
                          scan_plan_rate(plan));
    if (!(plan->settle_s >= 0 && plan->settle_s <= 10))
        return errctx_set(err, ST_INVALID, "%g s of rest before a photograph: 0 to 10",
                          plan->settle_s);
    return ST_OK;
}

uint32_t scan_plan_photos(const struct scan_plan *plan) {
    uint32_t count = 0;
    for (uint32_t p = 0; p < plan->pass_count; p++)
        count += plan->pass[p].count;
    return count;
}

double scan_plan_rate(const struct scan_plan *plan) {
    return plan->steps_per_revolution * plan->mirror_hz;
}

struct scan_plan_forecast scan_plan_predict(const struct scan_plan *plan, double sample_hz,
                                            uint64_t frame_bytes) {
    struct scan_plan_forecast f = {0};
    double steps = (double)plan->pan_to_steps - (double)plan->pan_from_steps;
    f.total_s = homing_s;
    if (steps > 0) {
        f.sweep_s = steps / scan_plan_rate(plan);
        f.total_s += spin_up_s + approach_s + f.sweep_s + finish_s;
    }
    for (uint32_t p = 0; p < plan->pass_count; p++)
        for (uint32_t i = 0; i < plan->pass[p].count; i++) {
            double way = i ? fabs((double)plan->pass[p].pan_steps[i] -
                                  (double)plan->pass[p].pan_steps[i - 1])
                           : plan->pan_steps_per_turn / 2;
            f.total_s += way / slew_steps_s + slew_ramp_s + plan->settle_s + expose_s;
        }
    double lit_s = f.sweep_s + (steps > 0 ? approach_s + 1 : 0);
    f.samples = (uint64_t)(lit_s * sample_hz);
    double packets = (double)f.samples / HEAD_PACKET_MAX_SAMPLES;
    double turns = lit_s * plan->mirror_hz;
    f.bytes =
        (uint64_t)(packets * HEAD_PACKET_MAX_BYTES + turns * (INDEX_EVENT_BYTES + EDGE_BYTES)) +
        scan_plan_photos(plan) * frame_bytes;
    return f;
}
