/* Light for the eye: what comes along a ray from a scene. Path tracing with few, well chosen rays:
 * lamps are sampled directly (soft shadows), the rest of the light is one bounce; glass is looked
 * through and reflects, paint, wet asphalt, polish and chrome reflect once. */
#ifndef SC_TWIN_LIGHT_H
#define SC_TWIN_LIGHT_H

#include "base/rng.h"
#include "twin/scene.h"

/* The first visible surface that scatters light, seen through any glass before it. */
struct light_surface {
    struct trace_hit hit;
    struct material_sample material;
    enum material_kind kind;
    struct vec3 normal; /* shading normal with the pattern's relief */
    struct vec3 dir;    /* of the ray that met it */
    float through[3];   /* what the panes on the way let pass */
    float added[3];     /* light that joined on the way: reflections on panes, sky, lamps */
    bool found;         /* false: the ray ended in the sky or a lamp, `added` is all there is */
};

/* Follows a camera ray to its surface. `factor` scales all light. */
void light_look(const struct scene *scene, const struct trace_ray *ray, double factor,
                struct rng *rng, struct light_surface *out);

/* Light that falls on the surface, split for filtering: direct and indirect irradiance over pi
 * (multiply by the surface's rgb), and what it mirrors (final radiance). One random sample each. */
struct light_arriving {
    float direct[3], indirect[3], mirrored[3];
};
void light_gather(const struct scene *scene, const struct light_surface *surface, double factor,
                  struct rng *rng, struct light_arriving *out);

/* Radiance of the sky in a direction, the sun's disc left out. */
void light_sky(const struct scene *scene, struct vec3 dir, double factor, float out_rgb[3]);

#endif
