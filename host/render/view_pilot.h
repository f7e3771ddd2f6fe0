/* The eye of the viewer: where it is, where it looks, how input moves it. World: z up. */
#ifndef SC_RENDER_VIEW_PILOT_H
#define SC_RENDER_VIEW_PILOT_H

#include "raster/raster.h"

#ifdef __cplusplus
extern "C" {
#endif

enum view_mode {
    VIEW_ORBIT, /* around the pivot */
    VIEW_WALK,  /* on foot: forward stays level */
    VIEW_FLY,   /* forward is where one looks */
    VIEW_PLAN   /* parallel, from above */
};
enum { VIEW_MODES = 4 };
const char *view_mode_name(enum view_mode mode);

struct view_pilot {
    enum view_mode mode;
    bool parallel; /* orthographic in the other modes, too */
    struct vec3 eye_m;
    double azimuth_rad;   /* of the view, 0 along +x, counter-clockwise from above */
    double elevation_rad; /* above the horizon, within +-89.9 degrees */
    struct vec3 pivot_m;
    double hfov_rad;
    double width_m; /* of what a parallel view shows */
};

/* Looking at a scene from its middle height, outside of it or within, level. */
struct view_pilot view_pilot_over(struct vec3 centre_m, double radius_m);
/* The eye of a camera pose; roll is lost. */
void view_pilot_from_pose(struct view_pilot *pilot, const struct pose *world_from_cam);

/* Drag by so many radians (orbit turns around the pivot, the others turn the head; in the plan the
 * picture is shifted by view_pilot_pan()). */
void view_pilot_turn(struct view_pilot *pilot, double right_rad, double up_rad);
/* Move the picture's content by so many pixels of a picture that is width_px wide, at the pivot's
 * distance. */
void view_pilot_pan(struct view_pilot *pilot, double right_px, double down_px, int32_t width_px);
/* Nearer by a factor (2: half the distance or width). */
void view_pilot_zoom(struct view_pilot *pilot, double factor);
/* Walk or fly: metres to the right, forward and up. */
void view_pilot_step(struct view_pilot *pilot, double right_m, double forward_m, double up_m);
void view_pilot_set_mode(struct view_pilot *pilot, enum view_mode mode);

/* The view for a picture. radius_m: how far the scene reaches from the pivot, for parallel views.
 */
struct raster_view view_pilot_view(const struct view_pilot *pilot, int32_t width_px,
                                   int32_t height_px, double radius_m);

/* Between two pilots, t from 0 to 1, turning the shorter way. */
struct view_pilot view_pilot_between(const struct view_pilot *a, const struct view_pilot *b,
                                     double t);

/* The world's point under pixel (x, y) at a depth as raster.h defines it; a NaN depth gives NaN. */
struct vec3 view_pilot_point(const struct raster_view *view, double x_px, double y_px,
                             double depth);

#ifdef __cplusplus
}
#endif
#endif
