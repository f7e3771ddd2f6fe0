/* The truth folder of a simulated scan, outside the site: what was really there.
 *
 *   truth.json         scene, seed, stands (true and nominal poses), counts and error figures of
 * each twin.yaml          all parameters, nominal beside true samples-NAME.bin   with
 * truth_samples: one 40-byte record a sent sample, in the order of their numbers
 *
 * Record, little-endian: 0 u32 seq, 4 u16 part of the strongest echo, 6 u8 echoes, 7 u8 mixed, 8
 * i64 true time ns, 16 f32 x 3 point in the world (m, NaN without echo), 28 f32 distance of the
 * echo's phase, 32 f32 nearest, 36 f32 farthest echo (m). */
#ifndef SC_TWIN_TWIN_TRUTH_H
#define SC_TWIN_TWIN_TRUTH_H

#include "twin/twin_scan.h"

#include <stdio.h>

enum { TWIN_TRUTH_SAMPLE_BYTES = 40 };

struct twin_truth_sample {
    uint32_t seq;
    uint16_t part;
    uint8_t echoes, mixed;
    int64_t t_ns;
    float point_m[3], distance_m, nearest_m, farthest_m;
};

void twin_truth_encode(const struct twin_truth_sample *sample,
                       uint8_t out_bytes[TWIN_TRUTH_SAMPLE_BYTES]);
struct twin_truth_sample twin_truth_decode(const uint8_t bytes[TWIN_TRUTH_SAMPLE_BYTES]);
struct twin_truth_sample twin_truth_of_shot(const struct cart_shot *shot);

/* Writes truth.json and twin.yaml into the folder (made if needed). */
ST_MUST_CHECK enum st twin_truth_write(const struct twin_scan *scan, const char *dir,
                                       const struct twin_scan_stand *stands, struct errctx *err);

#endif
