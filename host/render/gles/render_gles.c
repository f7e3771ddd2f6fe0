/* The GLES renderer: batches of tiles, one draw call each, into an off-screen picture. */
#include "render/gles/egl_context.h"
#include "render/gles/gles_atlas.h"
#include "render/gles/gles_compute.h"
#include "render/gles/gles_program.h"
#include "render/gles/gles_target.h"
#include "render/render_impl.h"
#include "render/render_tile.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Depths are scaled so that 1/1024 m in front of the eye is 1: exact, being a power of two. */
#define DEPTH_SCALE (1.0f / 1024.0f)

/* As `struct tile_rec` of the shaders, std140. */
struct tile_record {
    float x[4], y[4], d[4], w[4];
    int32_t place[4];
    float scale[4], plane[4];
};

struct render_gles {
    struct renderer base;
    struct render_params params;
    struct egl_context *egl; /* NULL: lost, or not yet there */
    const struct gl_api *gl;
    struct gles_program programs[RENDER_PRIMITIVES];
    struct gles_compute compute; /* 3.1 only */
    struct gles_atlas atlas;
    struct gles_target target;
    GLuint vertices, block; /* block: a buffer of tile records */
    float point_max_px;
    uint64_t batch;
    /* Of the frame being drawn. */
    const struct render_frame *frame;
    struct render_stats *stats;
    struct tile_record records[GLES_SHADERS_TILES_COMPUTE];
    int record_count;
    float bounds[4], push[4];
};

/* ---- the context and what lives in it ---- */

static void describe(struct render_gles *r) {
    union {
        const GLubyte *gl;
        const char *text;
    } name = {.gl = r->gl->GetString(GL_RENDERER)};
    (void)snprintf(r->base.description, sizeof r->base.description, "%s: %s",
                   render_kind_name(r->base.kind), name.text ? name.text : "?");
}

static void gles_drop(struct render_gles *r, bool context_gone) {
    struct errctx ignored;
    if (r->egl && !context_gone && !egl_context_use(r->egl, &ignored)) {
        gles_atlas_fini(&r->atlas);
        gles_target_fini(&r->target);
    } else {
        gles_atlas_forget(&r->atlas);
        memset(&r->target, 0, sizeof r->target);
    }
    memset(&r->compute, 0, sizeof r->compute); /* objects die with the context */
    egl_context_close(r->egl);
    r->egl = NULL;
    r->gl = NULL;
}

static enum st make_programs(struct render_gles *r, struct errctx *err) {
    static const struct gles_shaders_source *const sources[RENDER_PRIMITIVES] = {
        &gles_shaders_point, &gles_shaders_splat, &gles_shaders_mesh, &gles_shaders_plane};
    enum st st = ST_OK;
    for (int i = 0; i < RENDER_PRIMITIVES && !st; i++)
        st = gles_program_make(r->gl, sources[i], &r->programs[i], err);
    if (!st && r->base.kind == RENDER_GLES31)
        st = gles_compute_init(&r->compute, r->gl, err);
    return st;
}

static enum st begin(struct render_gles *r, struct errctx *err) {
    if (r->egl && !egl_context_use(r->egl, err))
        return ST_OK;
    if (r->egl)
        gles_drop(r, true);
    enum st st = egl_context_open(r->base.kind == RENDER_GLES31 ? 1 : 0, &r->egl, err);
    if (st)
        return st;
    r->gl = egl_context_gl(r->egl);
    GLfloat range[2] = {1.0f, 1.0f};
    r->gl->GetFloatv(GL_ALIASED_POINT_SIZE_RANGE, range);
    r->point_max_px = range[1];
    r->gl->GenVertexArrays(1, &r->vertices);
    r->gl->BindVertexArray(r->vertices);
    r->gl->GenBuffers(1, &r->block);
    st = make_programs(r, err);
    if (!st)
        st = gles_atlas_init(&r->atlas, r->gl, r->params.gpu_bytes, err);
    if (st)
        gles_drop(r, false);
    else
        describe(r);
    return st;
}

/* ---- batches ---- */

/* What a pass draws. */
enum pass { PASS_SURFACE, PASS_SKINS };

struct call {
    enum pass pass;
    enum render_primitive primitive;
    bool layered; /* surfaces hide behind the skins of their own photograph */
};

static void set_uniforms(struct render_gles *r, const struct gles_program *p,
                         const struct call *call) {
    const struct raster_options *o = r->frame->options;
    r->gl->UseProgram(p->id);
    r->gl->Uniform2i(p->size, r->target.width_px, r->target.height_px);
    r->gl->Uniform4f(p->bounds, r->bounds[0], r->bounds[1], r->bounds[2], r->bounds[3]);
    r->gl->Uniform4f(p->push, r->push[0], r->push[1], r->push[2], r->push[3]);
    r->gl->Uniform1i(p->layered, call->layered ? 1 : 0);
    int mode = 0;
    if (call->pass == PASS_SKINS)
        mode = o->skins == RASTER_SKINS_UNKNOWN ? 2 : 1;
    else if (o->skins == RASTER_SKINS_DRAW)
        mode = 3;
    r->gl->Uniform1i(p->mode, mode);
    r->gl->Uniform4f(p->skin, (float)o->skin_rgb[0] / 255.0f, (float)o->skin_rgb[1] / 255.0f,
                     (float)o->skin_rgb[2] / 255.0f, (float)RASTER_ALPHA_UNKNOWN / 255.0f);
}

static void flush(struct render_gles *r, const struct call *call) {
    static const int vertices[RENDER_PRIMITIVES] = {1024, 1024, 6144, 6};
    if (!r->record_count)
        return;
    const struct gl_api *gl = r->gl;
    bool discs = call->primitive == RENDER_POINTS || call->primitive == RENDER_SPLATS;
    bool compute = discs && r->compute.ready;
    GLenum kind = compute ? GL_SHADER_STORAGE_BUFFER : GL_UNIFORM_BUFFER;
    GLsizeiptr bytes = (GLsizeiptr)sizeof *r->records;
    gl->BindBuffer(kind, r->block);
    gl->BufferData(kind, bytes * (compute ? r->record_count : GLES_SHADERS_TILES), r->records,
                   GL_STREAM_DRAW);
    gl->BindBufferBase(kind, compute ? GLES_COMPUTE_TILES : 0, r->block);
    gles_atlas_bind(&r->atlas);
    gl->ActiveTexture(GL_TEXTURE0 + GLES_PROGRAM_UNIT_SKINS);
    gl->BindTexture(GL_TEXTURE_2D, call->layered ? r->target.skin_depth : 0);
    if (compute) {
        for (int i = 0; i < GLES_COMPUTE_PASSES; i++) {
            set_uniforms(r, &r->compute.pass[i], call);
            gles_compute_pass(&r->compute, i, call->primitive == RENDER_POINTS, r->record_count);
        }
        gles_compute_image(&r->compute);
        set_uniforms(r, &r->compute.resolve, call);
        gles_compute_resolve(&r->compute);
    } else {
        set_uniforms(r, &r->programs[call->primitive], call);
        gl->DrawArrays(discs ? GL_POINTS : GL_TRIANGLES, 0,
                       r->record_count * vertices[call->primitive]);
    }
    r->record_count = 0;
    r->batch++;
}

static void record_make(const struct render_gles *r, const struct render_item *item,
                        const struct render_projection *p, const int32_t place[3],
                        struct tile_record *out) {
    const struct tile *tile = item->tile;
    for (int j = 0; j < 4; j++) {
        out->x[j] = (float)p->c[j];
        out->y[j] = (float)p->c[4 + j];
        out->d[j] = (float)p->c[8 + j];
        out->w[j] = (float)p->c[12 + j];
    }
    memcpy(out->place, place, 3 * sizeof *place);
    out->place[3] = tile->width_px | tile->height_px << 8 | tile->cells_x << 16 |
                    (int32_t)((uint32_t)tile->cells_y << 24);
    out->scale[0] = (float)render_tile_radius_px(r->frame->view, tile, r->frame->options);
    out->scale[1] = (float)p->lin_px;
    memcpy(out->plane, item->plane, sizeof item->plane);
}

/* Puts the item into the batch, drawing the batch first if it is full. */
static void add(struct render_gles *r, const struct render_item *item, const struct call *call) {
    const struct tile *tile = item->tile;
    struct render_projection p = render_tile_project(r->frame->view, tile);
    double reach_px = 2.0;
    if (call->pass == PASS_SURFACE && call->primitive == RENDER_SPLATS)
        reach_px += (double)r->bounds[1];
    struct render_bounds bounds = {tile->cells_x, tile->cells_y, (double)tile->disparity_min_per_m,
                                   (double)tile->disparity_max_per_m};
    if (!render_tile_extent(r->frame->view, &p, &bounds, reach_px).visible)
        return;
    bool discs = call->primitive == RENDER_POINTS || call->primitive == RENDER_SPLATS;
    int room = discs && r->compute.ready ? GLES_SHADERS_TILES_COMPUTE : GLES_SHADERS_TILES;
    if (r->record_count == room)
        flush(r, call);
    int32_t place[3];
    uint8_t leave_out = r->frame->options->leave_out_flags;
    if (!gles_atlas_place(&r->atlas, item, leave_out, r->batch, place)) {
        flush(r, call);
        (void)gles_atlas_place(&r->atlas, item, leave_out, r->batch, place);
    }
    record_make(r, item, &p, place, &r->records[r->record_count++]);
    if (call->pass == PASS_SURFACE) {
        r->stats->tiles_drawn++;
        r->stats->samples_drawn += tile->valid_count;
        r->stats->tiles_by_primitive[call->primitive]++;
    }
}

static void draw_pass(struct render_gles *r, enum pass pass, bool layered, size_t first,
                      size_t end) {
    static const enum render_primitive order[RENDER_PRIMITIVES] = {RENDER_PLANE, RENDER_MESH,
                                                                   RENDER_SPLATS, RENDER_POINTS};
    for (int k = 0; k < RENDER_PRIMITIVES; k++) {
        /* skins are cells whatever primitive their tile has */
        if (pass == PASS_SKINS && k > 0)
            break;
        struct call call = {pass, pass == PASS_SKINS ? RENDER_MESH : order[k], layered};
        for (size_t i = first; i < end; i++)
            if (pass == PASS_SKINS || r->frame->items[i].primitive == order[k])
                add(r, &r->frame->items[i], &call);
        flush(r, &call);
    }
}

/* ---- a frame ---- */

static size_t input_end(const struct render_frame *frame, size_t first) {
    size_t end = first + 1;
    while (end < frame->item_count && frame->items[end].input == frame->items[first].input)
        end++;
    return end;
}

/* Several photographs: each one's surfaces behind its own skins are not drawn; where nothing was
 * drawn at all, skins show. */
static void draw_layered(struct render_gles *r) {
    const struct gl_api *gl = r->gl;
    size_t n = r->frame->item_count;
    for (size_t first = 0; first < n;) {
        size_t end = input_end(r->frame, first);
        gl->Disable(GL_STENCIL_TEST);
        gles_target_skins(&r->target);
        draw_pass(r, PASS_SKINS, false, first, end);
        gles_target_surface(&r->target);
        gl->Enable(GL_STENCIL_TEST);
        gl->StencilFunc(GL_ALWAYS, 1, 0xff);
        gl->StencilOp(GL_KEEP, GL_KEEP, GL_REPLACE);
        draw_pass(r, PASS_SURFACE, true, first, end);
        first = end;
    }
    gl->StencilFunc(GL_EQUAL, 0, 0xff);
    gl->StencilOp(GL_KEEP, GL_KEEP, GL_KEEP);
    draw_pass(r, PASS_SKINS, false, 0, n);
    gl->Disable(GL_STENCIL_TEST);
}

static void set_frame(struct render_gles *r, const struct render_frame *frame) {
    const struct raster_view *view = frame->view;
    const struct raster_options *o = frame->options;
    double scale_px = sqrt(view->fx * view->fy), depth_max = 1.0, push = o->push_sigma;
    r->bounds[2] = r->bounds[3] = 0.0f;
    if (view->projection == RASTER_PINHOLE) {
        depth_max = fmin(1.0 / view->near_m, (double)FLT_MAX);
        r->bounds[2] = (float)(o->falloff / scale_px);
    } else {
        double range_m = view->far_m - view->near_m;
        r->bounds[3] = (float)(o->falloff / (scale_px * range_m));
        push /= range_m;
    }
    r->bounds[0] = (float)depth_max;
    r->bounds[1] = (float)fmin(o->radius_max_px, 0.5 * (double)r->point_max_px - 2.0);
    r->push[0] = (float)push;
    r->push[1] = (float)o->sigma_unknown_per_m;
    r->push[2] = DEPTH_SCALE;
    r->push[3] = o->filter == RASTER_FILTER_NEAREST ? 1.0f : 0.0f;
    r->frame = frame;
}

static enum st gles_draw(struct renderer *renderer, const struct render_frame *frame,
                         const struct raster_target *target, struct render_stats *stats,
                         struct errctx *err) {
    struct render_gles *r = (struct render_gles *)renderer;
    const struct raster_options *o = frame->options;
    if (o->filter == RASTER_FILTER_CUBIC)
        return errctx_set(err, ST_UNSUPPORTED,
                          "the cubic filter is the portable renderer's; take linear with GL");
    enum st st = begin(r, err);
    if (!st)
        st = gles_target_size(&r->target, r->gl, target->width_px, target->height_px, err);
    if (!st && r->compute.ready)
        st = gles_compute_size(&r->compute, target->width_px, target->height_px, err);
    if (st)
        return st;
    r->stats = stats;
    r->record_count = 0;
    r->batch++;
    r->atlas.bytes_sent = 0;
    set_frame(r, frame);
    gles_target_begin(&r->target, o->background_rgb, target->depth != NULL);
    if (o->faces == RASTER_FACES_FRONT)
        r->gl->Enable(GL_CULL_FACE);
    else
        r->gl->Disable(GL_CULL_FACE);
    size_t n = frame->item_count;
    bool skins = o->skins != RASTER_SKINS_LEAVE_OUT && o->skins != RASTER_SKINS_DRAW;
    bool several = n > 0 && input_end(frame, 0) < n;
    if (skins && several && o->skins != RASTER_SKINS_ONLY) {
        draw_layered(r);
    } else {
        if (o->skins != RASTER_SKINS_ONLY)
            draw_pass(r, PASS_SURFACE, false, 0, n);
        if (skins)
            draw_pass(r, PASS_SKINS, false, 0, n);
    }
    gles_target_read(&r->target, target);
    stats->bytes_sent = r->atlas.bytes_sent;
    GLenum error = r->gl->GetError();
    if (error == GL_NO_ERROR)
        return ST_OK;
    gles_drop(r, true);
    return errctx_set(err, ST_DEVICE, "OpenGL failed with error 0x%04x", (unsigned)error);
}

static void gles_lose_context(struct renderer *renderer) {
    gles_drop((struct render_gles *)renderer, true);
}

static void gles_destroy(struct renderer *renderer) {
    gles_drop((struct render_gles *)renderer, false);
    free(renderer);
}

static const struct render_ops gles_ops = {gles_draw, gles_lose_context, gles_destroy};

enum st render_gles_create(enum render_kind kind, const struct render_params *params,
                           struct renderer **out_renderer, struct errctx *err) {
    struct render_gles *r = calloc(1, sizeof *r);
    if (!r)
        return errctx_set(err, ST_NOMEM, "no memory for a renderer");
    r->base = (struct renderer){.ops = &gles_ops, .kind = kind};
    r->params = *params;
    enum st st = begin(r, err);
    if (st) {
        free(r);
        return st;
    }
    *out_renderer = &r->base;
    return ST_OK;
}
