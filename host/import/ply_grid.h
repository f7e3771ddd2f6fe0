/* Range images as PLY with an element `range_grid` (Stanford): vertices, and for each place of a
 * grid of rows and columns either none or the number of its vertex. ASCII and both binary byte
 * orders. */
#ifndef SC_IMPORT_PLY_GRID_H
#define SC_IMPORT_PLY_GRID_H

#include "base/st.h"
#include "base/vec.h"
#include "import/frame_up.h"
#include "import/scan.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct ply_grid {
    int32_t rows, columns;
    int32_t *vertex; /* [rows][columns], -1: no sample */
    size_t vertex_count;
    struct vec3 *p;   /* [vertex_count], the file's unit and frame */
    float *intensity; /* [vertex_count] as in the file, or NULL */
    uint8_t *rgb;     /* [vertex_count][3], or NULL */
};

/* Parses a whole file. ST_FORMAT with line (header, ASCII) or byte (binary); ST_UNSUPPORTED for a
 * PLY without range_grid; ST_NOMEM. Counts are held against the size of the file before memory is
 * taken. Free with ply_grid_destroy(), which takes NULL or zeroed. */
ST_MUST_CHECK enum st ply_grid_parse(const void *data, size_t size, struct ply_grid *out_grid,
                                     struct errctx *err);
void ply_grid_destroy(struct ply_grid *grid);

/* From which side of the file's frame the instrument looked. A range image of a triangulating
 * scanner has nearly parallel rays; it does not say more. */
struct ply_grid_options {
    double unit_m;              /* length of the file's unit; 0: 1 */
    struct vec3 towards_viewer; /* file's frame; all 0: (0, 0, 1), the Stanford scanner's */
    /* From the middle of the samples to the eye; 0: ten times their extent, which keeps the density
     * of the samples to 5 % and their order as seen. */
    double standoff_m;
    enum frame_up up; /* the axis of the file that is up in the station */
};

/* The samples as seen from the eye, in the station frame; places without a sample are left out,
 * because no ray is known for them. scan->meta says what was assumed. */
ST_MUST_CHECK enum st ply_grid_to_scan(const struct ply_grid *grid,
                                       const struct ply_grid_options *options,
                                       struct scan *out_scan, struct errctx *err);

/* Pose of a scan from the lines of a Stanford `.conf`:
 *   bmesh FILE tx ty tz qx qy qz qw      (mesh and bpolygon likewise)
 * whose quaternion is the inverse rotation: p_world = R(q)^T p + t. `file` is compared without
 * folders. The result is in the file's unit and frame. ST_NOT_FOUND if no line names the file,
 * ST_FORMAT. */
ST_MUST_CHECK enum st ply_grid_conf_pose(const void *data, size_t size, const char *file,
                                         struct pose *out_world_from_file, struct errctx *err);

/* The same pose between the frames and units of ply_grid_to_scan(). */
struct pose ply_grid_station_pose(const struct pose *world_from_file,
                                  const struct ply_grid_options *options);

#ifdef __cplusplus
}
#endif
#endif
