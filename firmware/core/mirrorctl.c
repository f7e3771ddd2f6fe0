#include "firmware/core/mirrorctl.h"

#define DRIVE_MAX 10000
/* One millirev/s is 1e9 / period_us; a period is judged against it without dividing where possible.
 */
#define MRPS_US 1000000000u
/* Counts by which a window's difference may be off. */
#define COUNT_SLACK 2

static int32_t clamp(int64_t value, int32_t low, int32_t high) {
    return value < low ? low : value > high ? high : (int32_t)value;
}

void mirrorctl_init(struct mirrorctl *mirror, const struct mirrorctl_params *params) {
    *mirror = (struct mirrorctl){.params = *params};
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

/* What a window of the encoder's readings says. */
struct window {
    int32_t counts;
    uint32_t time_us;
};

static struct window window_of(const struct mirrorctl *mirror, unsigned ticks) {
    unsigned now = mirror->window_at, then = (now + MIRRORCTL_WINDOW - ticks) % MIRRORCTL_WINDOW;
    return (struct window){(int16_t)(uint16_t)(mirror->counts[now] - mirror->counts[then]),
                           mirror->times[now] - mirror->times[then]};
}

/* Speed if it were `counts` in the window's time, 0.001 rev/s. */
static int32_t window_speed(const struct mirrorctl *mirror, int32_t counts, uint32_t time_us) {
    int64_t per_rev_us = (int64_t)mirror->params.encoder_counts * (time_us ? time_us : 1);
    return clamp((int64_t)counts * MRPS_US / per_rev_us, 0, UINT16_MAX);
}

/* Upper bound of the speed by the encoder. A reading is known to one count, and COUNT_SLACK bears
 * the unevenness of real edges; so a short window proves a standstill soon, a long one a small
 * shortfall. A mirror at or above its safe speed fails in none. */
static int32_t encoder_high(const struct mirrorctl *mirror) {
    struct window whole = window_of(mirror, MIRRORCTL_WINDOW - 1);
    int32_t high = window_speed(mirror, whole.counts + COUNT_SLACK, whole.time_us);
    for (unsigned ticks = 1; ticks < MIRRORCTL_WINDOW - 1; ticks *= 2) {
        struct window w = window_of(mirror, ticks);
        int64_t seen = (int64_t)(w.counts + COUNT_SLACK) * MRPS_US;
        int64_t safe =
            (int64_t)mirror->params.safe_mrps * mirror->params.encoder_counts * w.time_us;
        if (seen < safe) { /* only then is the division worth it */
            int32_t speed = window_speed(mirror, w.counts + COUNT_SLACK, w.time_us);
            high = speed < high ? speed : high;
        }
    }
    return high;
}

static void take_reading(struct mirrorctl *mirror, uint16_t count, uint32_t count_us) {
    mirror->window_at = (uint8_t)((mirror->window_at + 1) % MIRRORCTL_WINDOW);
    mirror->counts[mirror->window_at] = count;
    mirror->times[mirror->window_at] = count_us;
    if (mirror->window_fill < MIRRORCTL_WINDOW)
        mirror->window_fill++;
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

void mirrorctl_tick(struct mirrorctl *mirror, uint64_t now_us, uint16_t count, uint32_t count_us) {
    const struct mirrorctl_params *params = &mirror->params;
    int32_t speed = index_speed(mirror, now_us), low = 0;
    bool encoder_ok = !params->has_encoder;
    take_reading(mirror, count, count_us);
    if (params->has_encoder && mirror->window_fill == MIRRORCTL_WINDOW) {
        struct window whole = window_of(mirror, MIRRORCTL_WINDOW - 1);
        int32_t high = encoder_high(mirror);
        low = window_speed(mirror, whole.counts - COUNT_SLACK, whole.time_us);
        encoder_ok = high >= params->safe_mrps;
        speed = high < speed ? high : speed;
    }
    uint64_t blind = params->has_encoder && encoder_ok ? MIRRORCTL_BLIND : 1;
    bool overdue = (now_us - mirror->index_us) * params->safe_mrps > MRPS_US * blind;
    mirror->speed_mrps = (uint16_t)speed;
    mirror->too_fast = speed > params->max_mrps || low > params->max_mrps;
    mirror->in_range = mirror->good_periods >= 2 && !overdue && encoder_ok && !mirror->too_fast;
    if (overdue || !encoder_ok) /* then it takes two good periods again */
        mirror->good_periods = 0;
}

bool mirrorctl_stalled(const struct mirrorctl *mirror, uint64_t now_us) {
    return mirror->target_mrps && !mirror->in_range &&
           now_us - mirror->target_since_us > mirror->params.spinup_ms * (uint64_t)1000u;
}
