#include "render/gles/gles_target.h"

#include <math.h>
#include <string.h>

static GLuint renderbuffer(const struct gl_api *gl, GLenum format, GLenum attachment, GLsizei w,
                           GLsizei h) {
    GLuint id = 0;
    gl->GenRenderbuffers(1, &id);
    gl->BindRenderbuffer(GL_RENDERBUFFER, id);
    gl->RenderbufferStorage(GL_RENDERBUFFER, format, w, h);
    gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, id);
    return id;
}

void gles_target_fini(struct gles_target *t) {
    if (t->gl) {
        const GLuint frames[2] = {t->frame, t->skin_frame};
        const GLuint buffers[3] = {t->colour, t->bits, t->depth};
        t->gl->DeleteFramebuffers(2, frames);
        t->gl->DeleteRenderbuffers(3, buffers);
        t->gl->DeleteTextures(1, &t->skin_depth);
    }
    memset(t, 0, sizeof *t);
}

static enum st make(struct gles_target *t, struct errctx *err) {
    const struct gl_api *gl = t->gl;
    GLsizei w = t->width_px, h = t->height_px;
    (void)gl->GetError();
    gl->GenFramebuffers(1, &t->frame);
    gl->BindFramebuffer(GL_FRAMEBUFFER, t->frame);
    t->colour = renderbuffer(gl, GL_RGBA8, GL_COLOR_ATTACHMENT0, w, h);
    t->bits = renderbuffer(gl, GL_R32UI, GL_COLOR_ATTACHMENT1, w, h);
    t->depth = renderbuffer(gl, GL_DEPTH32F_STENCIL8, GL_DEPTH_STENCIL_ATTACHMENT, w, h);
    GLenum complete = gl->CheckFramebufferStatus(GL_FRAMEBUFFER);
    gl->GenFramebuffers(1, &t->skin_frame);
    gl->BindFramebuffer(GL_FRAMEBUFFER, t->skin_frame);
    gl->GenTextures(1, &t->skin_depth);
    gl->BindTexture(GL_TEXTURE_2D, t->skin_depth);
    gl->TexStorage2D(GL_TEXTURE_2D, 1, GL_DEPTH_COMPONENT32F, w, h);
    gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl->FramebufferTexture2D(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_TEXTURE_2D, t->skin_depth, 0);
    static const GLenum none = GL_NONE;
    gl->DrawBuffers(1, &none);
    if (gl->CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE ||
        complete != GL_FRAMEBUFFER_COMPLETE || gl->GetError() != GL_NO_ERROR) {
        gles_target_fini(t);
        return errctx_set(err, ST_UNSUPPORTED,
                          "this GL draws no pictures of %dx%d pixels with depths in float", (int)w,
                          (int)h);
    }
    return ST_OK;
}

enum st gles_target_size(struct gles_target *t, const struct gl_api *gl, int32_t width_px,
                         int32_t height_px, struct errctx *err) {
    if (t->gl && t->width_px == width_px && t->height_px == height_px)
        return ST_OK;
    gles_target_fini(t);
    GLint side_max = 0;
    gl->GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &side_max);
    if (width_px > side_max || height_px > side_max)
        return errctx_set(err, ST_UNSUPPORTED, "%dx%d pixels; this GL draws up to %d each way",
                          (int)width_px, (int)height_px, (int)side_max);
    t->gl = gl;
    t->width_px = width_px;
    t->height_px = height_px;
    return make(t, err);
}

void gles_target_begin(struct gles_target *t, const uint8_t background_rgb[3], bool with_depth) {
    const struct gl_api *gl = t->gl;
    const GLenum buffers[2] = {GL_COLOR_ATTACHMENT0, with_depth ? GL_COLOR_ATTACHMENT1 : GL_NONE};
    const GLfloat background[4] = {(float)background_rgb[0] / 255.0f,
                                   (float)background_rgb[1] / 255.0f,
                                   (float)background_rgb[2] / 255.0f, 0.0f};
    static const GLuint no_bits[4] = {0, 0, 0, 0};
    static const GLfloat far_away = 0.0f;
    static const GLint no_stencil = 0;
    gl->BindFramebuffer(GL_FRAMEBUFFER, t->frame);
    gl->DrawBuffers(2, buffers);
    gl->Viewport(0, 0, t->width_px, t->height_px);
    gl->Enable(GL_DEPTH_TEST);
    gl->DepthFunc(GL_GEQUAL);
    gl->DepthMask(GL_TRUE);
    gl->ClearBufferfv(GL_COLOR, 0, background);
    if (with_depth)
        gl->ClearBufferuiv(GL_COLOR, 1, no_bits);
    gl->ClearBufferfv(GL_DEPTH, 0, &far_away);
    gl->ClearBufferiv(GL_STENCIL, 0, &no_stencil);
}

void gles_target_skins(struct gles_target *t) {
    static const GLfloat far_away = 0.0f;
    t->gl->BindFramebuffer(GL_FRAMEBUFFER, t->skin_frame);
    t->gl->ClearBufferfv(GL_DEPTH, 0, &far_away);
}

void gles_target_surface(struct gles_target *t) {
    t->gl->BindFramebuffer(GL_FRAMEBUFFER, t->frame);
}

void gles_target_read(struct gles_target *t, const struct raster_target *out) {
    const struct gl_api *gl = t->gl;
    gl->BindFramebuffer(GL_FRAMEBUFFER, t->frame);
    gl->PixelStorei(GL_PACK_ALIGNMENT, 1);
    gl->ReadBuffer(GL_COLOR_ATTACHMENT0);
    if (out->rgba)
        gl->ReadPixels(0, 0, t->width_px, t->height_px, GL_RGBA, GL_UNSIGNED_BYTE, out->rgba);
    if (!out->depth)
        return;
    /* The format that every GL has for such a buffer is four channels wide: a row at a time. */
    gl->ReadBuffer(GL_COLOR_ATTACHMENT1);
    size_t w = (size_t)t->width_px;
    GLint format = 0, type = 0;
    gl->GetIntegerv(GL_IMPLEMENTATION_COLOR_READ_FORMAT, &format);
    gl->GetIntegerv(GL_IMPLEMENTATION_COLOR_READ_TYPE, &type);
    bool narrow = format == GL_RED_INTEGER && type == GL_UNSIGNED_INT;
    enum { CHUNK = 256 };
    uint32_t wide[4 * CHUNK];
    if (narrow)
        gl->ReadPixels(0, 0, t->width_px, t->height_px, GL_RED_INTEGER, GL_UNSIGNED_INT,
                       out->depth);
    for (int32_t y = 0; !narrow && y < t->height_px; y++)
        for (int32_t x = 0; x < t->width_px; x += CHUNK) {
            int32_t n = t->width_px - x < CHUNK ? t->width_px - x : CHUNK;
            gl->ReadPixels(x, y, n, 1, GL_RGBA_INTEGER, GL_UNSIGNED_INT, wide);
            for (int32_t i = 0; i < n; i++)
                memcpy(out->depth + (size_t)y * w + (size_t)(x + i), wide + 4 * i, 4);
        }
    for (size_t i = 0; i < w * (size_t)t->height_px; i++) {
        uint32_t bits;
        memcpy(&bits, out->depth + i, 4);
        bits = bits ? bits - 1u : 0x7fc00000u; /* NaN */
        memcpy(out->depth + i, &bits, 4);
    }
}
