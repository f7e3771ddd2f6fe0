/* A whole scan by the simulated cart: stand by stand, sweep and photographs, into a site. The site
 * holds what a real cart's would: streams as sent, frames, nominal stands and calibrations (and the
 * true ones, marked so). What really was goes to a truth folder outside the site. */
#ifndef SC_TWIN_TWIN_SCAN_H
#define SC_TWIN_TWIN_SCAN_H

#include "base/progress.h"
#include "site/site.h"
#include "twin/cart.h"
#include "twin/faults.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

struct twin_picture; /* twin_picture.h */

struct twin_scan {
    const struct scene *scene;
    const struct twin_config *config;
    const struct faults *faults; /* of the first stand's time; may be NULL */
    const struct scene_stand *stands;
    size_t stand_count;
    uint64_t seed;
    bool frames;               /* take photographs */
    const char *truth_dir;     /* NULL: no truth is kept */
    bool truth_samples;        /* one record a sample too */
    const char *pictures_dir;  /* NULL: none */
    struct progress *progress; /* counts ms of cart time and of camera work; may be NULL */
};

/* What one stand gave. */
struct twin_scan_stand {
    char name[24];
    struct pose true_pose, nominal_pose; /* world_from_station */
    uint64_t samples, returns, no_returns, dropped, saturated, mixed;
    uint64_t packets, bytes, index_events, frames;
    double sweep_s;   /* duration of the sweep, cart time */
    double mirror_hz; /* mean */
    double samples_a_deg_mirror, samples_a_deg_pan;
    double error_mean_m,
        error_sigma_m; /* of the measured distance against the echo's, returns only */
};

/* Adds the nominal and the true calibration records of the twin's rig and camera to a site. What
 * frames are to refer to, the nominal camera's record, goes to out_camera. */
ST_MUST_CHECK enum st twin_scan_calibrate(const struct twin_config *config, struct site *site,
                                          int64_t *out_camera, struct errctx *err);

/* Cart time of one stand's scan, ms: for the progress bar's total. */
int64_t twin_scan_duration_ms(const struct twin_scan *scan);

/* Runs it. out_stands has room for stand_count. ST_INVALID for a stand inside something, with its
 * name; ST_CANCELLED if a power loss came: what was recorded is in the site. Errors of the site are
 * passed on. */
ST_MUST_CHECK enum st twin_scan_run(const struct twin_scan *scan, struct site *site,
                                    struct twin_scan_stand *out_stands, struct errctx *err);

/* The true pose of the head at a stand: height, level and the seed's scatter of both. */
struct pose twin_scan_true_pose(const struct twin_config *config, const struct scene_stand *stand,
                                uint64_t seed, size_t number);

#endif
