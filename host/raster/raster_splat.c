/* Points and quadratic splats (Nyland et al. 1999, sections 5.1 and 5.4).
 *
 * A row of up to 32 samples is projected into arrays, which the compiler vectorises; samples that
 * can touch the band are then drawn. Footprints up to SMALL_MAX_PX wide, nearly all of them in
 * practice, have the depths of all their pixels computed in the vectorised part as well and are
 * merged without a branch: what does not belong to the disc gets the key 0, which never wins. */
#include "raster/raster_band.h"

#include "base/simd.h"

#include <float.h>

/* Projected samples of one row. */
struct row {
    float x_px[ROW_MAX], y_px[ROW_MAX]; /* centre; the same in whatever band */
    float depth[ROW_MAX];               /* of the centre, not pushed back */
    float top[ROW_MAX];                 /* of the centre, pushed back */
    float r_px[ROW_MAX];
    float fall[ROW_MAX];   /* loss of depth per squared pixel */
    int32_t seen[ROW_MAX]; /* can it touch the band? */
    int32_t list[ROW_MAX]; /* indices of those that can */
    int32_t list_count;
    float r_max_px;
};

/* How the samples of a tile are projected: float constants of one row. */
struct row_form {
    float x0, y0, d0, w0; /* at u = 0 */
    float xu, yu, du, wu; /* per u */
    float xd, yd, dd, wd; /* per disparity */
    float radius_px, radius_max_px, lin_px;
    float x_max, y_min, y_max, depth_max;
    float fall_rel, fall_abs, push_gain;
    bool points;
};

static struct row_form row_form_make(const struct frame *frame, const struct tile_job *job,
                                     const struct band *band) {
    const double *c = job->c;
    struct row_form form = {
        .xu = (float)c[0],
        .yu = (float)c[4],
        .du = (float)c[8],
        .wu = (float)c[12],
        .xd = (float)c[3],
        .yd = (float)c[7],
        .dd = (float)c[11],
        .wd = (float)c[15],
        .radius_px = job->radius_px,
        .radius_max_px = (float)frame->options->radius_max_px,
        .lin_px = job->lin_px,
        .x_max = (float)(band->width_px - 1),
        .y_min = (float)band->y0_px,
        .y_max = (float)(band->y1_px - 1),
        .depth_max = frame->depth_max,
        .fall_rel = frame->fall_rel,
        .fall_abs = frame->fall_abs,
        .push_gain = frame->push_gain,
        .points = frame->options->primitive == RASTER_POINTS,
    };
    return form;
}

static void row_form_at(const struct tile_job *job, int32_t v, struct row_form *form) {
    const double *c = job->c;
    form->x0 = (float)(c[1] * v + c[2]);
    form->y0 = (float)(c[5] * v + c[6]);
    form->d0 = (float)(c[9] * v + c[10]);
    form->w0 = (float)(c[13] * v + c[14]);
}

/* Projects n samples. A point reaches half a pixel, so that it lands where its centre rounds to. */
KERNEL void row_project(const struct row_form *f, const float *disparity, int32_t n,
                        struct row *row) {
    const struct row_form form = *f;
    for (int32_t j = 0; j < n; j++) {
        float delta = disparity[j], u = (float)j;
        float w = form.w0 + form.wu * u + form.wd * delta;
        float inv_w = 1.0f / w;
        float x = (form.x0 + form.xu * u + form.xd * delta) * inv_w;
        float y = (form.y0 + form.yu * u + form.yd * delta) * inv_w;
        float depth = (form.d0 + form.du * u + form.dd * delta) * inv_w;
        float r = form.radius_px * inv_w;
        r = r > RADIUS_MIN_PX ? r : RADIUS_MIN_PX;
        r = r < form.radius_max_px ? r : form.radius_max_px;
        float reach = form.points ? 0.5f : r;
        int32_t seen = (delta >= 0.0f) & (delta <= FLT_MAX) & (w > 0.0f) & (x + reach >= 0.0f) &
                       (x - reach <= form.x_max) & (y + reach >= form.y_min) &
                       (y - reach <= form.y_max) & (depth >= 0.0f) & (depth <= form.depth_max);
        row->seen[j] = seen;
        row->x_px[j] = seen ? x : 0.0f; /* no NaN from here on */
        row->y_px[j] = seen ? y : form.y_min;
        row->depth[j] = row->top[j] = seen ? depth : 0.0f;
        row->r_px[j] = seen ? reach : 0.0f;
        row->fall[j] = seen ? (form.fall_rel * depth + form.fall_abs) / reach : 0.0f;
    }
}

/* Takes the confidence push-back off the depths (section 5.3). sigma(depth) = sigma(delta) / w^2.
 * A splat's own depth is wrong by up to its fall-off, whatever its sensor's noise: a share of that
 * goes back, too, or the middle of a coarse splat would stand before the rims of dense ones. */
KERNEL void row_push(const struct frame *frame, const struct row_form *form,
                     const uint8_t *confidence, const float *disparity, int32_t n,
                     struct row *row) {
    float rim = form->points ? 0.0f : RASTER_SPLAT_RIM;
    for (int32_t j = 0; j < n; j++) {
        float w = form->w0 + form->wu * (float)j + form->wd * disparity[j];
        float inv2 = 1.0f / (w * w);
        float octaves = area_octaves(form->lin_px * form->lin_px * inv2);
        float push = form->push_gain * frame->sigma_per_m[confidence[j]] * inv2 * octaves;
        float top = row->depth[j] - push - rim * row->fall[j] * row->r_px[j] * row->r_px[j];
        row->top[j] = top > 0.0f ? top : 0.0f;
    }
}

/* Lists the samples to draw. Mostly these are all of them. */
KERNEL void row_list(const uint8_t *flags, uint8_t leave_out_flags, int32_t n, struct row *row) {
    float r_max = 0.0f;
    int32_t seen = 0;
    uint8_t any_flags = 0;
    for (int32_t j = 0; j < n; j++)
        r_max = row->r_px[j] > r_max ? row->r_px[j] : r_max;
    for (int32_t j = 0; j < n; j++)
        seen += row->seen[j];
    for (int32_t j = 0; j < n; j++)
        any_flags |= flags[j];
    row->r_max_px = r_max;
    row->list_count = seen;
    if (!seen)
        return;
    if (seen == n && !sample_hidden(any_flags, leave_out_flags)) {
        for (int32_t j = 0; j < n; j++)
            row->list[j] = j;
        return;
    }
    int32_t count = 0;
    for (int32_t j = 0; j < n; j++) {
        row->list[count] = j;
        count += row->seen[j] & !sample_hidden(flags[j], leave_out_flags);
    }
    row->list_count = count;
}

KERNEL void row_colour(const uint8_t *rgb, int32_t n, uint32_t rgba[ROW_MAX]) {
    for (int32_t j = 0; j < n; j++)
        rgba[j] = key_rgba(rgb[3 * j], rgb[3 * j + 1], rgb[3 * j + 2], RASTER_ALPHA_SURFACE);
}

/* Upper half of the key of the pixel at (dx, dy) from a disc's centre, 0 outside; all squared. All
 * ways to draw a disc use this and nothing else, so that they agree to the bit. */
KERNEL uint32_t disc_upper(float top, float fall, float r2_px, float dx2_px, float dy2_px) {
    float s = dx2_px + dy2_px;
    float depth = top - fall * s;
    depth = depth > 0.0f ? depth : 0.0f;
    uint32_t upper = float_bits(depth) + 1u;
    return s < r2_px ? upper : 0u;
}

/* Discs whose bounding squares are at most `side` pixels wide: r <= side / 2. The first pixel is
 * the ceiling of centre - r; BAND_PAD_PX makes the sums positive, where conversion truncates. */
KERNEL void row_draw_small(const struct band *band, const uint32_t *rgba, const struct row *row,
                           int32_t n, int32_t side) {
    uint32_t top[SMALL_MAX_PX * SMALL_MAX_PX][ROW_MAX];
    int32_t first_x[ROW_MAX], first_y[ROW_MAX];
    /* Within r < side / 2 of x lie at most the pixels floor(x) and the next, or round(x) and its
     * neighbours.
     */
    float shift = side == 3 ? -0.5f : 0.0f;
    for (int32_t j = 0; j < n; j++) {
        float x = row->x_px[j] + shift, y = row->y_px[j] + shift;
        int32_t ix = (int32_t)(x + (float)BAND_PAD_PX) - BAND_PAD_PX;
        int32_t iy = (int32_t)(y + (float)BAND_PAD_PX) - BAND_PAD_PX;
        ix -= (float)ix > x; /* the sum may have been rounded */
        iy -= (float)iy > y;
        first_x[j] = ix;
        first_y[j] = iy;
    }
    float dx2[SMALL_MAX_PX][ROW_MAX], dy2[SMALL_MAX_PX][ROW_MAX], r2[ROW_MAX];
    for (int32_t i = 0; i < side; i++)
        for (int32_t j = 0; j < n; j++) {
            float dx = (float)(first_x[j] + i) - row->x_px[j];
            float dy = (float)(first_y[j] + i) - row->y_px[j];
            dx2[i][j] = dx * dx;
            dy2[i][j] = dy * dy;
        }
    for (int32_t j = 0; j < n; j++)
        r2[j] = row->r_px[j] * row->r_px[j];
    for (int32_t iy = 0; iy < side; iy++)
        for (int32_t ix = 0; ix < side; ix++)
            for (int32_t j = 0; j < n; j++)
                top[iy * side + ix][j] =
                    disc_upper(row->top[j], row->fall[j], r2[j], dx2[ix][j], dy2[iy][j]);
    for (int32_t k = 0; k < row->list_count; k++) {
        int32_t j = row->list[k];
        uint64_t lower = rgba[j];
        uint64_t *key = band->key + (first_y[j] - band->y0_px) * band->stride + first_x[j];
        for (int32_t iy = 0; iy < side; iy++)
            for (int32_t ix = 0; ix < side; ix++) {
                uint64_t *at = key + iy * band->stride + ix;
                uint64_t mine = (uint64_t)top[iy * side + ix][j] << 32 | lower;
                *at = mine > *at ? mine : *at;
            }
    }
}

/* Pixels from..to within r of the centre and perhaps one more on each side. */
static inline void disc_bounds(float centre, float r, int32_t first, int32_t last, int32_t *out_lo,
                               int32_t *out_hi) {
    float lo = floorf(centre - r), hi = ceilf(centre + r);
    *out_lo = lo > (float)first ? (int32_t)lo : first;
    *out_hi = hi < (float)last ? (int32_t)hi : last;
}

/* A disc of any radius, clipped to the band. */
KERNEL int64_t draw_disc(const struct band *band, const struct row *row, int32_t j, uint32_t rgba,
                         uint64_t item, bool rich) {
    float x = row->x_px[j], y = row->y_px[j], r = row->r_px[j];
    int32_t x_lo, x_hi, y_lo, y_hi;
    disc_bounds(y, r, band->y0_px, band->y1_px - 1, &y_lo, &y_hi);
    int64_t tested = 0;
    for (int32_t iy = y_lo; iy <= y_hi; iy++) {
        float dy = (float)iy - y, chord = r * r - dy * dy;
        disc_bounds(x, sqrtf(chord > 0.0f ? chord : 0.0f), 0, band->width_px - 1, &x_lo, &x_hi);
        ptrdiff_t line = (iy - band->y0_px) * band->stride;
        uint64_t *key = band->key + line;
        for (int32_t ix = x_lo; ix <= x_hi; ix++) {
            float dx = (float)ix - x;
            uint32_t upper = disc_upper(row->top[j], row->fall[j], r * r, dx * dx, dy * dy);
            uint64_t mine = (uint64_t)upper << 32 | rgba;
            if (!rich)
                key[ix] = mine > key[ix] ? mine : key[ix];
            else if (upper)
                band_put_rich(band, line + ix, mine, item, row->depth[j]);
        }
        tested += x_hi >= x_lo ? x_hi - x_lo + 1 : 0;
    }
    return tested;
}

/* Points: the pixel that the centre rounds to. */
KERNEL void row_draw_points(const struct band *band, const uint32_t *rgba, const struct row *row,
                            int32_t n) {
    int32_t at[ROW_MAX];
    uint32_t top[ROW_MAX];
    int32_t stride = (int32_t)band->stride, last = band->width_px - 1;
    for (int32_t j = 0; j < n; j++) {
        int32_t ix = (int32_t)(row->x_px[j] + 0.5f), iy = (int32_t)(row->y_px[j] + 0.5f);
        ix = ix < last + 1 ? ix : last + 1; /* half a pixel beyond is padding */
        at[j] = (iy - band->y0_px) * stride + ix;
        top[j] = float_bits(row->top[j] + 0.0f) + 1u;
    }
    for (int32_t k = 0; k < row->list_count; k++) {
        int32_t j = row->list[k];
        uint64_t mine = (uint64_t)top[j] << 32 | rgba[j];
        uint64_t *key = band->key + at[j];
        *key = mine > *key ? mine : *key;
    }
}

static inline void draw_point_rich(const struct band *band, const struct row *row, int32_t j,
                                   uint32_t rgba, uint64_t item) {
    int32_t ix = (int32_t)(row->x_px[j] + 0.5f), iy = (int32_t)(row->y_px[j] + 0.5f);
    if (ix < band->width_px && iy >= band->y0_px && iy < band->y1_px)
        band_put_rich(band, (iy - band->y0_px) * band->stride + ix, key_depth(row->top[j]) | rgba,
                      item, row->depth[j]);
}

KERNEL int64_t row_draw(const struct frame *frame, const struct tile_job *job,
                        const struct band *band, const struct row *row, int32_t n, int32_t v) {
    uint32_t rgba[ROW_MAX];
    row_colour(job->tile->rgb + 3 * (ptrdiff_t)v * job->tile->stride_px, n, rgba);
    uint64_t item = job->item + ((uint64_t)(uint32_t)v << 8);
    bool points = frame->options->primitive == RASTER_POINTS;
    if (!frame->rich && points) {
        row_draw_points(band, rgba, row, n);
        return row->list_count;
    }
    if (!frame->rich && row->r_max_px <= 1.0f) {
        row_draw_small(band, rgba, row, n, 2);
        return 4 * (int64_t)row->list_count;
    }
    if (!frame->rich && row->r_max_px <= 1.49f) {
        row_draw_small(band, rgba, row, n, 3);
        return 9 * (int64_t)row->list_count;
    }
    int64_t tested = 0;
    for (int32_t k = 0; k < row->list_count; k++) {
        int32_t j = row->list[k];
        if (points)
            draw_point_rich(band, row, j, rgba[j], item + (uint32_t)j);
        else if (frame->rich)
            tested += draw_disc(band, row, j, rgba[j], item + (uint32_t)j, true);
        else
            tested += draw_disc(band, row, j, rgba[j], 0, false);
    }
    return points ? row->list_count : tested;
}

KERNEL int64_t row_all(const struct frame *frame, const struct tile_job *job,
                       const struct band *band, const struct row_form *form, int32_t n, int32_t v,
                       struct row *row) {
    const struct tile *tile = job->tile;
    ptrdiff_t at = (ptrdiff_t)v * tile->stride_px;
    const float *disparity = tile->disparity_per_m + at;
    row_project(form, disparity, n, row);
    if (frame->push_gain > 0.0f)
        row_push(frame, form, tile->confidence + at, disparity, n, row);
    row_list(tile->flags + at, frame->options->leave_out_flags, n, row);
    return row->list_count ? row_draw(frame, job, band, row, n, v) : 0;
}

SC_SIMD_CLONES
int64_t raster_splat_tile(const struct frame *frame, const struct tile_job *job,
                          const struct band *band) {
    const struct tile *tile = job->tile;
    struct row_form form = row_form_make(frame, job, band);
    struct row row;
    int64_t tested = 0;
    int32_t n = tile->width_px;
    for (int32_t v = 0; v < tile->height_px; v++) {
        row_form_at(job, v, &form);
        if (n == PHOTO_TILE_PX) /* the usual case, as a constant for the compiler */
            tested += row_all(frame, job, band, &form, PHOTO_TILE_PX, v, &row);
        else
            tested += row_all(frame, job, band, &form, n, v, &row);
    }
    return tested;
}
