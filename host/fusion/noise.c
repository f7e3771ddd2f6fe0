#include "fusion/noise.h"

#include <math.h>
#include <string.h>

/* |second difference| from 1 um to 1 m, 12.8 bins a factor of e... in equal steps of the logarithm.
 */
static const double lowest_m = 1e-6, highest_m = 1.0;

struct noise_model noise_model_constant(double sigma_m, double sigma_per_m) {
    struct noise_model model = {.sigma_per_m = sigma_per_m};
    for (int i = 0; i < NOISE_CLASSES; i++)
        model.sigma_m[i] = sigma_m;
    return model;
}

/* Octaves below full scale, as a real number. */
static double octaves(double intensity) {
    if (!(intensity > 0.0))
        return NOISE_CLASSES - 1;
    return fmin(fmax(-log2(intensity), 0.0), NOISE_CLASSES - 1);
}

int noise_class(double intensity) {
    return isnan(intensity) ? 0 : (int)octaves(intensity);
}

double noise_sigma(const struct noise_model *model, double intensity, double range_m) {
    double sigma = model->sigma_m[0];
    if (!isnan(intensity)) {
        /* Classes are octaves wide: interpolate between their middles. */
        double at = octaves(intensity) - 0.5;
        int k = at < 0 ? 0 : (int)at;
        k = k > NOISE_CLASSES - 2 ? NOISE_CLASSES - 2 : k;
        double part = fmin(fmax(at - k, 0.0), 1.0);
        sigma = (1 - part) * model->sigma_m[k] + part * model->sigma_m[k + 1];
    }
    return hypot(sigma, model->sigma_per_m * range_m);
}

void noise_meter_init(struct noise_meter *meter) {
    memset(meter, 0, sizeof *meter);
    meter->r1_m = meter->r2_m = (double)NAN;
    meter->i1 = meter->i2 = (double)NAN;
}

void noise_meter_add(struct noise_meter *meter, double range_m, double intensity) {
    double r0 = meter->r2_m, r1 = meter->r1_m; /* oldest, middle */
    bool same = (isnan(intensity) && isnan(meter->i1)) ||
                (noise_class(intensity) == noise_class(meter->i1) &&
                 noise_class(meter->i2) == noise_class(meter->i1));
    if (r0 > 0.0 && r1 > 0.0 && range_m > 0.0 && same) {
        double bend = fabs(1.0 / r0 - 2.0 / r1 + 1.0 / range_m) * r1 * r1;
        double at = log(fmax(bend, lowest_m) / lowest_m) / log(highest_m / lowest_m) * NOISE_BINS;
        int bin = at < NOISE_BINS ? (int)at : NOISE_BINS - 1;
        meter->histogram[noise_class(meter->i1)][bin]++;
    }
    meter->r2_m = meter->r1_m;
    meter->r1_m = range_m;
    meter->i2 = meter->i1;
    meter->i1 = intensity;
}

/* Median of |x| to sigma: the median of |N(0, 1)| is 0.6745, a second difference has sqrt(6). */
static double sigma_of(const int64_t histogram[NOISE_BINS], int64_t count) {
    int64_t below = 0;
    for (int bin = 0; bin < NOISE_BINS; bin++) {
        if (2 * (below + histogram[bin]) >= count) {
            double part = histogram[bin]
                              ? (0.5 * (double)count - (double)below) / (double)histogram[bin]
                              : 0.5;
            double value = lowest_m * pow(highest_m / lowest_m, (bin + part) / NOISE_BINS);
            return value / (0.6744898 * sqrt(6.0));
        }
        below += histogram[bin];
    }
    return highest_m;
}

bool noise_meter_read(const struct noise_meter *meter, double floor_m,
                      struct noise_model *out_model) {
    enum { ENOUGH = 1000 };
    struct noise_model model = {.measured = true};
    int first = -1, last = -1;
    for (int k = 0; k < NOISE_CLASSES; k++) {
        int64_t count = 0;
        for (int bin = 0; bin < NOISE_BINS; bin++)
            count += meter->histogram[k][bin];
        if (count < ENOUGH)
            continue;
        model.sigma_m[k] = fmax(sigma_of(meter->histogram[k], count), floor_m);
        for (int gap = last + 1; last >= 0 && gap < k; gap++) /* between two that are known */
            model.sigma_m[gap] = fmax(model.sigma_m[last], model.sigma_m[k]);
        if (first < 0)
            first = k;
        last = k;
    }
    if (first < 0)
        return false;
    for (int k = 0; k < first; k++)
        model.sigma_m[k] = model.sigma_m[first];
    for (int k = last + 1; k < NOISE_CLASSES;
         k++) /* weaker than any class known: sigma ~ 1/sqrt(I) */
        model.sigma_m[k] = model.sigma_m[k - 1] * sqrt(2.0);
    *out_model = model;
    return true;
}
