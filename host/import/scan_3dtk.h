/* Scans of the 3DTK format: `.3d`, a text line of x y z [intensity] a sample in measuring order,
 * and
 * `.pose`, the position and three Euler angles. 3DTK is left-handed with y up, in centimetres and
 * degrees. Here: right-handed, z up, metres,
 *
 *   p = 0.01 (x, z, y),       world_from_station = S T S,  S the exchange of y and z,
 *   T = [Rx(a) Ry(b) Rz(c) | position]
 *
 * so x stays right, y is forward. */
#ifndef SC_IMPORT_SCAN_3DTK_H
#define SC_IMPORT_SCAN_3DTK_H

#include "base/st.h"
#include "import/scan.h"
#include "import/turned_grid.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

struct scan_3dtk_options {
    double no_return_m; /* what the instrument writes for no return; 0: the default, 32.767 */
    double tolerance_m; /* see turned_grid_recover(); 0: the default, 1e-4 */
};

/* A scan from the bytes of a .3d file. Ranges from 9 units of the last digit (mm) below no_return_m
 * on are no returns: the top codes of the instrument's range word say in which way it saw nothing.
 * Intensity is scaled by the file's largest. out_grid may be NULL; else free it with
 * turned_grid_fini(). ST_FORMAT names the line; ST_UNSUPPORTED where the points make no grid;
 * ST_NOMEM. */
ST_MUST_CHECK enum st scan_3dtk_parse(const void *data, size_t size,
                                      const struct scan_3dtk_options *options,
                                      struct scan *out_scan, struct turned_grid *out_grid,
                                      struct errctx *err);

/* The pose from the bytes of a .pose file: six numbers. */
ST_MUST_CHECK enum st scan_3dtk_parse_pose(const void *data, size_t size,
                                           struct pose *out_world_from_station, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
