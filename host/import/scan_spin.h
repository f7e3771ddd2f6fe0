/* Points of a spinning laser as KITTI stores them (velodyne .bin): records of four little-endian
 * float32, x y z in metres in the sensor's frame (x forward, y left, z up) and a reflectance. No
 * grid, no time, and no record where there was no return.
 *
 * The station frame is the sensor's. Where the points lie in the file laser by laser, each turn in
 * order of its azimuth, the lasers become rows ("rings") and azimuths columns, of the median step
 * between neighbours; else the points are one row in the file's order, which no grid is to be read
 * from. */
#ifndef SC_IMPORT_SCAN_SPIN_H
#define SC_IMPORT_SCAN_SPIN_H

#include "base/st.h"
#include "import/scan.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { SCAN_SPIN_RECORD_BYTES = 16, SCAN_SPIN_MAX_RINGS = 256 };

/* A scan from the bytes of such a file. Intensity is the reflectance, 0..1; files that go up to 255
 * are divided by that. Records at exactly (0, 0, 0), which some writers put where nothing came
 * back, have no direction and are left out; out_scan->meta counts them. rows 1: no rings were
 * found. ST_FORMAT, naming the record from 0 on: a size that is no multiple of 16, no point at all,
 * a number that is not finite, a point beyond 10 km, a reflectance outside 0..255. ST_NOMEM. Cost:
 * three passes; scratch of 4 bytes a point. Free with scan_destroy(). */
ST_MUST_CHECK enum st scan_spin_parse(const uint8_t *data, size_t size, struct scan *out_scan,
                                      struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
