#include "render/view_pilot.h"

#include <math.h>

static const double pi = 3.14159265358979323846;
static const double elevation_max_rad = 1.569; /* never quite upright: the horizon stays level */

const char *view_mode_name(enum view_mode mode) {
    static const char *const names[VIEW_MODES] = {"orbit", "walk", "fly", "plan"};
    return (int)mode < VIEW_MODES ? names[mode] : "?";
}

static struct vec3 ahead(const struct view_pilot *p) {
    double c = cos(p->elevation_rad);
    return vec3_make(c * cos(p->azimuth_rad), c * sin(p->azimuth_rad), sin(p->elevation_rad));
}

static struct vec3 to_right(const struct view_pilot *p) {
    return vec3_make(sin(p->azimuth_rad), -cos(p->azimuth_rad), 0.0);
}

struct view_pilot view_pilot_over(struct vec3 centre_m, double radius_m) {
    struct view_pilot p = {.mode = VIEW_ORBIT,
                           .azimuth_rad = 0.6,
                           .elevation_rad = -0.5,
                           .pivot_m = centre_m,
                           .hfov_rad = 1.2,
                           .width_m = 2.2 * radius_m};
    p.eye_m = vec3_madd(centre_m, ahead(&p), -1.6 * radius_m);
    return p;
}

void view_pilot_from_pose(struct view_pilot *p, const struct pose *world_from_cam) {
    struct vec3 z = {world_from_cam->r.m[2], world_from_cam->r.m[5], world_from_cam->r.m[8]};
    double distance = vec3_norm(vec3_sub(p->pivot_m, p->eye_m));
    p->eye_m = world_from_cam->t_m;
    p->azimuth_rad = atan2(z.y, z.x);
    p->elevation_rad =
        fmin(fmax(asin(fmin(fmax(z.z, -1.0), 1.0)), -elevation_max_rad), elevation_max_rad);
    p->pivot_m = vec3_madd(p->eye_m, ahead(p), fmin(distance, 3.0));
}

void view_pilot_turn(struct view_pilot *p, double right_rad, double up_rad) {
    double distance = vec3_norm(vec3_sub(p->pivot_m, p->eye_m));
    double sign = p->mode == VIEW_ORBIT ? -1.0 : 1.0;
    p->azimuth_rad = remainder(p->azimuth_rad - sign * right_rad, 2.0 * pi);
    p->elevation_rad =
        fmin(fmax(p->elevation_rad + sign * up_rad, -elevation_max_rad), elevation_max_rad);
    if (p->mode == VIEW_ORBIT)
        p->eye_m = vec3_madd(p->pivot_m, ahead(p), -distance);
    else
        p->pivot_m = vec3_madd(p->eye_m, ahead(p), distance);
}

static double px_per_m(const struct view_pilot *p, int32_t width_px) {
    if (p->mode == VIEW_PLAN || p->parallel)
        return width_px / p->width_m;
    double distance = fmax(vec3_norm(vec3_sub(p->pivot_m, p->eye_m)), 0.05);
    return 0.5 * width_px / tan(0.5 * p->hfov_rad) / distance;
}

static void shift(struct view_pilot *p, struct vec3 by) {
    p->eye_m = vec3_add(p->eye_m, by);
    p->pivot_m = vec3_add(p->pivot_m, by);
}

void view_pilot_pan(struct view_pilot *p, double right_px, double down_px, int32_t width_px) {
    double scale = 1.0 / px_per_m(p, width_px);
    struct vec3 right = to_right(p), up = vec3_cross(right, ahead(p));
    if (p->mode == VIEW_PLAN)
        up = vec3_make(cos(p->azimuth_rad), sin(p->azimuth_rad), 0.0);
    shift(p, vec3_madd(vec3_scale(right, -right_px * scale), up, down_px * scale));
}

void view_pilot_zoom(struct view_pilot *p, double factor) {
    struct vec3 away = vec3_sub(p->eye_m, p->pivot_m);
    p->width_m = fmin(fmax(p->width_m / factor, 1e-3), 1e6);
    if (p->mode == VIEW_ORBIT || p->mode == VIEW_PLAN) {
        double distance = fmin(fmax(vec3_norm(away) / factor, 0.02), 1e6);
        p->eye_m = vec3_madd(p->pivot_m, ahead(p), -distance);
    } else {
        p->hfov_rad = fmin(fmax(p->hfov_rad / factor, 0.02), 3.1);
    }
}

void view_pilot_step(struct view_pilot *p, double right_m, double forward_m, double up_m) {
    struct vec3 forward = ahead(p);
    if (p->mode != VIEW_FLY)
        forward = vec3_make(cos(p->azimuth_rad), sin(p->azimuth_rad), 0.0);
    struct vec3 by = vec3_madd(vec3_scale(to_right(p), right_m), forward, forward_m);
    shift(p, vec3_add(by, vec3_make(0, 0, up_m)));
}

void view_pilot_set_mode(struct view_pilot *p, enum view_mode mode) {
    if (p->mode == VIEW_WALK || p->mode == VIEW_FLY) /* orbit around what is ahead */
        p->pivot_m =
            vec3_madd(p->eye_m, ahead(p), fmax(vec3_norm(vec3_sub(p->pivot_m, p->eye_m)), 0.5));
    p->mode = mode;
}

static struct pose pose_of(const struct view_pilot *p, struct vec3 z) {
    struct vec3 x = to_right(p), y = vec3_cross(z, x);
    struct pose pose = {{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}}, p->eye_m};
    return pose;
}

struct raster_view view_pilot_view(const struct view_pilot *p, int32_t width_px, int32_t height_px,
                                   double radius_m) {
    if (p->mode != VIEW_PLAN && !p->parallel) {
        struct camera camera = camera_pinhole(width_px, height_px, p->hfov_rad);
        struct pose pose = pose_of(p, ahead(p));
        struct raster_view view = raster_view_pinhole(&camera, &pose);
        view.near_m = 0.001;
        return view;
    }
    struct vec3 z = p->mode == VIEW_PLAN ? vec3_make(0, 0, -1) : ahead(p);
    struct pose pose = pose_of(p, z);
    double reach = radius_m + vec3_norm(vec3_sub(p->pivot_m, p->eye_m));
    pose.t_m = vec3_madd(p->pivot_m, z, -reach);
    return raster_view_orthographic(width_px, height_px, width_px / p->width_m, 0.0, 2.0 * reach,
                                    &pose);
}

struct view_pilot view_pilot_between(const struct view_pilot *a, const struct view_pilot *b,
                                     double t) {
    struct view_pilot p = *b;
    double turn = remainder(b->azimuth_rad - a->azimuth_rad, 2.0 * pi);
    p.eye_m = vec3_madd(a->eye_m, vec3_sub(b->eye_m, a->eye_m), t);
    p.pivot_m = vec3_madd(a->pivot_m, vec3_sub(b->pivot_m, a->pivot_m), t);
    p.azimuth_rad = a->azimuth_rad + t * turn;
    p.elevation_rad = a->elevation_rad + t * (b->elevation_rad - a->elevation_rad);
    p.hfov_rad = a->hfov_rad + t * (b->hfov_rad - a->hfov_rad);
    return p;
}

struct vec3 view_pilot_point(const struct raster_view *view, double x_px, double y_px,
                             double depth) {
    double z, x, y;
    if (view->projection == RASTER_PINHOLE) {
        z = 1.0 / depth;
        x = (x_px - view->cx_px) / view->fx * z;
        y = (y_px - view->cy_px) / view->fy * z;
    } else {
        z = view->far_m - depth * (view->far_m - view->near_m);
        x = (x_px - view->cx_px) / view->fx;
        y = (y_px - view->cy_px) / view->fy;
    }
    return vec3_add(view->eye_m, mat3_tmulv(&view->cam_from_world_r, vec3_make(x, y, z)));
}
