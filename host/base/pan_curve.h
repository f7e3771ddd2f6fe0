/* Where pan and tilt were between two index events. A pan that keeps its speed is a line. Where it
 * starts or stops, the controller's ramps are mostly much shorter than a revolution: the curve is
 * the two lines of its speeds before and after, joined by a parabola around the corner, which
 * follows from the way made. Where neither holds, a cubic (Hermite) through the neighbouring
 * events, with the doubt that it deserves.
 *
 * Pure; no allocation; constant time. */
#ifndef SC_BASE_PAN_CURVE_H
#define SC_BASE_PAN_CURVE_H

#include "base/sweep_index.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct pan_curve_params {
    double noise_steps;           /* sigma of a logged position while the pan moves */
    double acceleration_steps_s2; /* of the controller's ramps; 0: not known */
};

enum pan_curve_shape {
    PAN_CURVE_STANDS,
    PAN_CURVE_LINE,
    PAN_CURVE_CORNER,
    PAN_CURVE_CUBIC,
    PAN_CURVE_UNKNOWN /* it moved between: anywhere from one position to the other */
};

/* From one event to the next. Times in s from the first. */
struct pan_curve {
    enum pan_curve_shape shape;
    double span_s, p0, p1;   /* steps */
    double v0, v1;           /* steps/s at the ends */
    double corner_s, half_s; /* middle and half duration of the ramp */
    double half_max_s;       /* the longest it can have been */
    double noise_steps;      /* of each end */
    double tilt0, tilt1, tilt_sigma_steps;
};

/* The stretch from index[i] to index[i + 1] (same log, in order of controller time); others around
 * them, where there are, tell the speeds. False if there is no such stretch. */
bool pan_curve_make(const struct sweep_index *index, size_t count, size_t i,
                    const struct pan_curve_params *params, struct pan_curve *out_curve);

struct pan_curve_point {
    double pan_steps, pan_rate, pan_sigma_steps; /* rate: steps/s */
    double tilt_steps, tilt_sigma_steps;
};
/* At time s after the first event; clamped to the stretch. The sigma leaves out doubt about t. */
struct pan_curve_point pan_curve_at(const struct pan_curve *curve, double t_s);

/* Sigma of logged positions while the pan keeps its speed (in a sweep, if there is one), steps,
 * from the median of second differences; negative if there are not 8 such. 3 kB of stack. */
double pan_curve_noise(const struct sweep_index *index, size_t count);

#ifdef __cplusplus
}
#endif
#endif
