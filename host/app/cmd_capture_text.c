#include "app/cmd_capture_text.h"

#include "app/app_site.h"
#include "capture/status.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const char *minutes(double seconds, char *out_text, size_t size) {
    if (seconds < 90)
        (void)snprintf(out_text, size, "%.0f s", seconds);
    else
        (void)snprintf(out_text, size, "%.0f min", ceil(seconds / 60));
    return out_text;
}

void cmd_capture_text_plan(const char *path, const char *station, const struct scan_plan *plan,
                           const struct scan_plan_forecast *forecast, double covered) {
    char samples[24], bytes[APP_SITE_TEXT_MAX], time[24];
    double deg = 360 / plan->pan_steps_per_turn;
    if (isfinite(covered))
        (void)fprintf(stderr, "%s: station %s goes on, %.1f %% of the sweep is there\n", path,
                      station, covered * 100);
    (void)fprintf(stderr,
                  "%s: station %s, pan %.1f to %.1f deg, %.3g steps a turn at %.3g Hz, %u "
                  "photographs: about %s, at most %s samples, %s\n",
                  path, station, plan->pan_from_steps * deg, plan->pan_to_steps * deg,
                  plan->steps_per_revolution, plan->mirror_hz, scan_plan_photos(plan),
                  minutes(forecast->total_s, time, sizeof time),
                  status_count(forecast->samples, samples, sizeof samples),
                  app_site_bytes((int64_t)forecast->bytes, bytes));
}

void cmd_capture_text_warnings(const struct session_result *result) {
    if (result->realtime_note[0])
        (void)fprintf(stderr, "warning: %s\n", result->realtime_note);
    if (result->last.warnings)
        (void)fprintf(stderr, "warning: %s%s\n", result->last.warning,
                      result->last.warnings > 1 ? " (and others before it)" : "");
}

enum st cmd_capture_text_report(struct site *site, const char *path, const struct station *station,
                                const struct session_result *result, enum st ended, bool json,
                                struct errctx *err) {
    (void)site;
    (void)station;
    (void)ended;
    (void)json;
    (void)err;
    (void)printf("%s: %llu samples\n", path, (unsigned long long)result->last.counts.head.samples);
    return ST_OK;
}
