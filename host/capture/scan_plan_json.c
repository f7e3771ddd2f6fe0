#include "capture/scan_plan_json.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <string.h>

enum st scan_plan_json_write(const struct scan_plan *plan, char *out_text, size_t size) {
    int n = snprintf(out_text, size,
                     "{\"pan_from_steps\": %d, \"pan_to_steps\": %d, \"tilt_steps\": %d, "
                     "\"steps_per_revolution\": %.9g, \"mirror_hz\": %.9g, "
                     "\"pan_steps_per_turn\": %.9g, \"tilt_steps_per_turn\": %.9g, "
                     "\"settle_s\": %.9g, \"passes\": [",
                     plan->pan_from_steps, plan->pan_to_steps, plan->tilt_steps,
                     plan->steps_per_revolution, plan->mirror_hz, plan->pan_steps_per_turn,
                     plan->tilt_steps_per_turn, plan->settle_s);
    for (uint32_t p = 0; p < plan->pass_count && n >= 0 && (size_t)n < size; p++)
        n += snprintf(out_text + n, size - (size_t)n, "%s{\"tilt_steps\": %d, \"count\": %u}",
                      p ? ", " : "", plan->pass[p].tilt_steps, plan->pass[p].count);
    if (n >= 0 && (size_t)n < size)
        n += snprintf(out_text + n, size - (size_t)n, "]}");
    return n >= 0 && (size_t)n < size ? ST_OK : ST_NOMEM;
}

static bool number(const cJSON *o, const char *key, double min, double max, double *out) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(o, key);
    if (!cJSON_IsNumber(item) || !(item->valuedouble >= min && item->valuedouble <= max))
        return false;
    *out = item->valuedouble;
    return true;
}

static bool read_passes(const cJSON *list, struct scan_plan *plan) {
    const cJSON *item = NULL;
    double tilt_deg[SCAN_PLAN_MAX_PASSES], tilt = 0, count = 0, step_deg = 0;
    size_t passes = 0;
    struct errctx err;
    cJSON_ArrayForEach(item, list) {
        if (passes == SCAN_PLAN_MAX_PASSES || !number(item, "tilt_steps", -1e6, 1e6, &tilt) ||
            !number(item, "count", 1, SCAN_PLAN_MAX_PHOTOS, &count))
            return false;
        tilt_deg[passes++] = tilt * 360 / plan->tilt_steps_per_turn;
        step_deg = 360 / count;
    }
    plan->pass_count = 0;
    return !passes || !scan_plan_set_passes(plan, tilt_deg, passes, step_deg, &err);
}

static bool read_object(const cJSON *o, struct scan_plan *plan) {
    double from = 0, to = 0, tilt = 0;
    bool good = number(o, "pan_from_steps", -1e6, 1e6, &from) &&
                number(o, "pan_to_steps", -1e6, 1e6, &to) &&
                number(o, "tilt_steps", -1e6, 1e6, &tilt) &&
                number(o, "steps_per_revolution", 0.01, 1000, &plan->steps_per_revolution) &&
                number(o, "mirror_hz", 0.5, 50, &plan->mirror_hz) &&
                number(o, "pan_steps_per_turn", 100, 1e7, &plan->pan_steps_per_turn) &&
                number(o, "tilt_steps_per_turn", 100, 1e7, &plan->tilt_steps_per_turn) &&
                number(o, "settle_s", 0, 10, &plan->settle_s);
    plan->pan_from_steps = (int32_t)from;
    plan->pan_to_steps = (int32_t)to;
    plan->tilt_steps = (int32_t)tilt;
    return good && read_passes(cJSON_GetObjectItemCaseSensitive(o, "passes"), plan);
}

enum st scan_plan_json_read(const char *text, struct scan_plan *out_plan, struct errctx *err) {
    struct scan_plan plan = scan_plan_default(SCAN_PLAN_FIELD);
    cJSON *whole = cJSON_Parse(text);
    const cJSON *inner = cJSON_GetObjectItemCaseSensitive(whole, "plan");
    bool good = whole && read_object(inner ? inner : whole, &plan);
    cJSON_Delete(whole);
    if (!good || scan_plan_check(&plan, err))
        return errctx_set(err, ST_FORMAT, "the station does not say how it was to be scanned");
    *out_plan = plan;
    return ST_OK;
}
