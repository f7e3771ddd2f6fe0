#include "firmware/core/ramp.h"

/* Roots of w carry 16 fraction bits: 0.001/65536 steps/s. */
#define ROOT_BITS 16u

static uint64_t max64(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

static uint64_t min64(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

static uint32_t clip(uint32_t value, uint32_t low, uint32_t high) {
    return value < low ? low : value > high ? high : value;
}

/* Digit by digit: after each round root^2 <= the bits taken in so far. */
uint32_t ramp_isqrt(uint64_t x) {
    uint64_t root = 0, bit = (uint64_t)1 << 62;
    while (bit > x)
        bit >>= 2;
    while (bit) {
        if (x >= root + bit) {
            x -= root + bit;
            root = (root >> 1) + bit;
        } else {
            root >>= 1;
        }
        bit >>= 2;
    }
    return (uint32_t)root;
}

/* sqrt(w) with ROOT_BITS fraction bits: w is shifted up as far as 64 bits allow, so that the root
 * always has 31 or 32 significant bits (2^-32 of it, at most 0.16 us of time in the worst case of
 * 50 000 steps/s at 100 steps/s^2). */
static uint64_t root_of(uint64_t w) {
    if (!w)
        return 0;
    unsigned shift = (unsigned)__builtin_clzll(w) & ~1u;
    uint64_t root = ramp_isqrt(w << shift);
    unsigned have = shift / 2;
    return have > ROOT_BITS ? root >> (have - ROOT_BITS) : root << (ROOT_BITS - have);
}

/* Time in which the velocity changes by `root` (0.001/65536 steps/s) at acceleration a:
 * root / (65536 000 a) s = root * 125 / (32 a) fine. */
static uint64_t time_of(uint64_t root, uint32_t acceleration) {
    uint64_t divisor = 32u * (uint64_t)acceleration;
    return (root * 125u + divisor / 2) / divisor;
}

/* Time to cruise over part/g of a step. Both are shifted down to 30 bits, so that the product with
 * the interval (at most 2.56e9 fine) stays within 64. */
static uint64_t cruise_part(const struct ramp *ramp, uint64_t part) {
    uint64_t whole = ramp->g;
    while (whole >> 30) {
        whole >>= 1;
        part >>= 1;
    }
    return part * ramp->cruise_quotient / whole;
}

static void set_limits(struct ramp *ramp, uint32_t velocity_max, uint32_t acceleration) {
    ramp->velocity_max = clip(velocity_max, RAMP_VELOCITY_MIN, RAMP_VELOCITY_MAX);
    ramp->acceleration = clip(acceleration, RAMP_ACCELERATION_MIN, RAMP_ACCELERATION_MAX);
    ramp->w_max = (uint64_t)ramp->velocity_max * ramp->velocity_max;
    ramp->g = 2000000u * (uint64_t)ramp->acceleration;
    ramp->cap = (uint32_t)(max64(ramp->w, ramp->w_max) / ramp->g) + 2;
    uint64_t second = (uint64_t)RAMP_FINE * 1000000000u; /* 1000 s, as velocities are in 1/1000 */
    ramp->cruise_quotient = second / ramp->velocity_max;
    ramp->cruise_remainder = second % ramp->velocity_max;
    ramp->phase = RAMP_REST; /* whatever comes next starts a new origin */
}

static void begin_phase(struct ramp *ramp, enum ramp_phase phase, uint64_t t_fine, uint64_t root) {
    ramp->phase = phase;
    ramp->ref_fine = t_fine;
    ramp->ref_root = root;
    ramp->cruise_sum = 0;
}

/* A whole step of one phase. */
static void step_accel(struct ramp *ramp) {
    if (ramp->phase != RAMP_ACCEL)
        begin_phase(ramp, RAMP_ACCEL, ramp->t_fine, root_of(ramp->w));
    ramp->w += ramp->g;
    ramp->t_fine = ramp->ref_fine + time_of(root_of(ramp->w) - ramp->ref_root, ramp->acceleration);
}

static void step_cruise(struct ramp *ramp) {
    if (ramp->phase != RAMP_CRUISE)
        begin_phase(ramp, RAMP_CRUISE, ramp->t_fine, 0);
    ramp->t_fine += ramp->cruise_quotient;
    ramp->cruise_sum += ramp->cruise_remainder;
    if (ramp->cruise_sum >= ramp->velocity_max) {
        ramp->cruise_sum -= ramp->velocity_max;
        ramp->t_fine++;
    }
}

static void step_decel(struct ramp *ramp) {
    if (ramp->phase != RAMP_DECEL)
        begin_phase(ramp, RAMP_DECEL, ramp->t_fine, root_of(ramp->w));
    ramp->w -= ramp->g;
    ramp->t_fine = ramp->ref_fine + time_of(ramp->ref_root - root_of(ramp->w), ramp->acceleration);
}

/* A step in which the phase changes. u runs from 0 to g over the step; w is w0 +- u while speeding
 * up or slowing down to the limit, w_max while cruising, w_stop - u on the final ramp. */
static void step_mixed(struct ramp *ramp, uint64_t w_stop) {
    uint64_t w0 = ramp->w, top = w0, t = ramp->t_fine, u = 0;
    if (w0 < ramp->w_max) {
        u = min64(ramp->w_max - w0, (w_stop - w0) / 2);
        top = w0 + u;
        t += time_of(root_of(top) - root_of(w0), ramp->acceleration);
    } else if (w0 > ramp->w_max) {
        u = w0 - ramp->w_max;
        top = ramp->w_max;
        t += time_of(root_of(w0) - root_of(top), ramp->acceleration);
    }
    if (top == ramp->w_max) {
        uint64_t end = min64(w_stop - ramp->w_max, ramp->g);
        t += cruise_part(ramp, end - u);
        u = end;
    }
    if (u < ramp->g) {
        begin_phase(ramp, RAMP_DECEL, t, root_of(top));
        ramp->w = w_stop - ramp->g;
        ramp->t_fine = t + time_of(ramp->ref_root - root_of(ramp->w), ramp->acceleration);
    } else {
        begin_phase(ramp, RAMP_CRUISE, t, 0);
        ramp->w = ramp->w_max;
        ramp->t_fine = t;
    }
}

/* From the state at one step to the state at the next. Invariant: w <= g * remaining, so the final
 * ramp is never steeper than the acceleration. */
static void plan(struct ramp *ramp) {
    uint64_t steps = min64(ramp->remaining, ramp->cap);
    uint64_t w_stop = ramp->g * steps;       /* on the final ramp, here */
    uint64_t w_stop_next = w_stop - ramp->g; /* and one step on */
    uint64_t w_up = ramp->w + ramp->g;
    if (w_up <= ramp->w_max && w_up <= w_stop_next)
        step_accel(ramp);
    else if (ramp->w == ramp->w_max && ramp->w_max <= w_stop_next)
        step_cruise(ramp);
    else if (ramp->w == w_stop || ramp->w >= ramp->w_max + ramp->g)
        step_decel(ramp);
    else
        step_mixed(ramp, w_stop);
    ramp->remaining--;
}

void ramp_init(struct ramp *ramp) {
    *ramp = (struct ramp){.phase = RAMP_REST};
}

void ramp_start(struct ramp *ramp, uint64_t start_fine, uint32_t steps, uint32_t velocity_max,
                uint32_t acceleration) {
    ramp->w = 0;
    ramp->t_fine = start_fine;
    ramp->remaining = steps;
    set_limits(ramp, velocity_max, acceleration);
    plan(ramp);
    ramp->pending = true;
}

bool ramp_advance(struct ramp *ramp) {
    if (!ramp->remaining) {
        ramp->pending = false;
        ramp->phase = RAMP_REST;
        ramp->w = 0;
        return false;
    }
    plan(ramp);
    return true;
}

uint32_t ramp_stopping(const struct ramp *ramp, uint32_t acceleration) {
    uint64_t g =
        2000000u * (uint64_t)clip(acceleration, RAMP_ACCELERATION_MIN, RAMP_ACCELERATION_MAX);
    return (uint32_t)((ramp->w + g - 1) / g);
}

bool ramp_retarget(struct ramp *ramp, uint32_t remaining, uint32_t velocity_max,
                   uint32_t acceleration) {
    if (remaining < ramp_stopping(ramp, acceleration))
        return false;
    ramp->remaining = remaining;
    set_limits(ramp, velocity_max, acceleration);
    return true;
}

void ramp_delay(struct ramp *ramp, uint64_t late_fine) {
    ramp->t_fine += late_fine;
    ramp->ref_fine += late_fine;
}

uint64_t ramp_due_us(const struct ramp *ramp) {
    return (ramp->t_fine + RAMP_FINE / 2) / RAMP_FINE;
}

uint32_t ramp_velocity(const struct ramp *ramp) {
    return ramp_isqrt(ramp->w);
}
