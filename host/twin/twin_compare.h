/* A simulated scan held against its truth: every sample of a stand's head stream, placed by the
 * index events and a rig model, beside the point where its echo really came from. */
#ifndef SC_TWIN_TWIN_COMPARE_H
#define SC_TWIN_TWIN_COMPARE_H

#include "base/rig.h"
#include "site/site.h"

#include <stdint.h>

struct twin_compare {
    int64_t samples;  /* in the stream */
    int64_t placed;   /* with a range and a place in the sweep */
    int64_t compared; /* not mixed, the error is within 1 m */
    int64_t mixed, outliers;
    double mean_m, rms_m, median_m, p95_m; /* distance to the true point */
    double radial_mean_m, radial_sigma_m;  /* its part along the beam */
};

/* Compares a station. `samples_path`: the truth's samples-NAME.bin. world_from_station and rig:
 * what the points are made with. ST_NOT_FOUND without the streams, ST_FORMAT if truth and stream do
 * not belong together. */
ST_MUST_CHECK enum st twin_compare_station(struct site *site, int64_t station_id,
                                           const char *samples_path, const struct rig *rig,
                                           const struct pose *world_from_station,
                                           struct twin_compare *out_result, struct errctx *err);

#endif
