#include "twin/mesh_load.h"

#include "base/fileio.h"
#include "twin/mesh_ply.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- OBJ ---- */

struct obj {
    const char *at, *end; /* the text; *end is a readable 0 byte, see mesh_load_bytes() */
    const char *name;
    size_t line;
    struct mesh *mesh;
    struct errctx *err;
};

static enum st obj_fail(struct obj *o, enum st st, const char *what) {
    return errctx_set(o->err, st, "%s:%zu: %s", o->name, o->line, what);
}

static void skip_blanks(struct obj *o) {
    while (o->at < o->end && (*o->at == ' ' || *o->at == '\t' || *o->at == '\r'))
        o->at++;
}

static int at_line_end(const struct obj *o) {
    return o->at >= o->end || *o->at == '\n' || *o->at == '#';
}

static void skip_line(struct obj *o) {
    const char *newline = memchr(o->at, '\n', (size_t)(o->end - o->at));
    o->at = newline ? newline + 1 : o->end;
    o->line++;
}

static enum st obj_vertex(struct obj *o) {
    double v[3];
    for (int i = 0; i < 3; i++) {
        skip_blanks(o);
        if (at_line_end(o))
            return obj_fail(o, ST_FORMAT, "a vertex needs three coordinates");
        char *after = NULL;
        v[i] = strtod(o->at, &after);
        if (after == o->at || after > o->end)
            return obj_fail(o, ST_FORMAT, "a vertex coordinate is not a number");
        if (!isfinite(v[i]) || fabs(v[i]) > 1e30)
            return obj_fail(o, ST_INVALID, "a vertex coordinate is not a finite number");
        o->at = after;
    }
    (void)mesh_vertex(o->mesh, vec3_make(v[0], v[1], v[2]), vec3_make(0, 0, 0));
    return o->mesh->st ? obj_fail(o, o->mesh->st, "no memory for more vertices") : ST_OK;
}

/* One corner "v", "v/vt", "v//vn", "v/vt/vn"; v counts from 1, or backwards from the last if
 * negative. */
static enum st obj_corner(struct obj *o, uint32_t *out_vertex) {
    char *after = NULL;
    long n = strtol(o->at, &after, 10);
    if (after == o->at || after > o->end)
        return obj_fail(o, ST_FORMAT, "a face corner is not a number");
    long count = (long)o->mesh->vertex_count;
    long index = n > 0 ? n - 1 : count + n;
    if (n == 0 || index < 0 || index >= count)
        return obj_fail(o, ST_FORMAT, "a face names a vertex that is not there");
    o->at = after;
    while (o->at < o->end && *o->at != ' ' && *o->at != '\t' && *o->at != '\r' && *o->at != '\n')
        o->at++; /* texture and normal are not used */
    *out_vertex = (uint32_t)index;
    return ST_OK;
}

static enum st obj_face(struct obj *o) {
    uint32_t first = 0, before = 0, corner = 0;
    int corners = 0;
    for (skip_blanks(o); !at_line_end(o); skip_blanks(o), corners++) {
        enum st st = obj_corner(o, &corner);
        if (st)
            return st;
        if (corners >= 2)
            mesh_triangle(o->mesh, first, before, corner, 0);
        first = corners ? first : corner;
        before = corner;
    }
    if (o->mesh->st)
        return obj_fail(o, o->mesh->st, "too many triangles");
    return corners < 3 ? obj_fail(o, ST_FORMAT, "a face needs three corners") : ST_OK;
}

static enum st load_obj(const char *text, size_t size, const char *name, struct mesh *mesh,
                        struct errctx *err) {
    struct obj o = {text, text + size, name, 1, mesh, err};
    while (o.at < o.end) {
        skip_blanks(&o);
        enum st st = ST_OK;
        int spaced = o.end - o.at > 1 && (o.at[1] == ' ' || o.at[1] == '\t');
        char what = spaced ? *o.at : 0;
        if (what == 'v' || what == 'f') {
            o.at++;
            st = what == 'v' ? obj_vertex(&o) : obj_face(&o);
        } else if (o.at < o.end && *o.at == 0) {
            st = obj_fail(&o, ST_FORMAT, "this is not a text file: neither OBJ nor PLY");
        }
        if (st)
            return st;
        skip_line(&o);
    }
    return ST_OK;
}

/* ---- both ---- */

static enum st load(const char *text, size_t size, const char *name, struct mesh *mesh,
                    struct errctx *err) {
    int is_ply = size >= 4 && !memcmp(text, "ply", 3) && (text[3] == '\n' || text[3] == '\r');
    enum st st =
        is_ply ? mesh_ply(text, size, name, mesh, err) : load_obj(text, size, name, mesh, err);
    if (!st && !mesh->triangle_count)
        st = errctx_set(err, ST_INVALID, "%s: the mesh has no triangles (%zu vertices)", name,
                        mesh->vertex_count);
    if (st)
        mesh_fini(mesh);
    return st;
}

enum st mesh_load_bytes(const void *bytes, size_t size, const char *name, struct mesh *out_mesh,
                        struct errctx *err) {
    char *text = malloc(size + 1); /* number parsing stops at the final 0 */
    if (!text)
        return errctx_set(err, ST_NOMEM, "%s: out of memory", name);
    memcpy(text, bytes, size);
    text[size] = 0;
    enum st st = load(text, size, name, out_mesh, err);
    free(text);
    return st;
}

enum st mesh_load(const char *path, struct mesh *out_mesh, struct errctx *err) {
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum st st = fileio_read(path, MESH_LOAD_MAX_BYTES, &bytes, &size, err);
    if (st)
        return st;
    st = load((const char *)bytes, size, path, out_mesh, err); /* fileio_read() adds the final 0 */
    free(bytes);
    return st;
}
