/* Lists of things to import, as YAML: what `scancart import photo --list` and `import scan --list`
 * read. Paths are relative to the list's folder. */
#ifndef SC_IMPORT_IMPORT_LIST_H
#define SC_IMPORT_IMPORT_LIST_H

#include "base/st.h"
#include "import/photo_job.h"
#include "import/scan_job.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { IMPORT_LIST_MAX = 1024 };

/* Photographs:
 *
 *   up: -y                     # of the poses' world: z (default), y, -y
 *   camera: {fx_px: 518, fy_px: 519, cx_px: 325.5, cy_px: 253.5}  # or hfov_deg; k1 k2 p1 p2 k3
 *   map: {kind: depth, scale: 0.001}       # kind: depth, range, disparity; offset, unknown,
 *                                          # baseline_m, step, dequantise, sigma_m, sigma_per_m,
 * sigma_px station: room              # default of all; else each photograph is its own station
 *   photos:
 *     - {name: first, image: color/1.png, map: depth/1.pgm, pose: [x, y, z, qx, qy, qz, qw]}
 *
 * The pose takes camera to world. *out_jobs is malloc'ed. ST_FORMAT with file, line and key. */
ST_MUST_CHECK enum st import_list_photos(const char *path, struct photo_job **out_jobs,
                                         size_t *out_count, struct errctx *err);

/* Scans:
 *
 *   up: y                      # PLY: of the files and of their world
 *   unit_m: 1                  # PLY
 *   conf: bun.conf             # PLY: default of all
 *   range_sigma_m: 0.0001
 *   no_return_m: 32.767        # .3d
 *   scans:
 *     - {name: front, file: bun000.ply}
 *     - {name: stand2, file: scan001.3d, pose_file: scan001.pose}
 *     - {name: side, file: bun045.ply, pose: [x, y, z, qx, qy, qz, qw]}
 *
 * The pose takes scan to world. */
ST_MUST_CHECK enum st import_list_scans(const char *path, struct scan_job **out_jobs,
                                        size_t *out_count, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
