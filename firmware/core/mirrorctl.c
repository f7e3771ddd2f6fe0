#include "firmware/core/mirrorctl.h"
#include "firmware/hal/hal_time.h"

#define DRIVE_MAX 10000
/* One millirev/s is 1e9 / period_us; a period is judged against it without dividing where possible.
 */
#define MRPS_US 1000000000u

static int32_t clamp(int64_t value, int32_t low, int32_t high) {
    return value < low ? low : value > high ? high : (int32_t)value;
}

void mirrorctl_init(struct mirrorctl *mirror, const struct mirrorctl_params *params) {
    *mirror = (struct mirrorctl){.params = *params, .encoder_mrps = -1};
}

/* Feed forward + proportional + integral, 0 to DRIVE_MAX. */
static uint16_t drive_for(const struct mirrorctl *mirror, int32_t error_mrps) {
    int64_t drive = (int64_t)mirror->params.feed * mirror->target_mrps / 1000 +
                    (int64_t)mirror->params.gain * error_mrps / 1000 + mirror->integral / 1024;
    return (uint16_t)clamp(drive, 0, DRIVE_MAX);
}

uint16_t mirrorctl_target(struct mirrorctl *mirror, uint16_t target_mrps, uint64_t now_us) {
    if (target_mrps != mirror->target_mrps) {
        mirror->target_since_us = now_us;
        mirror->integral = 0;
    }
    mirror->target_mrps = target_mrps;
    mirror->drive = target_mrps ? drive_for(mirror, target_mrps - mirror->speed_mrps) : 0;
    return mirror->drive;
}

void mirrorctl_abort(struct mirrorctl *mirror) {
    mirror->target_mrps = 0;
    mirror->integral = 0;
    mirror->drive = 0;
}

static void control(struct mirrorctl *mirror, int32_t actual_mrps) {
    if (!mirror->target_mrps)
        return;
    int32_t error = mirror->target_mrps - actual_mrps;
    uint16_t drive = drive_for(mirror, error);
    bool stuck = (drive == DRIVE_MAX && error > 0) || (drive == 0 && error < 0);
    if (!stuck) {
        int64_t sum = mirror->integral + (int64_t)mirror->params.integral * error * 1024 / 1000;
        mirror->integral = clamp(sum, -DRIVE_MAX * 1024, DRIVE_MAX * 1024);
        drive = drive_for(mirror, error);
    }
    mirror->drive = drive;
}

bool mirrorctl_index(struct mirrorctl *mirror, uint64_t t_us, uint16_t turns) {
    if (!mirror->index_seen) {
        mirror->index_seen = true;
        mirror->index_us = t_us;
        return true;
    }
    uint64_t period = (t_us - mirror->index_us) / turns;
    if (period * mirror->params.max_mrps * 2 < MRPS_US)
        return false;
    mirror->index_us = t_us;
    if (period > UINT32_MAX / 2) { /* stood for half an hour */
        mirror->period_us = 0;
        mirror->good_periods = 0;
        return true;
    }
    mirror->period_us = (uint32_t)period;
    bool good =
        period * mirror->params.safe_mrps <= MRPS_US && period * mirror->params.max_mrps >= MRPS_US;
    if (!good)
        mirror->good_periods = 0;
    else if (mirror->good_periods < 2)
        mirror->good_periods++;
    control(mirror, clamp((int64_t)(MRPS_US / period), 0, UINT16_MAX));
    return true;
}

/* Counts over the last MIRRORCTL_WINDOW ticks; the counter is 16 bits wide and the window short. */
static void encoder_speed(struct mirrorctl *mirror, uint16_t count, int32_t *out_low,
                          int32_t *out_high) {
    uint16_t before = mirror->counts[mirror->window_at];
    mirror->counts[mirror->window_at] = count;
    mirror->window_at = (uint8_t)((mirror->window_at + 1) % MIRRORCTL_WINDOW);
    if (mirror->window_fill < MIRRORCTL_WINDOW) {
        mirror->window_fill++;
        mirror->encoder_mrps = -1;
        return;
    }
    int32_t counts = (int16_t)(uint16_t)(count - before);
    /* counts / (counts_per_rev * window) in millirev/s; one count of quantisation either way */
    uint32_t scale = MRPS_US / (MIRRORCTL_WINDOW * HAL_TICK_US);
    int32_t per_rev = mirror->params.encoder_counts;
    *out_low = (int32_t)((int64_t)(counts - 1) * scale / per_rev);
    *out_high = (int32_t)((int64_t)(counts + 1) * scale / per_rev);
    mirror->encoder_mrps = clamp((int64_t)counts * scale / per_rev, 0, UINT16_MAX);
}

/* Upper bound of the speed by the index: the last period's, or what the time since then still
 * allows. */
static int32_t index_speed(const struct mirrorctl *mirror, uint64_t now_us) {
    uint64_t since = now_us - mirror->index_us;
    if (!mirror->period_us || since > 4000000u)
        return 0;
    uint64_t longest = since > mirror->period_us ? since : mirror->period_us;
    return clamp((int64_t)(MRPS_US / longest), 0, UINT16_MAX);
}

void mirrorctl_tick(struct mirrorctl *mirror, uint64_t now_us, uint16_t encoder_count) {
    const struct mirrorctl_params *params = &mirror->params;
    int32_t speed = index_speed(mirror, now_us), low = 0, high = speed;
    if (params->has_encoder)
        encoder_speed(mirror, encoder_count, &low, &high);
    if (mirror->encoder_mrps >= 0 && high < speed)
        speed = high < 0 ? 0 : high;
    mirror->speed_mrps = (uint16_t)speed;
    bool encoder_ok =
        !params->has_encoder || (mirror->encoder_mrps >= 0 && high >= params->safe_mrps);
    uint64_t blind = params->has_encoder && encoder_ok ? MIRRORCTL_BLIND : 1;
    bool overdue = (now_us - mirror->index_us) * params->safe_mrps > MRPS_US * blind;
    mirror->too_fast = speed > params->max_mrps || low > params->max_mrps;
    mirror->in_range = mirror->good_periods >= 2 && !overdue && encoder_ok && !mirror->too_fast;
    if (overdue)
        mirror->good_periods = 0;
}

bool mirrorctl_stalled(const struct mirrorctl *mirror, uint64_t now_us) {
    return mirror->target_mrps && !mirror->in_range &&
           now_us - mirror->target_since_us > mirror->params.spinup_ms * (uint64_t)1000u;
}
