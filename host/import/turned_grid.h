/* The grid of a turned line scanner, recovered from its points. The instrument sweeps a beam
 * through a half plane that contains an axis (a row), turns that plane about the axis, sweeps
 * again. With the unit vectors a (axis), e2 and e3 = a x e2:
 *
 *   direction(row, column) = cos(t) a + sin(t) (cos(f) e2 + sin(f) e3)
 *   t = column_zero + column * column_step,   f = row_zero + row * row_step  (or a table)
 *
 * Nothing about the counts or the steps is assumed: rows end where the direction jumps back, the
 * axis is what all row planes share, and steps are fitted. */
#ifndef SC_IMPORT_TURNED_GRID_H
#define SC_IMPORT_TURNED_GRID_H

#include "base/sample.h"
#include "base/st.h"
#include "base/vec.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct turned_grid {
    int32_t rows, columns;
    struct vec3 axis, e2, e3;
    double column_zero_rad, column_step_rad;
    double row_zero_rad, row_step_rad; /* the best even spacing */
    double *row_rad;                   /* [rows], as measured */
    bool even_rows;       /* even spacing reproduces every point within the tolerance */
    double even_error_m;  /* largest distance of a point from its place by even rows */
    double table_error_m; /* the same by the table */
};

/* Recovers the grid of points in measuring order, seen from the instrument at 0, and writes row and
 * column into each sample. `tolerance_m` decides whether rows count as even: the table is used only
 * where it pays. ST_UNSUPPORTED if the points do not lie on such a grid (fewer than two rows of
 * eight, columns off the grid by more than a quarter of a step, two points at one place); ST_NOMEM.
 * Free with turned_grid_fini(), which takes a zeroed one or NULL. Cost: three passes. */
ST_MUST_CHECK enum st turned_grid_recover(const struct vec3 *points_m, size_t count,
                                          double tolerance_m, struct polar_sample *samples,
                                          struct turned_grid *out_grid, struct errctx *err);
void turned_grid_fini(struct turned_grid *grid);

/* Direction of a place, unit. Row within the grid. */
struct vec3 turned_grid_direction(const struct turned_grid *grid, uint32_t row, uint32_t column);

#ifdef __cplusplus
}
#endif
#endif
