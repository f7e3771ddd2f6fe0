#include "base/sample_shade.h"

#include "base/photo.h"

#include <math.h>
#include <stdlib.h>

const uint8_t sample_shade_no_return_rgb[3] = {176, 205, 226};
const uint8_t sample_shade_dropped_rgb[3] = {214, 64, 160};
const uint8_t sample_shade_unseen_rgb[3] = {38, 40, 44};

/* Near to far, sRGB, falling lightness so that the order shows in grey too. */
static const double ramp[][3] = {{255, 243, 214}, {252, 203, 140}, {238, 146, 112}, {204, 102, 124},
                                 {150, 86, 150},  {88, 84, 160},   {40, 70, 128}};
enum { RAMP_STEPS = sizeof ramp / sizeof ramp[0] - 1, WINDOW = 2, SCALE_SAMPLES = 65536 };

/* A neighbour within this share of the depth shapes the normal; a guess at "the same thing". */
#define NORMAL_DEPTH_SHARE 0.1

static int by_value(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

enum st sample_shade_auto_scale(const struct sample_grid *grid,
                                struct sample_shade_scale *out_scale) {
    float *ranges = malloc((SCALE_SAMPLES + 1) * sizeof *ranges);
    if (!ranges)
        return ST_NOMEM;
    const size_t places = (size_t)grid->rows * (size_t)grid->columns;
    const size_t stride = places / SCALE_SAMPLES + 1;
    size_t n = 0;
    for (size_t i = 0; i < places; i += stride)
        if (isfinite(grid->samples[i].range_m) && grid->samples[i].range_m > 0.0f)
            ranges[n++] = grid->samples[i].range_m;
    struct sample_shade_scale scale = {1.0, 10.0};
    if (n > 0) {
        qsort(ranges, n, sizeof *ranges, by_value);
        scale.near_m = (double)ranges[n / 25];
        scale.far_m = (double)ranges[n - 1 - n / 25];
    }
    if (!(scale.far_m > 1.001 * scale.near_m)) { /* all at one range: any scale around it */
        scale.near_m *= 0.999;
        scale.far_m *= 1.001;
    }
    free(ranges);
    *out_scale = scale;
    return ST_OK;
}

static void ramp_colour(const struct sample_shade_scale *scale, double range_m, double out[3]) {
    double t = log(range_m / scale->near_m) / log(scale->far_m / scale->near_m);
    t = fmin(1.0, fmax(0.0, t)) * RAMP_STEPS;
    const int i = t >= RAMP_STEPS ? RAMP_STEPS - 1 : (int)t;
    for (int c = 0; c < 3; c++)
        out[c] = ramp[i][c] + (t - i) * (ramp[i + 1][c] - ramp[i][c]);
}

void sample_shade_range_rgb(const struct sample_shade_scale *scale, double range_m,
                            uint8_t out_rgb[3]) {
    double colour[3];
    ramp_colour(scale, range_m, colour);
    for (int c = 0; c < 3; c++)
        out_rgb[c] = (uint8_t)lround(colour[c]);
}

/* q with P = q / inverse: the pinhole's ray or the panorama's unit direction. */
static struct vec3 view_ray(const struct sample_view *view, double u_px, double v_px) {
    if (view->kind == SAMPLE_VIEW_PINHOLE)
        return camera_pinhole_ray(&view->camera, u_px, v_px);
    const struct polar_sample s = {.azimuth_rad = view->left_rad - u_px * view->step_rad_per_px,
                                   .elevation_rad = view->top_rad - v_px * view->step_rad_per_px};
    return sample_direction(&s);
}

/* Slopes of the inverse around a pixel by least squares over the window; 0 where it has one
 * neighbour. */
static void inverse_slopes(const struct sample_view *view, const float *inverse, int32_t u0,
                           int32_t v0, double *out_du, double *out_dv) {
    const int32_t w = view->width_px, h = view->height_px;
    const double here = (double)inverse[(size_t)v0 * (size_t)w + (size_t)u0];
    double uu = 0, uv = 0, vv = 0, ux = 0, vx = 0;
    for (int32_t v = v0 - WINDOW < 0 ? 0 : v0 - WINDOW; v <= v0 + WINDOW && v < h; v++)
        for (int32_t u = u0 - WINDOW < 0 ? 0 : u0 - WINDOW; u <= u0 + WINDOW && u < w; u++) {
            const double d = (double)inverse[(size_t)v * (size_t)w + (size_t)u] - here;
            if (!(fabs(d) <= NORMAL_DEPTH_SHARE * here))
                continue; /* NaN too */
            const double du = u - u0, dv = v - v0;
            uu += du * du;
            uv += du * dv;
            vv += dv * dv;
            ux += du * d;
            vx += dv * d;
        }
    const double det = uu * vv - uv * uv;
    *out_du = det > 0.5 ? (vv * ux - uv * vx) / det : 0.0;
    *out_dv = det > 0.5 ? (uu * vx - uv * ux) / det : 0.0;
}

/* Unit normal towards the eye, in the frame of the view's rays; against the ray where there is none
 * to be had. P = q / w: P_u is along q_u w - q w_u. */
static struct vec3 surface_normal(const struct sample_view *view, const float *inverse, int32_t u,
                                  int32_t v) {
    const double w = (double)inverse[(size_t)v * (size_t)view->width_px + (size_t)u];
    double wu = 0, wv = 0;
    inverse_slopes(view, inverse, u, v, &wu, &wv);
    const struct vec3 q = view_ray(view, u, v);
    const struct vec3 qu =
        vec3_scale(vec3_sub(view_ray(view, u + 0.5, v), view_ray(view, u - 0.5, v)), w);
    const struct vec3 qv =
        vec3_scale(vec3_sub(view_ray(view, u, v + 0.5), view_ray(view, u, v - 0.5)), w);
    const struct vec3 n = vec3_cross(vec3_madd(qu, q, -wu), vec3_madd(qv, q, -wv));
    if (!(vec3_norm(n) > 0.0))
        return vec3_scale(vec3_unit(q), -1.0);
    return vec3_scale(vec3_unit(n), vec3_dot(n, q) > 0.0 ? -1.0 : 1.0);
}

/* Sky light from above, a key light from the front right, a weak one from behind on the left. */
static void clay_colour(struct vec3 normal_w, uint8_t out_rgb[3]) {
    static const double clay[3] = {232, 218, 200};
    const struct vec3 key = {0.45, -0.60, 0.66}, back = {-0.60, 0.65, 0.20};
    const double sky = 0.20 + 0.10 * normal_w.z;
    const double warm = 0.72 * fmax(0.0, vec3_dot(normal_w, key));
    const double cool = 0.22 * fmax(0.0, vec3_dot(normal_w, back));
    const double light[3] = {0.97 * sky + warm + 0.90 * cool, sky + 0.97 * warm + 0.97 * cool,
                             1.08 * sky + 0.90 * warm + 1.1 * cool};
    for (int c = 0; c < 3; c++) /* the lights are linear, the picture nearly a square root */
        out_rgb[c] = (uint8_t)lround(fmin(255.0, clay[c] * pow(light[c], 0.6)));
}

struct shading {
    const struct sample_grid *grid;
    const struct sample_view *view;
    const struct sample_picture *picture;
    const struct sample_shade_scale *scale;
    enum sample_shade_style style;
    struct mat3 world_from_rays;
};

static void surface_colour(const struct shading *s, int32_t u, int32_t v, uint8_t out_rgb[3]) {
    const size_t i = (size_t)v * (size_t)s->view->width_px + (size_t)u;
    const struct polar_sample *sample = s->grid->samples + s->picture->sample[i];
    if (s->style == SAMPLE_SHADE_COLOUR && (sample->flags & SAMPLE_COLOUR)) {
        for (int c = 0; c < 3; c++)
            out_rgb[c] = sample->rgb[c];
        return;
    }
    if (s->style >= SAMPLE_SHADE_INTENSITY && (sample->flags & SAMPLE_INTENSITY)) {
        const double grey = 255.0 * sqrt(fmin(1.0, fmax(0.0, (double)sample->intensity)));
        for (int c = 0; c < 3; c++)
            out_rgb[c] = (uint8_t)lround(grey);
        return;
    }
    const struct vec3 normal = surface_normal(s->view, s->picture->inverse_per_m, u, v);
    if (s->style != SAMPLE_SHADE_RANGE) {
        clay_colour(mat3_mulv(&s->world_from_rays, normal), out_rgb);
        return;
    }
    const struct vec3 ray = view_ray(s->view, u, v);
    double light = 0.35 - 0.65 * vec3_dot(normal, vec3_unit(ray)), colour[3];
    if (s->picture->flags[i] & PHOTO_SILHOUETTE)
        light *= 0.8;
    ramp_colour(s->scale, vec3_norm(ray) / (double)s->picture->inverse_per_m[i], colour);
    for (int c = 0; c < 3; c++)
        out_rgb[c] = (uint8_t)lround(colour[c] * light);
}

void sample_shade(const struct sample_grid *grid, const struct sample_view *view,
                  const struct sample_picture *picture, const struct sample_shade_scale *scale,
                  enum sample_shade_style style, const struct mat3 *world_from_station,
                  uint8_t *out_rgb) {
    struct shading s = {grid, view, picture, scale, style, mat3_identity()};
    if (view->kind == SAMPLE_VIEW_PINHOLE)
        s.world_from_rays = view->station_from_cam;
    if (world_from_station)
        s.world_from_rays = mat3_mul(world_from_station, &s.world_from_rays);
    for (int32_t v = 0; v < view->height_px; v++)
        for (int32_t u = 0; u < view->width_px; u++) {
            const size_t i = (size_t)v * (size_t)view->width_px + (size_t)u;
            const uint8_t *empty = picture->flags[i] & PHOTO_NO_RETURN ? sample_shade_no_return_rgb
                                   : picture->flags[i] & PHOTO_DROPPED ? sample_shade_dropped_rgb
                                                                       : sample_shade_unseen_rgb;
            if (!isnan(picture->inverse_per_m[i]))
                surface_colour(&s, u, v, out_rgb + 3 * i);
            else
                for (int c = 0; c < 3; c++)
                    out_rgb[3 * i + (size_t)c] = empty[c];
        }
}
