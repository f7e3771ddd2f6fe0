#include "base/clock_fit.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

struct line {
    double at_zero, rate_less_one; /* to - from = at_zero + rate_less_one * from */
    double mean_x, sxx;
    size_t used;
};

/* Least squares over the pairs that are kept. */
static bool fit_line(const double *x, const double *y, const uint8_t *keep, size_t count,
                     struct line *out) {
    double n = 0, mx = 0, my = 0, sxx = 0, sxy = 0;
    for (size_t i = 0; i < count; i++)
        if (keep[i])
            n++, mx += x[i], my += y[i];
    if (n < 1)
        return false;
    mx /= n, my /= n;
    for (size_t i = 0; i < count; i++)
        if (keep[i]) {
            sxx += (x[i] - mx) * (x[i] - mx);
            sxy += (x[i] - mx) * (y[i] - my);
        }
    out->rate_less_one = sxx > 0 ? sxy / sxx : 0.0;
    out->at_zero = my - out->rate_less_one * mx;
    out->mean_x = mx;
    out->sxx = sxx;
    out->used = (size_t)n;
    return true;
}

static double median_of(double *values, size_t count) {
    qsort(values, count, sizeof *values, by_value);
    return values[count / 2];
}

/* Keeps the pairs near the line; true if the set has changed. */
static bool trim(const double *x, const double *y, const struct line *line, size_t count,
                 double *scratch, uint8_t *keep, double *out_sigma) {
    for (size_t i = 0; i < count; i++)
        scratch[i] = y[i] - line->at_zero - line->rate_less_one * x[i];
    double middle = median_of(scratch, count);
    for (size_t i = 0; i < count; i++)
        scratch[i] = fabs(y[i] - line->at_zero - line->rate_less_one * x[i] - middle);
    double sigma = 1.4826 * median_of(scratch, count); /* of a normal scatter */
    *out_sigma = sigma;
    double limit = fmax(4.0 * sigma, 1.0); /* a nanosecond is what times are counted in */
    bool changed = false;
    for (size_t i = 0; i < count; i++) {
        double off = fabs(y[i] - line->at_zero - line->rate_less_one * x[i] - middle);
        uint8_t near = off <= limit;
        changed |= near != keep[i];
        keep[i] = near;
    }
    return changed;
}

enum st clock_fit_make(const int64_t *from_ns, const int64_t *to_ns, size_t count,
                       struct clock_fit *out_fit) {
    enum { ROUNDS = 20 };
    if (!count)
        return ST_INVALID;
    int64_t lo = from_ns[0], hi = from_ns[0];
    for (size_t i = 0; i < count; i++) {
        lo = from_ns[i] < lo ? from_ns[i] : lo;
        hi = from_ns[i] > hi ? from_ns[i] : hi;
    }
    if ((uint64_t)hi - (uint64_t)lo > (uint64_t)1 << 53)
        return ST_INVALID;
    struct clock_fit fit = {
        .from_mid_ns = lo + (hi - lo) / 2, .to_mid_ns = to_ns[0], .count = count};
    double *x = malloc(3 * count * sizeof *x), *y = x ? x + count : NULL;
    uint8_t *keep = malloc(count);
    enum st st = x && keep ? ST_OK : ST_NOMEM;
    struct line line = {0};
    for (size_t i = 0; !st && i < count; i++) {
        x[i] = (double)(from_ns[i] - fit.from_mid_ns);
        y[i] = (double)(to_ns[i] - fit.to_mid_ns) - x[i];
        keep[i] = 1;
    }
    for (int round = 0; !st && round < ROUNDS; round++)
        if (!fit_line(x, y, keep, count, &line) ||
            !trim(x, y, &line, count, x + 2 * count, keep, &fit.sigma_ns))
            break;
    free(x);
    free(keep);
    if (st)
        return st;
    fit.rate = 1.0 + line.rate_less_one;
    if (!(fit.rate > 0.9 && fit.rate < 1.1) || (hi == lo && fit.sigma_ns > 1.0))
        return ST_SINGULAR;
    fit.used = line.used;
    fit.to_mid_ns += (int64_t)llrint(line.at_zero);
    fit.mid_sigma_ns = fit.sigma_ns / sqrt((double)line.used);
    fit.rate_sigma = line.sxx > 0 ? fit.sigma_ns / sqrt(line.sxx) : 0.0;
    *out_fit = fit;
    return ST_OK;
}

int64_t clock_fit_apply(const struct clock_fit *fit, int64_t from_ns) {
    int64_t away = from_ns - fit->from_mid_ns;
    return fit->to_mid_ns + away + (int64_t)llrint((fit->rate - 1.0) * (double)away);
}

int64_t clock_fit_invert(const struct clock_fit *fit, int64_t to_ns) {
    int64_t away = to_ns - fit->to_mid_ns;
    return fit->from_mid_ns + away + (int64_t)llrint((1.0 / fit->rate - 1.0) * (double)away);
}
