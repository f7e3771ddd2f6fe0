#include "raster/raster.h"

static struct raster_view view_at(const struct pose *world_from_cam) {
    struct raster_view view = {.cam_from_world_r = mat3_transpose(&world_from_cam->r),
                               .eye_m = world_from_cam->t_m};
    return view;
}

struct raster_view raster_view_pinhole(const struct camera *camera,
                                       const struct pose *world_from_cam) {
    struct raster_view view = view_at(world_from_cam);
    view.projection = RASTER_PINHOLE;
    view.width_px = camera->width_px;
    view.height_px = camera->height_px;
    view.fx = camera->fx_px;
    view.fy = camera->fy_px;
    view.cx_px = camera->cx_px;
    view.cy_px = camera->cy_px;
    return view;
}

struct raster_view raster_view_orthographic(int32_t width_px, int32_t height_px, double px_per_m,
                                            double near_m, double far_m,
                                            const struct pose *world_from_cam) {
    struct raster_view view = view_at(world_from_cam);
    view.projection = RASTER_ORTHOGRAPHIC;
    view.width_px = width_px;
    view.height_px = height_px;
    view.fx = view.fy = px_per_m;
    view.cx_px = 0.5 * (width_px - 1);
    view.cy_px = 0.5 * (height_px - 1);
    view.near_m = near_m;
    view.far_m = far_m;
    return view;
}

/* Pixel (0,0) is a centre, so the picture starts at -1/2: u' = n (u + 1/2) - 1/2. */
struct raster_view raster_view_supersampled(const struct raster_view *view, int32_t n) {
    struct raster_view fine = *view;
    fine.width_px = view->width_px * n;
    fine.height_px = view->height_px * n;
    fine.fx = view->fx * n;
    fine.fy = view->fy * n;
    fine.cx_px = (view->cx_px + 0.5) * n - 0.5;
    fine.cy_px = (view->cy_px + 0.5) * n - 0.5;
    return fine;
}
