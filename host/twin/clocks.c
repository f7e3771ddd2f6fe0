#include "twin/clocks.h"

#include <math.h>

static const double pi = 3.14159265358979323846;

struct clocks clocks_make(const struct clocks_spec *spec, uint64_t seed) {
    struct clocks clock = {.spec = *spec};
    struct rng rng = rng_make(seed);
    for (int i = 0; i < CLOCKS_TERMS; i++) {
        double period_s = 40 * pow(2.3, i) * rng_range(&rng, 0.8, 1.25);
        /* terms of equal power: the variance of a sine is half its amplitude squared */
        clock.amplitude_ns[i] = spec->wander_us * 1000 * sqrt(2.0 / CLOCKS_TERMS);
        clock.rate_rad_s[i] = 2 * pi / period_s;
        clock.phase_rad[i] = rng_range(&rng, 0, 2 * pi);
    }
    return clock;
}

int64_t clocks_show(const struct clocks *clock, int64_t t_ns) {
    double t_s = (double)t_ns * 1e-9, extra_ns = clock->spec.drift_ppm * 1e-6 * (double)t_ns;
    for (int i = 0; i < CLOCKS_TERMS; i++)
        extra_ns += clock->amplitude_ns[i] * sin(clock->rate_rad_s[i] * t_s + clock->phase_rad[i]);
    int64_t shown_ns =
        t_ns + (int64_t)llround(clock->spec.offset_s * 1e9) + (int64_t)llround(extra_ns);
    for (int i = 0; i < clock->jumps; i++)
        if (t_ns >= clock->jump_at_ns[i])
            shown_ns += clock->jump_by_ns[i];
    return shown_ns;
}

int64_t clocks_when(const struct clocks *clock, int64_t shown_ns) {
    struct clocks smooth = *clock;
    smooth.jumps = 0;
    int64_t t_ns = shown_ns;
    for (int i = 0; i < 6; i++) /* the rate is 1 within 1e-3: each step gains three digits */
        t_ns += shown_ns - clocks_show(&smooth, t_ns);
    int64_t jumped_ns = 0;
    for (int i = 0; i < clock->jumps; i++)
        if (t_ns - jumped_ns >= clock->jump_at_ns[i])
            jumped_ns += clock->jump_by_ns[i];
    return jumped_ns ? clocks_when(&smooth, shown_ns - jumped_ns) : t_ns;
}

int64_t clocks_read(const struct clocks *clock, int64_t t_ns, struct rng *rng) {
    int64_t shown_ns = clocks_show(clock, t_ns);
    if (clock->spec.jitter_us > 0)
        shown_ns += (int64_t)llround(clock->spec.jitter_us * 1000 * rng_normal(rng));
    return shown_ns;
}

void clocks_jump(struct clocks *clock, int64_t at_ns, int64_t by_ns) {
    if (clock->jumps >= CLOCKS_JUMPS)
        return;
    clock->jump_at_ns[clock->jumps] = at_ns;
    clock->jump_by_ns[clock->jumps++] = by_ns;
}
