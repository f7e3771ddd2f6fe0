/* How noisy a rangefinder is, measured from what it sent.
 *
 * Along a scan line 1 / range over any plane, and over what is gently round, is a parabola to far
 * below the noise. So the scatter of sixteen consecutive samples about theirs, times range^2, is
 * one estimate of the variance of a range, with 13 degrees of freedom. Windows on edges, leaves or
 * grass give more, never less: the estimates crowd at the truth (the density of the logarithm of a
 * chi-square variable over its degrees of freedom peaks at 0) and trail off above. The mean of
 * those below 1.7 times the variance is brought to that of a chi-square variable cut off there, and
 * found by iteration from the crowd. Taken for each class of returned intensity, since weak echoes
 * are noisier; without intensities, for each octave of the range. Within some 4 % of the truth in
 * the twin's scenes, lawn and leaves among them. */
#ifndef SC_FUSION_NOISE_H
#define SC_FUSION_NOISE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { NOISE_CLASSES = 12, NOISE_BINS = 1024, NOISE_WINDOW = 16 };

/* Sigma by class; class 0 also serves samples without intensity among others with. */
struct noise_model {
    double sigma_m[NOISE_CLASSES];
    double sigma_per_m; /* added in quadrature, times the range */
    bool by_range;      /* classes are octaves of the range, from 0.25 m, not of intensity */
    bool measured;      /* false: an assumption */
};

/* The same sigma for everything. */
struct noise_model noise_model_constant(double sigma_m, double sigma_per_m);

/* Sigma of one range, m. NaN intensity: unknown. */
double noise_sigma(const struct noise_model *model, double intensity, double range_m);

/* Class of an intensity 0..1: octaves below full scale. */
int noise_class(double intensity);

/* The measurement: sixteen consecutive ranges of one scan line at a time. */
struct noise_meter {
    int64_t histogram[NOISE_CLASSES][NOISE_BINS]; /* windows, of log sigma */
    double range_m[NOISE_WINDOW], intensity[NOISE_WINDOW];
    double basis[3][NOISE_WINDOW]; /* orthonormal: constant, line, bow */
    bool with_intensity;           /* what was counted so far had intensities */
    int held;                      /* of the window that is being filled */
};
void noise_meter_init(struct noise_meter *meter);
/* The next range of the line; NaN ends the run (no return, dropped, a new line). */
void noise_meter_add(struct noise_meter *meter, double range_m, double intensity);

/* Fills classes that have fewer than 64 windows from their neighbours. False if no class has
 * enough; the model is then not touched. Never below floor_m. */
bool noise_meter_read(const struct noise_meter *meter, double floor_m,
                      struct noise_model *out_model);

#ifdef __cplusplus
}
#endif
#endif
