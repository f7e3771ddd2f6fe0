#include "fusion/noise.h"

#include <math.h>
#include <string.h>

/* A window's deviation, from 1 um to 1 m in equal steps of the logarithm. */
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

/* Octaves of the range above 0.25 m: the last class begins at 512 m. */
static double range_octaves(double range_m) {
    return fmin(fmax(log2(range_m / 0.25), 0.0), NOISE_CLASSES - 1);
}

double noise_sigma(const struct noise_model *model, double intensity, double range_m) {
    double sigma = model->sigma_m[0];
    if (model->by_range ? range_m > 0.0 : !isnan(intensity)) {
        /* Classes are octaves wide: interpolate between their middles. */
        double at = (model->by_range ? range_octaves(range_m) : octaves(intensity)) - 0.5;
        int k = at < 0 ? 0 : (int)at;
        k = k > NOISE_CLASSES - 2 ? NOISE_CLASSES - 2 : k;
        double part = fmin(fmax(at - k, 0.0), 1.0);
        sigma = (1 - part) * model->sigma_m[k] + part * model->sigma_m[k + 1];
    }
    return hypot(sigma, model->sigma_per_m * range_m);
}

void noise_meter_init(struct noise_meter *meter) {
    memset(meter, 0, sizeof *meter);
    double square = 0.0;
    for (int i = 0; i < NOISE_WINDOW; i++) {
        double t = i - 0.5 * (NOISE_WINDOW - 1);
        square += t * t / NOISE_WINDOW;
    }
    double(*basis)[NOISE_WINDOW] = meter->basis, norm2[3] = {0};
    for (int i = 0; i < NOISE_WINDOW; i++) {
        double t = i - 0.5 * (NOISE_WINDOW - 1);
        basis[0][i] = 1.0, basis[1][i] = t, basis[2][i] = t * t - square;
        for (int k = 0; k < 3; k++)
            norm2[k] += basis[k][i] * basis[k][i];
    }
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < NOISE_WINDOW; i++)
            basis[k][i] /= sqrt(norm2[k]);
}

/* Variance of the ranges in a full window about their parabola in 1 / range, m^2. */
static double window_variance(const struct noise_meter *meter) {
    double middle = meter->range_m[NOISE_WINDOW / 2], first = 1.0 / meter->range_m[0];
    double square = 0.0, fitted[3] = {0};
    for (int i = 0; i < NOISE_WINDOW; i++) {
        double y = (1.0 / meter->range_m[i] - first) * middle * middle;
        square += y * y;
        for (int k = 0; k < 3; k++)
            fitted[k] += y * meter->basis[k][i];
    }
    for (int k = 0; k < 3; k++)
        square -= fitted[k] * fitted[k];
    return fmax(square, 0.0) / (NOISE_WINDOW - 3);
}

/* A full window goes to its class, unless its echoes differ by more than an octave. */
static void window_count(struct noise_meter *meter) {
    double low = INFINITY, high = -INFINITY, sum = 0.0;
    int with = 0;
    for (int i = 0; i < NOISE_WINDOW; i++) {
        if (isnan(meter->intensity[i]))
            continue;
        double at = octaves(meter->intensity[i]);
        low = fmin(low, at), high = fmax(high, at), sum += at;
        with++;
    }
    if ((with && with < NOISE_WINDOW) || high - low > 1.0)
        return;
    if (with && !meter->with_intensity) /* from now on only such windows count */
        memset(meter->histogram, 0, sizeof meter->histogram);
    else if (!with && meter->with_intensity)
        return;
    meter->with_intensity = with > 0;
    double class = with ? sum / with : range_octaves(meter->range_m[NOISE_WINDOW / 2]);
    double sigma_m = sqrt(window_variance(meter));
    double at = log(fmax(sigma_m, lowest_m) / lowest_m) / log(highest_m / lowest_m) * NOISE_BINS;
    int bin = at < NOISE_BINS ? (int)at : NOISE_BINS - 1;
    meter->histogram[(int)class][bin]++;
}

void noise_meter_add(struct noise_meter *meter, double range_m, double intensity) {
    if (!(range_m > 0.0 && isfinite(range_m))) {
        meter->held = 0;
        return;
    }
    meter->range_m[meter->held] = range_m;
    meter->intensity[meter->held++] = intensity;
    if (meter->held == NOISE_WINDOW) {
        window_count(meter);
        meter->held = 0;
    }
}

static double bin_sigma(int bin) {
    return lowest_m * pow(highest_m / lowest_m, (bin + 0.5) / NOISE_BINS);
}

/* Where the windows crowd, in bins. The logarithm of a variance is most often that of the truth,
 * whatever the number of degrees of freedom. */
static int fullest(const int64_t histogram[NOISE_BINS]) {
    enum { REACH = NOISE_BINS * 2 / 138 }; /* +- 0.2 in log sigma, of the 13.8 of all bins */
    int64_t best = -1;
    int at = 0;
    for (int bin = 0; bin < NOISE_BINS; bin++) {
        int64_t sum = 0;
        for (int k = -REACH; k <= REACH; k++)
            if (bin + k >= 0 && bin + k < NOISE_BINS)
                sum += histogram[bin + k] * (REACH + 1 - (k < 0 ? -k : k));
        if (sum > best) {
            best = sum;
            at = bin;
        }
    }
    return at;
}

/* Windows with a variance above this multiple of the truth are left out: edges, leaves, grass. */
static const double keep_ratio = 1.7;

/* Mean of what is kept of a chi-square variable over its degrees of freedom. */
static double kept_mean(void) {
    enum { STEPS = 2000 };
    double half = 0.5 * (NOISE_WINDOW - 3), sum = 0.0, moment = 0.0;
    for (int i = 0; i < STEPS; i++) {
        double x = (i + 0.5) / STEPS * keep_ratio;
        double density = exp((half - 1.0) * log(x) - half * (x - 1.0));
        sum += density;
        moment += x * density;
    }
    return moment / sum;
}

/* The sigma that the windows with less than keep_ratio times its square bear out, from where they
 * crowd. */
static double sigma_of(const int64_t histogram[NOISE_BINS]) {
    enum { ROUNDS = 30 };
    double expected = kept_mean(), sigma_m = bin_sigma(fullest(histogram));
    double before_m = 0.0;
    for (int round = 0; round < ROUNDS && sigma_m != before_m; round++) {
        double most = sigma_m * sqrt(keep_ratio), sum = 0.0, count = 0.0;
        for (int bin = 0; bin < NOISE_BINS; bin++) {
            double window_m = bin_sigma(bin);
            if (!(window_m < most))
                break;
            sum += (double)histogram[bin] * window_m * window_m;
            count += (double)histogram[bin];
        }
        if (count < 1.0)
            break;
        before_m = sigma_m;
        sigma_m = sqrt(sum / count / expected);
    }
    return sigma_m;
}

bool noise_meter_read(const struct noise_meter *meter, double floor_m,
                      struct noise_model *out_model) {
    enum { ENOUGH = 64 };
    struct noise_model model = {.measured = true, .by_range = !meter->with_intensity};
    int first = -1, last = -1;
    for (int k = 0; k < NOISE_CLASSES; k++) {
        int64_t count = 0;
        for (int bin = 0; bin < NOISE_BINS; bin++)
            count += meter->histogram[k][bin];
        if (count < ENOUGH)
            continue;
        model.sigma_m[k] = fmax(sigma_of(meter->histogram[k]), floor_m);
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
    /* Weaker than any class known: sigma ~ 1/sqrt(I). Farther: nothing is known. */
    for (int k = last + 1; k < NOISE_CLASSES; k++)
        model.sigma_m[k] = model.sigma_m[k - 1] * (model.by_range ? 1.0 : sqrt(2.0));
    *out_model = model;
    return true;
}
