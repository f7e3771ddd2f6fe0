/* Logs of a line laser that a motor turns: a table of numbers, commas or blanks between them.
 *
 *   first line:   three numbers without meaning, then the bearings of a line's samples, degrees
 *   others:       line number, time in ms, angle of the motor in degrees, then as many ranges in
 *                 metres as there are bearings; 0 is no return
 *
 * Such a log does not say how the laser is mounted. It is taken to turn about the axis that lies in
 * its scanning plane, across bearing 0 (a nodding laser). In the station frame, at bearing b and
 * motor angle t:  direction = (cos b cos t, sin b, cos b sin t): x is bearing 0 at t = 0, z is up.
 */
#ifndef SC_IMPORT_SCAN_FAN_H
#define SC_IMPORT_SCAN_FAN_H

#include "base/st.h"
#include "import/scan.h"

#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Does the first line look like that table's (more numbers than a point has)? */
bool scan_fan_is(const void *data, size_t size);

/* A scan from the bytes of a log; rows are its lines, columns its bearings. ST_FORMAT names the
 * line; ST_NOMEM. */
ST_MUST_CHECK enum st scan_fan_parse(const void *data, size_t size, struct scan *out_scan,
                                     struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
