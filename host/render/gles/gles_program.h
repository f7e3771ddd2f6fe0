/* Programs: compiled, linked, their uniforms found. */
#ifndef SC_RENDER_GLES_GLES_PROGRAM_H
#define SC_RENDER_GLES_GLES_PROGRAM_H

#include "base/st.h"
#include "render/gles/gl_api.h"
#include "render/gles/gles_shaders.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What all shaders of the renderer can be told; -1 where one does not ask. */
struct gles_program {
    GLuint id;
    GLint size, bounds, push, layered, mode, skin, points;
};

/* ST_UNSUPPORTED with the compiler's first line. */
ST_MUST_CHECK enum st gles_program_make(const struct gl_api *gl,
                                        const struct gles_shaders_source *source,
                                        struct gles_program *out_program, struct errctx *err);
ST_MUST_CHECK enum st gles_program_make_compute(const struct gl_api *gl,
                                                const char *const parts[GLES_SHADERS_PARTS],
                                                struct gles_program *out_program,
                                                struct errctx *err);

/* Texture units of the renderer's samplers. */
enum {
    GLES_PROGRAM_UNIT_SKINS = 3,
    GLES_PROGRAM_UNIT_DEPTH_IMAGE = 4,
    GLES_PROGRAM_UNIT_COLOUR_IMAGE = 5
};

#ifdef __cplusplus
}
#endif
#endif
