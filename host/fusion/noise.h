/* How noisy a rangefinder is, measured from what it sent.
 *
 * Along a scan line 1 / range bends by no more than the square of the step (1e-6 of itself at a
 * milliradian) over any plane. So the second difference of three consecutive samples, times
 * range^2, is noise: its robust scatter (median of |x|) over sqrt(6) is the sigma of one range,
 * edges and all. It is taken for each class of returned intensity, since weak echoes are noisier.
 */
#ifndef SC_FUSION_NOISE_H
#define SC_FUSION_NOISE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { NOISE_CLASSES = 12, NOISE_BINS = 256 };

/* Sigma by intensity class; class 0 also holds samples without intensity. */
struct noise_model {
    double sigma_m[NOISE_CLASSES];
    double sigma_per_m; /* added in quadrature, times the range */
    bool measured;      /* false: an assumption */
};

/* The same sigma for everything. */
struct noise_model noise_model_constant(double sigma_m, double sigma_per_m);

/* Sigma of one range, m. NaN intensity: unknown. */
double noise_sigma(const struct noise_model *model, double intensity, double range_m);

/* Class of an intensity 0..1: octaves below full scale. */
int noise_class(double intensity);

/* The measurement: three consecutive ranges of one scan line at a time. */
struct noise_meter {
    int64_t histogram[NOISE_CLASSES][NOISE_BINS]; /* of log |second difference| */
    double r1_m, r2_m;                            /* the two before; NaN: a gap */
    double i1, i2;
};
void noise_meter_init(struct noise_meter *meter);
/* The next range of the line; NaN ends the run (no return, dropped, a new line). */
void noise_meter_add(struct noise_meter *meter, double range_m, double intensity);

/* Fills classes that have fewer than 1000 triples from their neighbours. ST_NOT_FOUND-like false if
 * there are not enough in all; the model is then not touched. Sigma never falls with falling
 * intensity by more than the measurement says, and never below floor_m. */
bool noise_meter_read(const struct noise_meter *meter, double floor_m,
                      struct noise_model *out_model);

#ifdef __cplusplus
}
#endif
#endif
