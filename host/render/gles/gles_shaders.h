/* The shaders' text. Each is made of parts, in order; NULL ends the list. */
#ifndef SC_RENDER_GLES_GLES_SHADERS_H
#define SC_RENDER_GLES_GLES_SHADERS_H

enum {
    GLES_SHADERS_TILES = 128, /* in one uniform block: 112 bytes each, of the 16 KB there must be */
    GLES_SHADERS_TILES_COMPUTE = 4064, /* in one storage buffer: 65024 groups, of the 65535 there
                                          must be */
    GLES_SHADERS_PARTS = 6,
    GLES_SHADERS_GROUP = 64 /* samples of a compute work group */
};

/* Vertex and fragment shaders. */
struct gles_shaders_source {
    const char *vertex[GLES_SHADERS_PARTS], *fragment[GLES_SHADERS_PARTS];
};
extern const struct gles_shaders_source gles_shaders_point, gles_shaders_splat, gles_shaders_mesh,
    gles_shaders_plane, gles_shaders_resolve;

/* Compute shaders of 3.1: depths first, then the colours of those that won, then buffers to images.
 */
extern const char *const gles_shaders_compute_depth[GLES_SHADERS_PARTS];
extern const char *const gles_shaders_compute_colour[GLES_SHADERS_PARTS];
extern const char *const gles_shaders_compute_image[GLES_SHADERS_PARTS];

#endif
