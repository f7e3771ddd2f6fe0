/* Speed of the spinning mirror: measured by index periods and, where there is an encoder, by its
 * counts over some ticks; controlled by an integer PI loop with feed forward, once a revolution. */
#ifndef SC_CORE_MIRRORCTL_H
#define SC_CORE_MIRRORCTL_H

#include <stdbool.h>
#include <stdint.h>

#define MIRRORCTL_WINDOW 16 /* encoder readings kept: 8 ms */

/* Revolutions at safe speed without an index pulse that are borne while the encoder says that the
 * mirror turns; without an encoder it is one. */
#define MIRRORCTL_BLIND 3

struct mirrorctl_params {
    uint16_t safe_mrps, max_mrps;  /* 0.001 rev/s */
    uint16_t feed, gain, integral; /* 0.01 % per rev/s, per rev/s, per revolution */
    uint16_t spinup_ms;
    uint16_t encoder_counts;
    bool has_encoder;
};

struct mirrorctl {
    struct mirrorctl_params params;
    uint16_t target_mrps;
    uint16_t drive;       /* 0.01 % */
    int32_t integral;     /* 0.01 % * 1024 */
    uint32_t period_us;   /* last index period, 0 none */
    uint64_t index_us;    /* last index pulse */
    uint8_t good_periods; /* consecutive periods within range, saturating at 2 */
    bool index_seen;
    uint64_t target_since_us;          /* when the target was last changed */
    uint16_t counts[MIRRORCTL_WINDOW]; /* encoder readings of the last ticks, */
    uint32_t times[MIRRORCTL_WINDOW];  /* and when they were taken */
    uint8_t window_at, window_fill;    /* the newest; how many there are */
    bool in_range;
    bool too_fast;
    uint16_t speed_mrps; /* an upper bound of the speed now, from index and encoder */
};

void mirrorctl_init(struct mirrorctl *mirror, const struct mirrorctl_params *params);

/* New speed wanted; 0 stops the drive. Returns the drive to output. */
uint16_t mirrorctl_target(struct mirrorctl *mirror, uint16_t target_mrps, uint64_t now_us);

/* Everything off at once (a fault). */
void mirrorctl_abort(struct mirrorctl *mirror);

/* An index pulse captured at `t_us`, `turns` >= 1 revolutions after the last (more than one if the
 * encoder says that pulses were missed). Returns false if it came too early to be one (more than
 * twice max_mrps) and was ignored. Sets mirror->drive. Index interrupt; two divisions. */
bool mirrorctl_index(struct mirrorctl *mirror, uint64_t t_us, uint16_t turns);

/* Every tick, with the encoder's counter and the time of its reading: updates in_range, too_fast
 * and speed_mrps. Three divisions. */
void mirrorctl_tick(struct mirrorctl *mirror, uint64_t now_us, uint16_t count, uint32_t count_us);

/* Wanted but not in range after spinup_ms. */
bool mirrorctl_stalled(const struct mirrorctl *mirror, uint64_t now_us);

#endif
