/* Frustum rejection of tiles, and the matrix of those that stay (Nyland et al. 1999, section 5). */
#include "raster/raster_band.h"

#include <float.h>

/* Rows x, y, w of the view over (X, Y, Z) of cam; for a parallel view w is the disparity, which has
 * no column here and is added by raster_cull_tile(). */
static void frame_projection(const struct raster_view *view, struct frame *frame) {
    frame->scale_px = sqrt(view->fx * view->fy);
    double *x = frame->clip, *y = frame->clip + 4, *w = frame->clip + 8;
    x[0] = view->fx;
    y[1] = view->fy;
    double near_depth = INFINITY;
    if (view->projection == RASTER_PINHOLE) {
        x[2] = view->cx_px;
        y[2] = view->cy_px;
        w[2] = 1.0;
        frame->depth_row[3] = 1.0;
        near_depth = 1.0 / view->near_m;
        frame->fall_rel = (float)(frame->options->falloff / frame->scale_px);
        frame->push_gain = (float)frame->options->push_sigma;
    } else {
        x[3] = view->cx_px;
        y[3] = view->cy_px;
        w[3] = 1.0;
        double range_m = view->far_m - view->near_m;
        frame->depth_row[2] = -1.0 / range_m;
        frame->depth_row[3] = view->far_m / range_m;
        near_depth = 1.0;
        frame->fall_abs = (float)(frame->options->falloff / (frame->scale_px * range_m));
        frame->push_gain = (float)(frame->options->push_sigma / range_m);
    }
    frame->depth_max = near_depth < (double)FLT_MAX ? (float)near_depth : FLT_MAX;
}

void raster_cull_frame(const struct raster_view *view, const struct raster_options *options,
                       bool rich, struct frame *out_frame) {
    struct frame frame = {.options = options, .view = view, .rich = rich};
    frame_projection(view, &frame);
    for (int i = 1; i < 256; i++)
        frame.sigma_per_m[i] = (float)photo_sigma_from_confidence((uint8_t)i);
    frame.sigma_per_m[0] = (float)options->sigma_unknown_per_m;
    *out_frame = frame;
}

/* C = P V M with the tile's origin relative to the eye, all in double. */
static void tile_matrix(const struct frame *frame, const struct tile *tile, double c[16]) {
    const struct mat3 *r = &frame->view->cam_from_world_r;
    struct vec3 t = mat3_mulv(r, vec3_sub(tile->origin_m, frame->view->eye_m));
    const double *m = tile->m.m;
    for (int j = 0; j < 4; j++) {
        double w = m[12 + j];
        struct vec3 p = mat3_mulv(r, vec3_make(m[j], m[4 + j], m[8 + j]));
        p = vec3_madd(p, t, w);
        const double *x = frame->clip, *y = frame->clip + 4, *z = frame->clip + 8;
        const double *d = frame->depth_row;
        c[j] = x[0] * p.x + x[2] * p.z + x[3] * w;
        c[4 + j] = y[1] * p.y + y[2] * p.z + y[3] * w;
        c[8 + j] = d[2] * p.z + d[3] * w;
        c[12 + j] = z[2] * p.z + z[3] * w;
    }
}

/* The tile's bounding volume in (u, v, disparity). */
struct box {
    double u_hi, v_hi, d_lo, d_hi;
};

/* The largest value of a linear form over the box: its terms are independent. */
static double form_max(const double row[4], const struct box *box) {
    double sum = row[2];
    sum += row[0] > 0 ? row[0] * box->u_hi : 0.0;
    sum += row[1] > 0 ? row[1] * box->v_hi : 0.0;
    sum += row[3] > 0 ? row[3] * box->d_hi : row[3] * box->d_lo;
    return sum;
}

/* A pixel row as a linear form that is positive inside: sign * (c_row - edge * w) + margin. A splat
 * of radius r = grow_px / w, at least pad_px, reaches margin = grow_px + pad_px * w farther. */
static bool outside(const double c[16], int row, double sign, double edge_px, double pad_px,
                    double grow_px, const struct box *box) {
    double form[4];
    for (int j = 0; j < 4; j++)
        form[j] = sign * (c[4 * row + j] - edge_px * c[12 + j]) + pad_px * c[12 + j];
    form[2] += grow_px;
    return form_max(form, box) < 0.0;
}

/* Rows that the box can touch: y / w is monotone along every edge while w > 0, so the extremes are
 * at corners; a box that reaches behind the eye can touch all. */
static void tile_rows(const struct frame *frame, const struct box *box, double pad_px,
                      double grow_px, struct tile_job *job) {
    double lo = INFINITY, hi = -INFINITY;
    double rows = frame->view->height_px;
    for (int i = 0; i < 8; i++) {
        double q[4] = {i & 1 ? box->u_hi : 0.0, i & 2 ? box->v_hi : 0.0, 1.0,
                       i & 4 ? box->d_hi : box->d_lo};
        double y = 0, w = 0;
        for (int j = 0; j < 4; j++) {
            y += job->c[4 + j] * q[j];
            w += job->c[12 + j] * q[j];
        }
        if (!(w > 0.0)) {
            lo = -INFINITY;
            hi = INFINITY;
            break;
        }
        double reach = fmin(pad_px + grow_px / w, frame->options->radius_max_px + pad_px);
        lo = fmin(lo, y / w - reach);
        hi = fmax(hi, y / w + reach);
    }
    job->y_lo_px = (int32_t)fmin(fmax(floor(lo), 0.0), rows);
    job->y_hi_px = (int32_t)fmax(fmin(ceil(hi), rows - 1.0), -1.0);
}

/* How far the photograph may be read around the tile. */
static void tile_extent(const struct raster_input *input, struct tile_job *job) {
    const struct tile *tile = job->tile;
    job->u_hi = tile->cells_x;
    job->v_hi = tile->cells_y;
    if (input->photo_width_px > 0 && input->photo_height_px > 0) {
        job->u_lo = -tile->u0_px;
        job->v_lo = -tile->v0_px;
        job->u_hi = input->photo_width_px - 1 - tile->u0_px;
        job->v_hi = input->photo_height_px - 1 - tile->v0_px;
    }
}

bool raster_cull_tile(const struct frame *frame, const struct raster_input *input,
                      size_t tile_index, struct tile_job *out_job) {
    const struct tile *tile = &input->tiles[tile_index];
    double d_hi = fmin((double)tile->disparity_max_per_m, (double)FLT_MAX);
    double d_lo = fmax((double)tile->disparity_min_per_m, 0.0);
    if (!(d_lo <= d_hi))
        return false;
    struct tile_job job = {.tile = tile,
                           .item = raster_item(input->id, (uint32_t)tile_index, 0, 0)};
    tile_matrix(frame, tile, job.c);
    const double *m = tile->m.m;
    double det = m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
                 m[2] * (m[4] * m[9] - m[5] * m[8]);
    double magnification = frame->scale_px * frame->scale_px * fabs(det);
    const struct raster_options *options = frame->options;
    double lin_px = sqrt(magnification), grow_px = 0.0, pad_px = 0.5 + 1.0 / 64;
    job.lin_px = (float)lin_px;
    if (options->primitive == RASTER_SPLATS) {
        grow_px = options->radius_k * (options->radius == RASTER_RADIUS_AREA
                                           ? lin_px * (double)RADIUS_MIN_PX
                                           : cbrt(0.5 * magnification));
        pad_px += (double)RADIUS_MIN_PX;
    }
    job.radius_px = (float)grow_px;
    struct box box = {tile->cells_x, tile->cells_y, d_lo, d_hi};
    double w_px = frame->view->width_px - 1.0, h_px = frame->view->height_px - 1.0;
    double behind[4] = {job.c[12], job.c[13], job.c[14], job.c[15]};
    if (!(form_max(behind, &box) > 0.0) || outside(job.c, 0, 1.0, 0.0, pad_px, grow_px, &box) ||
        outside(job.c, 0, -1.0, w_px, pad_px, grow_px, &box) ||
        outside(job.c, 1, 1.0, 0.0, pad_px, grow_px, &box) ||
        outside(job.c, 1, -1.0, h_px, pad_px, grow_px, &box))
        return false;
    tile_rows(frame, &box, pad_px, grow_px, &job);
    if (job.y_lo_px > job.y_hi_px)
        return false;
    tile_extent(input, &job);
    const double middle[4] = {0.5 * tile->cells_x, 0.5 * tile->cells_y, 1.0, d_hi};
    double d = 0.0, w = 0.0;
    for (int j = 0; j < 4; j++) {
        d += job.c[8 + j] * middle[j];
        w += job.c[12 + j] * middle[j];
    }
    job.nearest = w > 0.0 ? (float)fmin(d / w, (double)FLT_MAX) : FLT_MAX;
    *out_job = job;
    return true;
}
