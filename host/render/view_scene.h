/* What to draw of a site that is larger than memory: tiles rejected by the view's frustum, levels
 * of detail by the error on screen, within budgets.
 *
 * Error: the side in pixels that a sample of the tile is drawn with. A tile whose samples come out
 * larger than asked for is replaced by its children, the worst first, as long as the budget of
 * tiles lasts. A parent stays until all of its children that the view can see are in memory, then
 * they replace it at once: never a hole, never a surface twice. What has been refined stays refined
 * until its error is a fifth below the limit, so that a still eye gives a still picture. */
#ifndef SC_RENDER_VIEW_SCENE_H
#define SC_RENDER_VIEW_SCENE_H

#include "render/render.h"
#include "render/tile_cache.h"
#include "render/view_layer.h"

#ifdef __cplusplus
extern "C" {
#endif

enum view_primitive { VIEW_AUTO, VIEW_POINTS, VIEW_SPLATS, VIEW_MESH, VIEW_PLANES };

struct view_quality {
    double error_px;               /* samples are drawn no larger, if there are finer ones */
    int32_t tiles_max;             /* in one frame */
    double load_s;                 /* for reading tiles, a frame */
    enum view_primitive primitive; /* VIEW_PLANES: planes as such, mesh for the others */
    bool skins;                    /* skins are shown: everything is mesh */
    bool planes_pay;               /* a quadrilateral is cheaper than its cells: true with a GPU */
    enum view_layer layer;
};
/* 1 px, 8192 tiles, 10 ms, automatic. */
struct view_quality view_quality_default(void);

struct view_scene;

/* The source's index outlives the scene. cache_bytes 0: 256 MB. */
ST_MUST_CHECK enum st view_scene_create(const struct tile_source *source, size_t cache_bytes,
                                        struct view_scene **out_scene, struct errctx *err);
void view_scene_destroy(struct view_scene *scene); /* takes NULL */

struct view_scene_stats {
    int64_t tiles, samples; /* to draw */
    int64_t missing;        /* tiles that would refine the picture and are not in memory */
    int64_t visited;        /* nodes of the pyramid that were looked at */
    double select_s, load_s;
    double error_px; /* the largest that is drawn */
    bool complete;   /* nothing finer is wanted, or the budget is spent */
    struct tile_cache_stats cache;
};

/* Chooses what to draw and reads what is missing. The items stay valid until the next call.
 * ST_NOMEM. */
ST_MUST_CHECK enum st view_scene_select(struct view_scene *scene, const struct raster_view *view,
                                        const struct view_quality *quality,
                                        const struct render_item **out_items, size_t *out_count,
                                        struct view_scene_stats *out_stats, struct errctx *err);

/* Where the scene is: the middle and the half diagonal of what its coarsest tiles hold (the middle
 * of the photographs' places if they hold nothing). */
void view_scene_place(struct view_scene *scene, struct vec3 *out_centre_m, double *out_radius_m);

#ifdef __cplusplus
}
#endif
#endif
