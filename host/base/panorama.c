#include "base/panorama.h"

#include "base/sample_grid.h"
#include "base/text.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;

enum { BINS = 720, PIXELS_PER_SAMPLE = 3, WIDTH_MAX_PX = 4096, WIDTH_MIN_PX = 320, LEGEND_PX = 56 };

#define RANGE_SIGMA_M   0.01
#define SLOPE_LIMIT_RAD (60.0 * 3.14159265358979323846 / 180.0)

/* The azimuths looked at: everything but the widest empty arc, in bins of half a degree. */
static void azimuth_span(const struct polar_sample *samples, size_t count, double spacing_rad,
                         double *out_left_rad, double *out_width_rad) {
    bool seen[BINS] = {false};
    for (size_t i = 0; i < count; i++) {
        const double turn = (samples[i].azimuth_rad + pi) / (2.0 * pi);
        seen[(int)(BINS * (turn - floor(turn))) % BINS] = true;
    }
    int best = 0, best_start = 0;
    for (int start = 0; start < BINS; start++) {
        int n = 0;
        while (n < BINS && !seen[(start + n) % BINS])
            n++;
        if (n > best) {
            best = n;
            best_start = start;
        }
    }
    /* All around, but for the steps between the samples: the seam is behind. */
    if (best <= 2 || 2.0 * pi * (best - 1) / BINS < 2.0 * spacing_rad) {
        *out_left_rad = pi;
        *out_width_rad = 2.0 * pi;
        return;
    }
    *out_left_rad = -pi + 2.0 * pi * best_start / BINS; /* azimuth falls to the right */
    *out_width_rad = 2.0 * pi * (BINS - best) / BINS;
}

static struct sample_view choose_view(const struct polar_sample *samples, size_t count,
                                      const struct sample_spacing *spacing, int32_t width_px) {
    struct sample_view view = {.kind = SAMPLE_VIEW_PANORAMA};
    double low = INFINITY, high = -INFINITY, width_rad = 0;
    const double widest = fmax(spacing->along_row_rad, spacing->along_column_rad);
    azimuth_span(samples, count, widest, &view.left_rad, &width_rad);
    for (size_t i = 0; i < count; i++) {
        low = fmin(low, samples[i].elevation_rad);
        high = fmax(high, samples[i].elevation_rad);
    }
    double step = fmin(spacing->along_row_rad, spacing->along_column_rad) / PIXELS_PER_SAMPLE;
    if (isnan(step))
        step = width_rad;
    if (width_px > 0)
        step = width_rad / width_px;
    step = fmax(step, width_rad / WIDTH_MAX_PX);
    if (width_px <= 0)
        step = fmin(step, width_rad / WIDTH_MIN_PX);
    view.step_rad_per_px = step;
    view.top_rad = fmin(0.5 * pi, high + 0.5 * step);
    view.width_px = (int32_t)fmax(1.0, round(width_rad / step));
    view.height_px = (int32_t)fmax(1.0, ceil((view.top_rad - fmax(-0.5 * pi, low)) / step));
    view.left_rad -= 0.5 * step; /* of the first pixel's centre */
    return view;
}

static void fill_box(struct image_u8 *im, int32_t x0, int32_t y0, int32_t w, int32_t h,
                     const uint8_t rgb[3]) {
    for (int32_t y = y0; y < y0 + h && y < im->height_px; y++)
        for (int32_t x = x0; x < x0 + w && x < im->width_px; x++)
            memcpy(image_u8_at(im, x, y), rgb, 3);
}

/* 1, 2 or 5 times a power of ten, not below x. */
static double round_up(double x) {
    const double power = pow(10.0, floor(log10(x)));
    const double steps[] = {1.0, 2.0, 5.0};
    for (int i = 0; i < 3; i++)
        if (steps[i] * power >= x * (1.0 - 1e-9))
            return steps[i] * power;
    return 10.0 * power;
}

static void draw_scale(struct image_u8 *im, struct text_font *font, int32_t y0, int32_t width_px,
                       const struct sample_shade_scale *scale) {
    static const uint8_t ink[3] = {225, 228, 232};
    const int32_t x0 = 16;
    for (int32_t x = 0; x < width_px; x++) {
        uint8_t rgb[3];
        const double t = (x + 0.5) / width_px;
        sample_shade_range_rgb(scale, scale->near_m * pow(scale->far_m / scale->near_m, t), rgb);
        fill_box(im, x0 + x, y0 + 12, 1, 14, rgb);
    }
    double last = -1e9;
    for (double m = round_up(scale->near_m); font && m <= scale->far_m; m = round_up(m * 1.01)) {
        const double x = x0 + width_px * log(m / scale->near_m) / log(scale->far_m / scale->near_m);
        char label[32];
        (void)snprintf(label, sizeof label, "%g m", m);
        const double w = text_width_px(font, 14, label);
        if (x - 0.5 * w < fmax(last, 4.0))
            continue;
        fill_box(im, (int32_t)lround(x), y0 + 26, 1, 4, ink);
        (void)text_draw(font, im, x - 0.5 * w, y0 + 45, 14, ink, label);
        last = x + 0.5 * w + 8;
    }
}

static void draw_legend(struct image_u8 *im, int32_t y0, const struct sample_shade_scale *scale) {
    static const uint8_t paper[3] = {24, 26, 30}, ink[3] = {225, 228, 232};
    static const struct {
        const char *label;
        const uint8_t *rgb;
    } boxes[] = {{"no return", sample_shade_no_return_rgb},
                 {"dropped", sample_shade_dropped_rgb},
                 {"not looked at", sample_shade_unseen_rgb}};
    struct text_font *font = NULL;
    if (text_font_open(NULL, &font, NULL))
        font = NULL;
    fill_box(im, 0, y0, im->width_px, LEGEND_PX, paper);
    const int32_t bar_px = im->width_px / 2 > 32 ? im->width_px / 2 - 32 : 1;
    draw_scale(im, font, y0, bar_px, scale);
    int32_t x = im->width_px / 2 + 8;
    for (int i = 0; i < 3; i++) {
        const double w = font ? text_width_px(font, 14, boxes[i].label) : 40.0;
        if (x + 24 + w > im->width_px)
            break;
        fill_box(im, x - 1, y0 + 11, 20, 16, ink);
        fill_box(im, x, y0 + 12, 18, 14, boxes[i].rgb);
        if (font)
            (void)text_draw(font, im, x + 26, y0 + 24, 14, ink, boxes[i].label);
        x += 46 + (int32_t)w;
    }
    text_font_close(font);
}

static void count_samples(const struct polar_sample *samples, size_t count,
                          struct panorama_info *info) {
    for (size_t i = 0; i < count; i++)
        if (samples[i].flags & SAMPLE_NO_RETURN)
            info->no_returns++;
        else if (samples[i].flags & SAMPLE_DROPPED)
            info->dropped++;
        else
            info->surfaces++;
}

/* Everything between the grid and the finished picture; the planes are the caller's scratch. */
static enum st render_grid(const struct sample_grid *grid, const struct sample_view *view,
                           const struct panorama_options *options,
                           const struct sample_shade_scale *scale, struct sample_picture *picture,
                           struct image_u8 *image, struct errctx *err) {
    const struct sample_draw_options draw = {
        .range_sigma_m = options->range_sigma_m > 0.0 ? options->range_sigma_m : RANGE_SIGMA_M,
        .slope_limit_rad = SLOPE_LIMIT_RAD};
    enum st st = sample_grid_draw(grid, view, &draw, picture, err);
    if (st)
        return st;
    sample_shade(grid, view, picture, scale, options->style, NULL, image->px);
    if (options->legend)
        draw_legend(image, view->height_px, scale);
    return ST_OK;
}

static void write_info(const struct sample_view *view, const struct sample_shade_scale *scale,
                       struct panorama_info *info) {
    const double step = view->step_rad_per_px;
    info->left_rad = view->left_rad + 0.5 * step;
    info->right_rad = info->left_rad - view->width_px * step;
    info->top_rad = view->top_rad + 0.5 * step;
    info->bottom_rad = info->top_rad - view->height_px * step;
    info->near_m = scale->near_m;
    info->far_m = scale->far_m;
}

enum st panorama_render(const struct polar_sample *samples, size_t count,
                        const struct panorama_options *options, struct image_u8 *out_image,
                        struct panorama_info *out_info, struct errctx *err) {
    if (count == 0)
        return errctx_set(err, ST_INVALID, "no samples to draw");
    struct sample_grid grid = {0};
    struct sample_spacing spacing;
    struct sample_shade_scale scale;
    struct sample_picture picture = {0};
    struct image_u8 image = {0};
    struct panorama_info info = {0};
    enum st st = sample_grid_create(samples, count, &grid, err);
    if (st)
        return st;
    if ((st = sample_grid_spacing(&grid, &spacing)) ||
        (st = sample_shade_auto_scale(&grid, &scale)))
        goto out_of_memory;
    if (options->near_m > 0.0 && options->far_m > options->near_m)
        scale = (struct sample_shade_scale){options->near_m, options->far_m};
    const struct sample_view view = choose_view(samples, count, &spacing, options->width_px);
    const size_t n = (size_t)view.width_px * (size_t)view.height_px;
    picture.inverse_per_m = malloc(n * sizeof(float));
    picture.flags = malloc(n);
    picture.sample = malloc(n * sizeof(int32_t));
    st = image_u8_create(&image, view.width_px, view.height_px + (options->legend ? LEGEND_PX : 0),
                         3);
    if (st || !picture.inverse_per_m || !picture.flags || !picture.sample)
        goto out_of_memory;
    st = render_grid(&grid, &view, options, &scale, &picture, &image, err);
    if (st)
        goto out;
    count_samples(samples, count, &info);
    write_info(&view, &scale, &info);
    *out_image = image;
    memset(&image, 0, sizeof image);
    if (out_info)
        *out_info = info;
    goto out;
out_of_memory:
    st = errctx_set(err, ST_NOMEM, "no memory for a panorama of %zu samples", count);
out:
    image_u8_destroy(&image);
    free(picture.inverse_per_m);
    free(picture.flags);
    free(picture.sample);
    sample_grid_destroy(&grid);
    return st;
}
