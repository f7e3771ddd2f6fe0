#include "import/scan_spin.h"

#include "base/sample_grid.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;
static const double farthest_m = 1e4; /* beyond this a coordinate is garbage */

/* A turn is over where the azimuth falls back by more than this: far above the jitter of azimuths
 * after a correction for motion, far below the field of a camera that a scan was cut to. */
static const double fall_rad = 0.1;

/* A turn has at most 65 536 columns. */
static const double shortest_step_rad = 2 * 3.14159265358979323846 / 65536;

/* How many steps may go backwards in the order of a ring before it is none. */
static const double backward_share = 0.01;

enum { FEWEST_OF_RING = 8, FEWEST_RINGS = 2, LARGEST_REFLECTANCE = 255 };

struct spin {
    struct polar_sample *samples;
    size_t count, left_out;
    double turning; /* +1 counterclockwise seen from above, -1 clockwise */
    double seam_rad;
    double step_rad; /* between neighbours of a ring, median */
    int32_t rings;   /* 0: none found */
    int32_t columns;
};

static float read_float(const uint8_t *at) {
    const uint32_t bits =
        (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
    float value = 0;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* ---- records to samples ---- */

static enum st read_record(const uint8_t *at, size_t number, struct spin *spin, float *out_highest,
                           struct errctx *err) {
    double v[4];
    for (int i = 0; i < 4; i++) {
        v[i] = (double)read_float(at + 4 * i);
        if (!isfinite(v[i]))
            return errctx_set(err, ST_FORMAT, "point %zu: number %d is not finite", number, i + 1);
    }
    const struct vec3 p = {v[0], v[1], v[2]};
    const double range_m = vec3_norm(p);
    if (range_m > farthest_m)
        return errctx_set(err, ST_FORMAT,
                          "point %zu is %.3g km away: these are no points in metres", number,
                          1e-3 * range_m);
    if (v[3] < 0 || v[3] > LARGEST_REFLECTANCE)
        return errctx_set(err, ST_FORMAT, "point %zu: %g is no reflectance", number, v[3]);
    if (!(range_m > 0)) {
        spin->left_out++;
        return ST_OK;
    }
    struct polar_sample s = sample_from_point(p);
    s.intensity = (float)v[3];
    s.flags = SAMPLE_INTENSITY;
    *out_highest = s.intensity > *out_highest ? s.intensity : *out_highest;
    spin->samples[spin->count++] = s;
    return ST_OK;
}

static enum st read_records(const uint8_t *data, size_t size, struct spin *spin,
                            struct errctx *err) {
    const size_t count = size / SCAN_SPIN_RECORD_BYTES;
    float highest = 0;
    enum st st = ST_OK;
    if (size % SCAN_SPIN_RECORD_BYTES)
        return errctx_set(err, ST_FORMAT,
                          "%zu bytes are no whole number of points of 16 bytes (x y z reflectance)",
                          size);
    if (count > SCAN_MAX_SAMPLES)
        return errctx_set(err, ST_FORMAT, "%zu points are more than a scan holds", count);
    spin->samples = malloc((count ? count : 1) * sizeof *spin->samples);
    if (!spin->samples)
        return errctx_set(err, ST_NOMEM, "no memory for a scan of %zu points", count);
    for (size_t i = 0; !st && i < count; i++)
        st = read_record(data + SCAN_SPIN_RECORD_BYTES * i, i, spin, &highest, err);
    if (!st && !spin->count)
        st = errctx_set(err, ST_FORMAT, "there is no point in it");
    for (size_t i = 0; !st && highest > 1.0f && i < spin->count; i++)
        spin->samples[i].intensity /= (float)LARGEST_REFLECTANCE;
    return st;
}

/* ---- rings ---- */

/* Angle turned since the seam, 0..2 pi. */
static double turned_rad(const struct spin *spin, size_t i) {
    double u = spin->turning * (spin->samples[i].azimuth_rad - spin->seam_rad);
    u -= 2 * pi * floor(u / (2 * pi));
    return u < 2 * pi ? u : 0;
}

static int by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Which way the laser turns, and its step: of the differences between neighbours in the file. */
static enum st find_turning(struct spin *spin, struct errctx *err) {
    const size_t n = spin->count - 1;
    size_t ahead = 0;
    float *step = malloc((n ? n : 1) * sizeof *step);
    if (!step)
        return errctx_set(err, ST_NOMEM, "no memory for the order of %zu points", spin->count);
    for (size_t i = 0; i < n; i++) {
        const double d =
            remainder(spin->samples[i + 1].azimuth_rad - spin->samples[i].azimuth_rad, 2 * pi);
        ahead += d > 0;
        step[i] = (float)fabs(d);
    }
    qsort(step, n, sizeof *step, by_value);
    spin->turning = 2 * ahead >= n ? 1 : -1;
    spin->step_rad = n ? (double)step[n / 2] : 0;
    free(step);
    return ST_OK;
}

/* Rows by the seam. False where the points do not lie ring by ring. */
static bool mark_rings(struct spin *spin) {
    size_t in_ring = 1, backwards = 0;
    uint32_t ring = 0;
    double last = turned_rad(spin, 0);
    spin->samples[0].row = 0;
    for (size_t i = 1; i < spin->count; i++) {
        const double u = turned_rad(spin, i);
        const bool falls = u < last - fall_rad && in_ring >= FEWEST_OF_RING;
        if (falls) {
            ring++;
            in_ring = 0;
        }
        backwards += u < last && !falls;
        if (ring == SCAN_SPIN_MAX_RINGS)
            return false;
        spin->samples[i].row = ring;
        in_ring++;
        last = u;
    }
    spin->rings = (int32_t)ring + 1;
    return spin->rings >= FEWEST_RINGS && (double)backwards <= backward_share * (double)spin->count;
}

/* Columns by azimuth; a point that falls on its neighbour's takes the next if that is near. */
static void mark_columns(struct spin *spin) {
    uint32_t last = 0, last_row = UINT32_MAX, highest = 0;
    for (size_t i = 0; i < spin->count; i++) {
        struct polar_sample *s = &spin->samples[i];
        const double place = turned_rad(spin, i) / spin->step_rad;
        uint32_t column = (uint32_t)floor(place + 0.5);
        if (s->row == last_row && column <= last && (double)last + 1 - place < 1.5)
            column = last + 1;
        s->column = last = column;
        last_row = s->row;
        highest = column > highest ? column : highest;
    }
    spin->columns = (int32_t)highest + 1;
}

/* Turns are cut ahead of the sensor or behind it: at the cut that comes sooner before the first
 * point. */
static enum st find_rings(struct spin *spin, struct errctx *err) {
    enum st st = find_turning(spin, err);
    if (st)
        return st;
    spin->seam_rad = turned_rad(spin, 0) < pi ? 0 : pi;
    bool found =
        spin->step_rad > shortest_step_rad && spin->step_rad < fall_rad && mark_rings(spin);
    if (found) {
        mark_columns(spin);
        /* so sparse that no grid holds them: sample_grid_create() */
        found = (double)spin->rings * spin->columns <= 16.0 * (double)spin->count + 65536.0;
    }
    if (found)
        return ST_OK;
    spin->rings = 0;
    for (size_t i = 0; i < spin->count; i++) {
        spin->samples[i].row = 0;
        spin->samples[i].column = (uint32_t)i;
    }
    return ST_OK;
}

enum st scan_spin_parse(const uint8_t *data, size_t size, struct scan *out_scan,
                        struct errctx *err) {
    struct spin spin;
    memset(&spin, 0, sizeof spin);
    enum st st = read_records(data, size, &spin, err);
    if (!st)
        st = find_rings(&spin, err);
    if (st) {
        free(spin.samples);
        return st;
    }
    struct scan scan;
    memset(&scan, 0, sizeof scan);
    scan.samples = spin.samples;
    scan.count = spin.count;
    scan.rows = spin.rings ? spin.rings : 1;
    scan.columns = spin.rings ? spin.columns : (int32_t)spin.count;
    scan.world_from_station = pose_identity();
    (void)snprintf(scan.meta, sizeof scan.meta,
                   "{\"grid\":\"%s\",\"rows\":%d,\"columns\":%d,\"column_step_rad\":%.9g,"
                   "\"seam_rad\":%.9g,\"turning\":%.0f,\"left_out\":%zu}",
                   spin.rings ? "rings of a spinning laser" : "none: the file's order", scan.rows,
                   scan.columns, spin.rings ? spin.turning * spin.step_rad : 0.0, spin.seam_rad,
                   spin.turning, spin.left_out);
    *out_scan = scan;
    return ST_OK;
}
