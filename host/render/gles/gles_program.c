#include "render/gles/gles_program.h"

#include <string.h>

static enum st compile(const struct gl_api *gl, GLenum kind,
                       const char *const parts[GLES_SHADERS_PARTS], GLuint *out_shader,
                       struct errctx *err) {
    GLsizei count = 0;
    while (count < GLES_SHADERS_PARTS && parts[count])
        count++;
    GLuint shader = gl->CreateShader(kind);
    GLint ok = 0;
    gl->ShaderSource(shader, count, parts, NULL);
    gl->CompileShader(shader);
    gl->GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
    if (!ok) {
        char log[400] = "";
        gl->GetShaderInfoLog(shader, sizeof log, NULL, log);
        gl->DeleteShader(shader);
        return errctx_set(err, ST_UNSUPPORTED, "this GL does not take our shaders: %s", log);
    }
    *out_shader = shader;
    return ST_OK;
}

static void sampler(const struct gl_api *gl, GLuint program, const char *name, GLint unit) {
    GLint at = gl->GetUniformLocation(program, name);
    if (at >= 0)
        gl->Uniform1i(at, unit);
}

static void find_uniforms(const struct gl_api *gl, struct gles_program *p) {
    GLuint id = p->id;
    p->size = gl->GetUniformLocation(id, "u_size");
    p->bounds = gl->GetUniformLocation(id, "u_bounds");
    p->push = gl->GetUniformLocation(id, "u_push");
    p->layered = gl->GetUniformLocation(id, "u_layered");
    p->mode = gl->GetUniformLocation(id, "u_mode");
    p->skin = gl->GetUniformLocation(id, "u_skin");
    p->points = gl->GetUniformLocation(id, "u_points");
    gl->UseProgram(id);
    sampler(gl, id, "u_disparity", 0);
    sampler(gl, id, "u_colour", 1);
    sampler(gl, id, "u_meta", 2);
    sampler(gl, id, "u_skins", GLES_PROGRAM_UNIT_SKINS);
    sampler(gl, id, "u_depth_image", GLES_PROGRAM_UNIT_DEPTH_IMAGE);
    sampler(gl, id, "u_colour_image", GLES_PROGRAM_UNIT_COLOUR_IMAGE);
    GLuint block = gl->GetUniformBlockIndex(id, "Tiles");
    if (block != GL_INVALID_INDEX)
        gl->UniformBlockBinding(id, block, 0);
}

static enum st link(const struct gl_api *gl, const GLuint *shaders, int count,
                    struct gles_program *out_program, struct errctx *err) {
    struct gles_program p = {.id = gl->CreateProgram()};
    GLint ok = 0;
    for (int i = 0; i < count; i++)
        gl->AttachShader(p.id, shaders[i]);
    gl->LinkProgram(p.id);
    gl->GetProgramiv(p.id, GL_LINK_STATUS, &ok);
    if (!ok) {
        char log[400] = "";
        gl->GetProgramInfoLog(p.id, sizeof log, NULL, log);
        gl->DeleteProgram(p.id);
        return errctx_set(err, ST_UNSUPPORTED, "this GL does not link our shaders: %s", log);
    }
    find_uniforms(gl, &p);
    *out_program = p;
    return ST_OK;
}

enum st gles_program_make(const struct gl_api *gl, const struct gles_shaders_source *source,
                          struct gles_program *out_program, struct errctx *err) {
    GLuint shaders[2] = {0, 0};
    enum st st = compile(gl, GL_VERTEX_SHADER, source->vertex, &shaders[0], err);
    if (!st)
        st = compile(gl, GL_FRAGMENT_SHADER, source->fragment, &shaders[1], err);
    if (!st)
        st = link(gl, shaders, 2, out_program, err);
    gl->DeleteShader(shaders[0]); /* 0 is silently ignored */
    gl->DeleteShader(shaders[1]);
    return st;
}

enum st gles_program_make_compute(const struct gl_api *gl,
                                  const char *const parts[GLES_SHADERS_PARTS],
                                  struct gles_program *out_program, struct errctx *err) {
    GLuint shader = 0;
    enum st st = compile(gl, GL_COMPUTE_SHADER, parts, &shader, err);
    if (!st)
        st = link(gl, &shader, 1, out_program, err);
    gl->DeleteShader(shader);
    return st;
}
