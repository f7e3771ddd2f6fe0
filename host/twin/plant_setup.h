/* The controller's plant as the twin's parameters describe it: how it is built, how its controller
 * is commissioned, and which of the twin's faults happen in it. */
#ifndef SC_TWIN_PLANT_SETUP_H
#define SC_TWIN_PLANT_SETUP_H

#include "firmware/port/sim/sim.h"
#include "twin/faults.h"
#include "twin/twin_config.h"

#include <stdbool.h>
#include <stdint.h>

/* The true cart: play, mirror with its unevenness, captures. The cart is left as its crew leaves
 * it: pan and tilt near their home switches. */
struct sim_config plant_setup(const struct twin_config *config, uint64_t seed);

/* Writes and stores the commissioning values and limits, which follow the nominal figures. False
 * if the controller refuses one. Takes virtual time, below 0.5 s. */
bool plant_setup_commission(struct sim *sim, const struct twin_config *config);

/* What a fault of the twin is in the plant; false: it happens elsewhere. The plant's fault takes
 * the value `on` at its start and, if out_length_ns is positive, `off` after that. */
bool plant_setup_fault(const struct fault *fault, enum sim_fault *out_fault, double *out_on,
                       double *out_off, int64_t *out_length_ns);

#endif
