#include "render/gles/gles_compute.h"

#include <stdlib.h>
#include <string.h>

enum { GROUP = GLES_SHADERS_GROUP, TILE_GROUPS = 1024 / GROUP };

enum st gles_compute_init(struct gles_compute *c, const struct gl_api *gl, struct errctx *err) {
    memset(c, 0, sizeof *c);
    c->gl = gl;
    if (!gl->DispatchCompute || !gl->MemoryBarrier)
        return errctx_set(err, ST_UNSUPPORTED, "this GL has no compute shaders");
    enum st st = gles_program_make_compute(gl, gles_shaders_compute_depth, &c->pass[0], err);
    if (!st)
        st = gles_program_make_compute(gl, gles_shaders_compute_colour, &c->pass[1], err);
    if (!st)
        st = gles_program_make_compute(gl, gles_shaders_compute_image, &c->image, err);
    if (!st)
        st = gles_program_make(gl, &gles_shaders_resolve, &c->resolve, err);
    c->ready = !st;
    return st;
}

enum st gles_compute_size(struct gles_compute *c, int32_t width_px, int32_t height_px,
                          struct errctx *err) {
    if (c->width_px == width_px && c->height_px == height_px)
        return ST_OK;
    const struct gl_api *gl = c->gl;
    gl->DeleteBuffers(2, c->buffers);
    gl->DeleteTextures(2, c->images);
    size_t bytes = (size_t)width_px * (size_t)height_px * 4;
    void *zeros = calloc(1, bytes);
    if (!zeros)
        return errctx_set(err, ST_NOMEM, "no memory for %dx%d pixels", (int)width_px,
                          (int)height_px);
    gl->GenBuffers(2, c->buffers);
    gl->GenTextures(2, c->images);
    for (int i = 0; i < 2; i++) {
        gl->BindBuffer(GL_SHADER_STORAGE_BUFFER, c->buffers[i]);
        gl->BufferData(GL_SHADER_STORAGE_BUFFER, (GLsizeiptr)bytes, zeros, GL_DYNAMIC_COPY);
        gl->BindTexture(GL_TEXTURE_2D, c->images[i]);
        gl->TexStorage2D(GL_TEXTURE_2D, 1, GL_R32UI, width_px, height_px);
        gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
        gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    }
    free(zeros);
    c->width_px = width_px;
    c->height_px = height_px;
    return ST_OK;
}

void gles_compute_pass(struct gles_compute *c, int pass, bool points, int tile_count) {
    const struct gl_api *gl = c->gl;
    gl->Uniform1i(c->pass[pass].points, points ? 1 : 0);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, c->buffers[0]);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 1, c->buffers[1]);
    gl->DispatchCompute((GLuint)(tile_count * TILE_GROUPS), 1, 1);
    gl->MemoryBarrier(GL_SHADER_STORAGE_BARRIER_BIT);
}

void gles_compute_image(struct gles_compute *c) {
    const struct gl_api *gl = c->gl;
    gl->UseProgram(c->image.id);
    gl->Uniform2i(c->image.size, c->width_px, c->height_px);
    for (GLuint i = 0; i < 2; i++)
        gl->BindImageTexture(i, c->images[i], 0, GL_FALSE, 0, GL_WRITE_ONLY, GL_R32UI);
    int64_t pixels = (int64_t)c->width_px * c->height_px;
    /* In rows of groups: 65535 each way is what every GPU can do. */
    enum { ROW = 16384 };
    int64_t groups = (pixels + GROUP - 1) / GROUP;
    gl->DispatchCompute((GLuint)(groups < ROW ? groups : ROW), (GLuint)((groups + ROW - 1) / ROW),
                        1);
    gl->MemoryBarrier(GL_TEXTURE_FETCH_BARRIER_BIT | GL_SHADER_STORAGE_BARRIER_BIT);
}

void gles_compute_resolve(struct gles_compute *c) {
    const struct gl_api *gl = c->gl;
    for (GLuint i = 0; i < 2; i++) {
        gl->ActiveTexture(GL_TEXTURE0 + (GLenum)GLES_PROGRAM_UNIT_DEPTH_IMAGE + i);
        gl->BindTexture(GL_TEXTURE_2D, c->images[i]);
    }
    gl->DrawArrays(GL_TRIANGLES, 0, 3);
}
