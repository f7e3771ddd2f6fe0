#include "twin/faults.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct faults_info infos[FAULTS_KINDS] = {
    [FAULTS_PACKET_LOST] = {"packet_lost", "head packets do not arrive", "packets, if no duration",
                            1, 1, 1e6},
    [FAULTS_PACKET_REPEATED] = {"packet_repeated", "a head packet arrives twice", NULL, 1, 1, 1},
    [FAULTS_PACKET_SEQUENCE] = {"packet_sequence", "head packets carry a wrong sequence number",
                                "added to the number", 1000, -1e9, 1e9},
    [FAULTS_BIT_ERROR] = {"bit_error", "bits of head packets flip", "flips a packet", 1, 1, 4096},
    [FAULTS_HEAD_RESET] = {"head_reset", "the head starts anew: counters and time from 0",
                           "s until it sends again", 0.5, 0, 60},
    [FAULTS_ENCODER_SLIP] = {"encoder_slip", "the encoder disc slips on the shaft", "counts", 3,
                             -4096, 4096},
    [FAULTS_INDEX_MISSING] = {"index_missing", "index pulses are not seen by controller and host",
                              NULL, 1, 1, 1},
    [FAULTS_MIRROR_STALL] = {"mirror_stall",
                             "the mirror is blocked: the controller switches all off", NULL, 1, 1,
                             1},
    [FAULTS_MIRROR_SURGE] = {"mirror_surge", "the mirror's drive has another strength", "factor",
                             1.3, 0.1, 4},
    [FAULTS_PAN_STALL] = {"pan_stall", "the pan stands while the motor is stepped", NULL, 1, 1, 1},
    [FAULTS_MISSED_STEPS] = {"missed_steps", "the pan motor loses steps", "steps", 4, 1, 1000},
    [FAULTS_MODBUS_NOISE] = {"modbus_noise", "bytes on the controller's line are damaged",
                             "probability a byte", 0.01, 0, 1},
    [FAULTS_MODBUS_SILENCE] = {"modbus_silence", "the controller does not answer", NULL, 1, 1, 1},
    [FAULTS_FRAME_DROPPED] = {"frame_dropped", "the camera gives no frame", NULL, 1, 1, 1},
    [FAULTS_EXPOSURE_LATE] = {"exposure_late", "a change of exposure comes one frame late",
                              "factor", 2, 0.05, 20},
    [FAULTS_LIGHT_CHANGE] = {"light_change", "the scene's light changes", "factor", 0.6, 0.01, 100},
    [FAULTS_CLOCK_JUMP] = {"clock_jump", "the host's clock jumps", "s", 0.25, -3600, 3600},
    [FAULTS_DISK_FULL] = {"disk_full", "the site's disk takes no more", NULL, 1, 1, 1},
    [FAULTS_POWER_LOSS] = {"power_loss", "everything stops at once", NULL, 1, 1, 1},
    [FAULTS_ESTOP] = {"estop", "the emergency stop is pressed and let go again", NULL, 1, 1, 1},
    [FAULTS_INTERLOCK] = {"interlock", "the laser's interlock opens and closes again", NULL, 1, 1,
                          1},
};

const struct faults_info *faults_info_of(enum faults_kind kind) {
    return &infos[kind];
}

static enum st unknown(const char *name, size_t length, struct errctx *err) {
    char list[512] = "";
    size_t used = 0;
    for (int i = 0; i < FAULTS_KINDS; i++) {
        int n = snprintf(list + used, sizeof list - used, "%s%s", i ? ", " : "", infos[i].name);
        if (n < 0 || (size_t)n >= sizeof list - used)
            break;
        used += (size_t)n;
    }
    return errctx_set(err, ST_NOT_FOUND, "there is no fault '%.*s': it is one of %s",
                      (int)(length < 40 ? length : 40), name, list);
}

/* A number after one of the marks '@', '+', '='; moves *at behind it. */
static bool number(const char **at, double *out) {
    char *end = NULL;
    *out = strtod(*at + 1, &end);
    bool ok = end != *at + 1 && isfinite(*out);
    *at = end;
    return ok;
}

enum st faults_parse(struct faults *faults, const char *text, struct errctx *err) {
    const char *form = "expected NAME@START[+DURATION][=VALUE], times in seconds";
    size_t length = strcspn(text, "@");
    int kind = -1;
    for (int i = 0; i < FAULTS_KINDS; i++)
        if (strlen(infos[i].name) == length && !strncmp(infos[i].name, text, length))
            kind = i;
    if (kind < 0)
        return unknown(text, length, err);
    struct fault fault = {.kind = (enum faults_kind)kind, .value = infos[kind].fallback};
    double start_s = 0, duration_s = 0;
    const char *at = text + length;
    bool ok = *at == '@' && number(&at, &start_s);
    if (ok && *at == '+')
        ok = number(&at, &duration_s);
    if (ok && *at == '=')
        ok = number(&at, &fault.value);
    if (!ok || *at)
        return errctx_set(err, ST_FORMAT, "fault '%.80s': %s", text, form);
    if (!(start_s >= 0 && start_s <= 1e6 && duration_s >= 0 && duration_s <= 1e6))
        return errctx_set(err, ST_INVALID, "fault '%.80s': times are 0 to 1000000 s", text);
    if (!(fault.value >= infos[kind].min && fault.value <= infos[kind].max))
        return errctx_set(err, ST_INVALID, "fault '%.80s': the value (%s) is %g to %g", text,
                          infos[kind].value ? infos[kind].value : "none is taken", infos[kind].min,
                          infos[kind].max);
    if (faults->count >= FAULTS_MAX)
        return errctx_set(err, ST_FULL, "more than %d faults", FAULTS_MAX);
    fault.start_ns = (int64_t)llround(start_s * 1e9);
    fault.duration_ns = (int64_t)llround(duration_s * 1e9);
    faults->list[faults->count++] = fault;
    return ST_OK;
}

const struct fault *faults_at(const struct faults *faults, enum faults_kind kind, int64_t t_ns,
                              int64_t step_ns) {
    for (size_t i = 0; i < faults->count; i++) {
        const struct fault *f = &faults->list[i];
        if (f->kind != kind)
            continue;
        if (f->duration_ns > 0 ? t_ns >= f->start_ns && t_ns < f->start_ns + f->duration_ns
                               : f->start_ns >= t_ns && f->start_ns < t_ns + step_ns)
            return f;
    }
    return NULL;
}
