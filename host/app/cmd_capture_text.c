#include "app/cmd_capture_text.h"

#include "app/app_site.h"
#include "base/json.h"
#include "base/rig_yaml.h"
#include "capture/report.h"
#include "capture/resume.h"
#include "capture/status.h"
#include "firmware/shared/faultcode.h"
#include "site/calib.h"
#include "site/custody.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
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

/* What was lost on the way, by the reason: where to look. */
static void warn_losses(const struct head_ledger_totals *t) {
    static const char *const advice[HEAD_LEDGER_REASONS] = {
        [HEAD_LEDGER_USB_LOST] = "look at the head's cable and hub",
        [HEAD_LEDGER_CRC] = "look at the head's cable",
        [HEAD_LEDGER_RING_FULL] = "the disk is too slow",
        [HEAD_LEDGER_POWER_LOSS] = "between two sessions",
        [HEAD_LEDGER_DISK_FULL] = "make room",
        [HEAD_LEDGER_HEAD_OVERRUN] = "the head lost them itself"};
    for (int i = 0; i < HEAD_LEDGER_REASONS; i++)
        if (t->lost_packets[i] || t->lost_samples[i])
            (void)fprintf(stderr, "warning: %llu packets with %llu samples lost (%s): %s\n",
                          (unsigned long long)t->lost_packets[i],
                          (unsigned long long)t->lost_samples[i],
                          head_ledger_reason_name((enum head_ledger_reason)i), advice[i]);
    if (t->resets)
        (void)fprintf(stderr, "warning: the head has restarted %llu times: look at its power\n",
                      (unsigned long long)t->resets);
    if (t->sequence || t->repeated)
        (void)fprintf(
            stderr, "warning: %llu packets with a wrong number, %llu came twice: nothing is lost\n",
            (unsigned long long)t->sequence, (unsigned long long)t->repeated);
}

/* What the fit of the clocks has met on the way. */
static void warn_incidents(const struct report *r) {
    static const enum cart_clock_kind told[] = {
        CART_CLOCK_HEAD_JUMP,   CART_CLOCK_ENCODER_SLIP, CART_CLOCK_MIRROR_SLOW,
        CART_CLOCK_INDEX_SHIFT, CART_CLOCK_EVENTS_LOST,  CART_CLOCK_CONTROLLER_RESTART,
        CART_CLOCK_HOST_JUMP,   CART_CLOCK_AMBIGUOUS};
    for (size_t i = 0; i < sizeof told / sizeof told[0]; i++)
        if (r->clock.incidents[told[i]])
            (void)fprintf(stderr, "warning: %s (%llu times)\n", cart_clock_kind_text(told[i]),
                          (unsigned long long)r->clock.incidents[told[i]]);
    if (r->clock.missing_events > 1 || r->clock.spurious_events)
        (void)fprintf(
            stderr,
            "warning: %llu index pulses were missing, %llu came from nowhere: look at the "
            "mirror's index sensor\n",
            (unsigned long long)r->clock.missing_events,
            (unsigned long long)r->clock.spurious_events);
}

void cmd_capture_text_warnings(const struct session_result *result) {
    warn_losses(&result->last.counts.head);
    if (result->realtime_note[0])
        (void)fprintf(stderr, "warning: %s\n", result->realtime_note);
    if (result->last.warnings)
        (void)fprintf(stderr, "warning: %s%s\n", result->last.warning,
                      result->last.warnings > 1 ? " (and others before it)" : "");
}

/* ---- the report ---- */

static double percent(uint64_t part, uint64_t whole) {
    return whole ? 100 * (double)part / (double)whole : 0;
}

static const char *state_text(const struct session_status *s) {
    return s->laser_on                             ? "laser ON"
           : s->motors_on                          ? "laser off, motors ON"
           : s->controller_state == CTLSTATE_FAULT ? "laser and motors off, fault latched"
                                                   : "laser and motors off";
}

static void print_clock(const struct report *r) {
    const struct cart_clock_report *c = &r->clock;
    if (!r->has_clock || !c->head.pairs)
        return;
    (void)printf("  clocks      head to controller %.2f us rms over %llu turns (drift %+.1f ppm), "
                 "host %.0f us rms (%+.1f ppm)\n",
                 c->head.rms_ns * 1e-3, (unsigned long long)c->head.pairs, c->head.drift_ppm,
                 c->host.rms_ns * 1e-3, c->host.drift_ppm);
    if (c->missing_events || c->spurious_events || c->missing_edges || c->spurious_edges)
        (void)printf(
            "              index events: %llu missing, %llu spurious; edges: %llu missing, "
            "%llu spurious\n",
            (unsigned long long)c->missing_events, (unsigned long long)c->spurious_events,
            (unsigned long long)c->missing_edges, (unsigned long long)c->spurious_edges);
}

static void print_ledger(const struct report *r, const struct session_result *result) {
    const struct head_ledger_totals *t = &r->head;
    uint64_t lost = head_ledger_lost_samples(t);
    (void)printf(
        "  ledger      %llu numbered = %llu stored + %llu lost + %llu not sent (blind arc)",
        (unsigned long long)(t->samples + lost + t->not_sent), (unsigned long long)t->samples,
        (unsigned long long)lost, (unsigned long long)t->not_sent);
    for (size_t i = 0; i < r->losses; i++)
        (void)printf("%s %lld %s", i ? "," : "; lost:", (long long)r->loss[i].items,
                     r->loss[i].reason);
    (void)printf("\n");
    if (t->resets || t->sequence || t->repeated || t->damaged_bytes)
        (void)printf("              head: %llu resets, %llu packets with a wrong number, %llu "
                     "repeated, %llu damaged bytes\n",
                     (unsigned long long)t->resets, (unsigned long long)t->sequence,
                     (unsigned long long)t->repeated, (unsigned long long)t->damaged_bytes);
    if (result->last.counts.unstored_packets)
        (void)printf("              %llu packets were measured and could not be stored\n",
                     (unsigned long long)result->last.counts.unstored_packets);
}

static void print_text(const char *path, const struct station *station,
                       const struct session_result *result, const struct report *r,
                       const struct resume *resume) {
    const struct head_ledger_totals *t = &r->head;
    char samples[24], bytes[APP_SITE_TEXT_MAX];
    (void)printf("%s: station %s, %s: %.1f %% of the sweep, %u of %u photographs; %s\n", path,
                 station->name,
                 resume->complete             ? "complete"
                 : result->last.elapsed_s > 0 ? "cut short, go on with --resume"
                                              : "not complete",
                 resume->covered * 100, resume->photos, scan_plan_photos(&resume->plan),
                 state_text(&result->last));
    (void)printf("  samples     %s: %.1f %% returned, %.1f %% no return, %.2f %% dropped, %.2f %% "
                 "saturated; %s in the site\n",
                 status_count(t->samples, samples, sizeof samples), percent(t->returns, t->samples),
                 percent(t->no_returns, t->samples), percent(t->dropped, t->samples),
                 percent(t->saturated, t->samples), app_site_bytes(r->stored_bytes, bytes));
    if (isfinite(r->sphere_covered))
        (void)printf("  sphere      %.1f %% looked at, %.1f %% returned something; %.2f %% of the "
                     "samples could not be placed\n",
                     r->sphere_covered * 100, r->sphere_returned * 100,
                     percent(r->unplaced, r->placed + r->unplaced));
    print_ledger(r, result);
    print_clock(r);
    if (r->turns)
        (void)printf("  mirror      %.4f Hz +- %.2f %% over %llu turns of the sweep\n"
                     "  pan         %.4f steps a turn +- %.4f, at most %.3f off\n",
                     r->mirror_hz, 100 * r->mirror_hz_sigma / r->mirror_hz,
                     (unsigned long long)r->turns, r->pan_step, r->pan_step_sigma,
                     r->pan_step_worst);
    if (result->last.verified)
        (void)printf("  homing      the pan was %d steps off when it was homed again\n",
                     (int)result->last.lost_steps);
}

static void json_losses(struct json *json, const struct report *r) {
    struct cJSON *list = json_array(json, NULL, "ledger");
    for (size_t i = 0; i < r->losses; i++) {
        struct cJSON *o = json_object(json, list, NULL);
        json_text(json, o, "reason", r->loss[i].reason);
        json_integer(json, o, "entries", r->loss[i].entries);
        json_integer(json, o, "items", r->loss[i].items);
    }
}

static void json_head(struct json *json, const struct report *r) {
    const struct head_ledger_totals *t = &r->head;
    struct cJSON *o = json_object(json, NULL, "samples");
    uint64_t lost = head_ledger_lost_samples(t);
    json_integer(json, o, "numbered", (int64_t)(t->samples + lost + t->not_sent));
    json_integer(json, o, "stored", (int64_t)t->samples);
    json_integer(json, o, "lost", (int64_t)lost);
    json_integer(json, o, "not_sent", (int64_t)t->not_sent);
    json_integer(json, o, "returns", (int64_t)t->returns);
    json_integer(json, o, "no_returns", (int64_t)t->no_returns);
    json_integer(json, o, "dropped", (int64_t)t->dropped);
    json_integer(json, o, "saturated", (int64_t)t->saturated);
    json_integer(json, o, "placed", (int64_t)r->placed);
    json_integer(json, o, "unplaced", (int64_t)r->unplaced);
    o = json_object(json, NULL, "packets");
    json_integer(json, o, "stored", (int64_t)t->packets);
    json_integer(json, o, "missing", r->ledger_packets);
    json_integer(json, o, "resets", (int64_t)t->resets);
    json_integer(json, o, "sequence", (int64_t)t->sequence);
    json_integer(json, o, "repeated", (int64_t)t->repeated);
    json_integer(json, o, "damaged_bytes", (int64_t)t->damaged_bytes);
}

static void json_clock(struct json *json, const struct report *r) {
    const struct cart_clock_report *c = &r->clock;
    struct cJSON *o = json_object(json, NULL, "clocks");
    json_integer(json, o, "turns", (int64_t)c->head.pairs);
    json_number(json, o, "head_rms_us", c->head.rms_ns * 1e-3);
    json_number(json, o, "head_drift_ppm", c->head.drift_ppm);
    json_number(json, o, "host_rms_us", c->host.rms_ns * 1e-3);
    json_number(json, o, "host_drift_ppm", c->host.drift_ppm);
    json_integer(json, o, "missing_events", (int64_t)c->missing_events);
    json_integer(json, o, "spurious_events", (int64_t)c->spurious_events);
    json_integer(json, o, "missing_edges", (int64_t)c->missing_edges);
    json_integer(json, o, "spurious_edges", (int64_t)c->spurious_edges);
}

static void json_report(struct json *json, const char *path, const struct station *station,
                        const struct session_result *result, enum st ended, const struct report *r,
                        const struct resume *resume) {
    const struct recorder_counts *counts = &result->last.counts;
    json_init_object(json);
    json_text(json, NULL, "site", path);
    json_text(json, NULL, "station", station->name);
    json_text(json, NULL, "ended", ended ? st_name(ended) : "done");
    json_text(json, NULL, "cart", state_text(&result->last));
    json_boolean(json, NULL, "complete", resume->complete);
    json_number(json, NULL, "swept", resume->covered);
    json_integer(json, NULL, "photos", resume->photos);
    json_integer(json, NULL, "photos_planned", scan_plan_photos(&resume->plan));
    json_integer(json, NULL, "sessions", r->sessions);
    json_number(json, NULL, "elapsed_s", result->last.elapsed_s);
    json_head(json, r);
    json_losses(json, r);
    json_integer(json, NULL, "unstored_packets", (int64_t)counts->unstored_packets);
    json_number(json, NULL, "sphere_covered", r->sphere_covered);
    json_number(json, NULL, "sphere_returned", r->sphere_returned);
    json_clock(json, r);
    json_number(json, NULL, "mirror_hz", r->mirror_hz);
    json_number(json, NULL, "mirror_hz_sigma", r->mirror_hz_sigma);
    json_number(json, NULL, "pan_step", r->pan_step);
    json_number(json, NULL, "pan_step_sigma", r->pan_step_sigma);
    json_number(json, NULL, "pan_step_worst", r->pan_step_worst);
    if (result->last.verified)
        json_integer(json, NULL, "pan_lost_steps", result->last.lost_steps);
    else
        json_null(json, NULL, "pan_lost_steps");
    json_integer(json, NULL, "stored_bytes", r->stored_bytes);
    json_integer(json, NULL, "batches", (int64_t)counts->batches);
    json_integer(json, NULL, "failed_batches", (int64_t)counts->failed_batches);
    json_number(json, NULL, "longest_batch_s", (double)counts->longest_batch_ns * 1e-9);
    json_number(json, NULL, "ring_peak", result->last.ring_peak);
    json_integer(json, NULL, "warnings", result->last.warnings);
    json_text(json, NULL, "warning", result->last.warning);
}

/* JSON has no NaN: what is not known is -1. */
static double known(double value) {
    return isfinite(value) ? value : -1;
}

/* The report's figures as a custody event: what the crew saw, kept with what it is about. */
static enum st keep(struct site *site, const struct station *station, const struct report *r,
                    const struct resume *resume, struct errctx *err) {
    char detail[SITE_TEXT_MAX];
    const struct head_ledger_totals *t = &r->head;
    const struct cart_clock_report *c = &r->clock;
    bool clock = r->has_clock && c->head.pairs;
    (void)snprintf(
        detail, sizeof detail,
        "{\"station\": %lld, \"complete\": %s, \"swept\": %.4f, \"photos\": %u, \"samples\": %llu, "
        "\"lost\": %llu, \"not_sent\": %llu, \"returns\": %llu, \"no_returns\": %llu, "
        "\"dropped\": %llu, \"ledger_packets\": %lld, \"sphere_covered\": %.4f, "
        "\"sphere_returned\": %.4f, \"head_rms_us\": %.3f, \"host_rms_us\": %.1f, "
        "\"mirror_hz\": %.5f, \"mirror_hz_sigma\": %.5f, \"pan_step\": %.5f, "
        "\"pan_step_sigma\": %.5f}",
        (long long)station->id, resume->complete ? "true" : "false", resume->covered,
        resume->photos, (unsigned long long)t->samples,
        (unsigned long long)head_ledger_lost_samples(t), (unsigned long long)t->not_sent,
        (unsigned long long)t->returns, (unsigned long long)t->no_returns,
        (unsigned long long)t->dropped, (long long)r->ledger_packets, known(r->sphere_covered),
        known(r->sphere_returned), known(clock ? c->head.rms_ns * 1e-3 : -1),
        known(clock ? c->host.rms_ns * 1e-3 : -1), known(r->mirror_hz), known(r->mirror_hz_sigma),
        known(r->pan_step), known(r->pan_step_sigma));
    return custody_add(site, "capture.report", detail, err);
}

/* The best record of the rig that the site has; false: none. */
static bool find_rig(struct site *site, struct rig *out_rig) {
    static const enum calib_status order[] = {CALIB_ESTIMATED, CALIB_NOMINAL};
    struct calib record;
    struct errctx err;
    for (size_t i = 0; i < sizeof order / sizeof order[0]; i++) {
        if (calib_find(site, "rig", NULL, order[i], &record, &err))
            continue;
        char *text = malloc(record.size_bytes + 1);
        bool good = text &&
                    !calib_read(site, record.id, &record, text, record.size_bytes + 1, &err) &&
                    !rig_yaml_read(text, record.size_bytes, record.name, out_rig, &err);
        free(text);
        return good;
    }
    return false;
}

enum st cmd_capture_text_report(struct site *site, const char *path, const struct station *station,
                                const struct session_result *result, enum st ended, bool json,
                                struct errctx *err) {
    struct resume *resume = calloc(1, sizeof *resume);
    struct report report;
    struct rig rig;
    bool has_rig = find_rig(site, &rig);
    enum st st = resume ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for the report");
    if (!st)
        st = resume_find(site, station->id, resume, err);
    if (!st)
        st = report_make(site, station->id, has_rig ? &rig : NULL, &report, err);
    if (!st)
        warn_incidents(&report);
    if (!st && json) {
        struct json out;
        json_report(&out, path, station, result, ended, &report, resume);
        st = json_write(&out, stdout, err);
        json_fini(&out);
    } else if (!st) {
        print_text(path, station, result, &report, resume);
    }
    if (!st && ended != ST_FULL)
        st = keep(site, station, &report, resume, err);
    free(resume);
    return st;
}
