#include "import/ply_grid.h"

#include "base/fileio.h"
#include "base/sample_grid.h"
#include "import/ply_header.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VERTICES_MAX = 1 << 27, PLACES_MAX = 1 << 28, STANDOFF_EXTENTS = 10 };
/* Coordinates beyond this are no lengths but garbage. */
#define COORDINATE_MAX 1e9

void ply_grid_destroy(struct ply_grid *grid) {
    if (!grid)
        return;
    free(grid->vertex);
    free(grid->p);
    free(grid->intensity);
    free(grid->rgb);
    memset(grid, 0, sizeof *grid);
}

static enum st body_error(const struct ply_header *header, const struct number_text *body,
                          const void *data, const char *what, struct errctx *err) {
    if (header->encoding == PLY_ASCII)
        return errctx_set(err, ST_FORMAT, "line %zu: %s", body->line, what);
    return errctx_set(err, ST_FORMAT, "byte %zu: %s", (size_t)(body->at - (const char *)data),
                      what);
}

/* What a vertex property is to us. */
enum role { ROLE_X, ROLE_Y, ROLE_Z, ROLE_INTENSITY, ROLE_RED, ROLE_GREEN, ROLE_BLUE, ROLE_OTHER };

static enum role property_role(const char *name) {
    static const char *const names[] = {"x", "y", "z", "intensity", "red", "green", "blue"};
    for (int i = 0; i < ROLE_OTHER; i++)
        if (!strcmp(name, names[i]))
            return (enum role)i;
    return ROLE_OTHER;
}

static bool has_role(const struct ply_element *e, enum role role) {
    for (int i = 0; i < e->property_count; i++)
        if (!e->properties[i].is_list && property_role(e->properties[i].name) == role)
            return true;
    return false;
}

/* Skips or reads one list; *out_first is its first value, NaN if empty. */
static bool read_list(const struct ply_header *header, const struct ply_property *p,
                      struct number_text *body, double *out_count, double *out_first) {
    if (!ply_header_scalar(header, body, p->count_type, out_count) || !(*out_count >= 0.0))
        return false;
    *out_first = NAN;
    for (double i = 0; i < *out_count; i += 1.0) {
        double value = 0;
        if (!ply_header_scalar(header, body, p->type, &value))
            return false;
        if (i < 0.5)
            *out_first = value;
    }
    return true;
}

static bool read_vertex(const struct ply_header *header, const struct ply_element *e,
                        struct number_text *body, double out_values[ROLE_OTHER + 1]) {
    for (int i = 0; i < e->property_count; i++) {
        const struct ply_property *p = &e->properties[i];
        double count = 0, value = 0;
        if (p->is_list ? !read_list(header, p, body, &count, &value)
                       : !ply_header_scalar(header, body, p->type, &value))
            return false;
        out_values[p->is_list ? ROLE_OTHER : property_role(p->name)] = value;
    }
    return true;
}

static enum st read_vertices(const void *data, const struct ply_header *header,
                             const struct ply_element *e, struct number_text *body,
                             struct ply_grid *grid, struct errctx *err) {
    if (grid->p || !has_role(e, ROLE_X) || !has_role(e, ROLE_Y) || !has_role(e, ROLE_Z))
        return errctx_set(err, ST_FORMAT, "there must be one element vertex, with x, y and z");
    const size_t n = (size_t)e->count;
    grid->vertex_count = n;
    grid->p = malloc((n ? n : 1) * sizeof *grid->p);
    const bool intensity = has_role(e, ROLE_INTENSITY);
    const bool rgb = has_role(e, ROLE_RED) && has_role(e, ROLE_GREEN) && has_role(e, ROLE_BLUE);
    if (intensity)
        grid->intensity = malloc((n ? n : 1) * sizeof *grid->intensity);
    if (rgb)
        grid->rgb = malloc((n ? n : 1) * 3);
    if (!grid->p || (intensity && !grid->intensity) || (rgb && !grid->rgb))
        return errctx_set(err, ST_NOMEM, "no memory for %zu vertices", n);
    for (size_t i = 0; i < n; i++) {
        double v[ROLE_OTHER + 1] = {0};
        if (!read_vertex(header, e, body, v))
            return body_error(header, body, data, "a vertex is cut off or not a number", err);
        for (int c = ROLE_X; c <= ROLE_Z; c++)
            if (fabs(v[c]) > COORDINATE_MAX)
                return body_error(header, body, data, "a coordinate is absurdly large", err);
        grid->p[i] = vec3_make(v[ROLE_X], v[ROLE_Y], v[ROLE_Z]);
        if (intensity)
            grid->intensity[i] = (float)v[ROLE_INTENSITY];
        for (int c = 0; rgb && c < 3; c++)
            grid->rgb[3 * i + (size_t)c] = (uint8_t)fmin(255.0, fmax(0.0, v[ROLE_RED + c]));
    }
    return ST_OK;
}

static enum st read_grid(const void *data, const struct ply_header *header,
                         const struct ply_element *e, struct number_text *body,
                         struct ply_grid *grid, struct errctx *err) {
    if (grid->vertex || e->property_count != 1 || !e->properties[0].is_list)
        return errctx_set(err, ST_FORMAT, "there must be one element range_grid, of one list");
    if (header->num_rows < 1 || header->num_columns < 1 || header->num_rows > PLACES_MAX ||
        header->num_columns > PLACES_MAX || header->num_rows * header->num_columns != e->count)
        return errctx_set(
            err, ST_FORMAT,
            "%lld rows of %lld columns (obj_info) do not make %lld places of the grid",
            (long long)header->num_rows, (long long)header->num_columns, (long long)e->count);
    grid->rows = (int32_t)header->num_rows;
    grid->columns = (int32_t)header->num_columns;
    grid->vertex = malloc((size_t)e->count * sizeof *grid->vertex);
    if (!grid->vertex)
        return errctx_set(err, ST_NOMEM, "no memory for %lld places", (long long)e->count);
    for (int64_t i = 0; i < e->count; i++) {
        double count = 0, first = 0;
        if (!read_list(header, &e->properties[0], body, &count, &first) || count > 1.0)
            return body_error(header, body, data,
                              "a place of the grid is cut off or not a list of "
                              "one vertex at most",
                              err);
        if (count > 0.0 && !(first >= 0.0 && first < VERTICES_MAX && first == floor(first)))
            return body_error(header, body, data, "a place of the grid names no vertex", err);
        grid->vertex[i] = count > 0.0 ? (int32_t)first : -1;
    }
    return ST_OK;
}

static enum st skip_element(const void *data, const struct ply_header *header,
                            const struct ply_element *e, struct number_text *body,
                            struct errctx *err) {
    double values[ROLE_OTHER + 1];
    for (int64_t i = 0; i < e->count; i++)
        if (!read_vertex(header, e, body, values))
            return body_error(header, body, data, "an element is cut off or not a number", err);
    return ST_OK;
}

static enum st parse_body(const void *data, const struct ply_header *header,
                          struct number_text *body, struct ply_grid *grid, struct errctx *err) {
    for (int i = 0; i < header->element_count; i++) {
        const struct ply_element *e = &header->elements[i];
        const size_t left = (size_t)(body->end - body->at);
        /* The last ASCII number needs no blank behind it. */
        if (e->count > PLACES_MAX ||
            (size_t)e->count > (left + 1) / ply_header_least_bytes(header, e))
            return errctx_set(err, ST_FORMAT, "%lld of element %s cannot be in the %zu bytes left",
                              (long long)e->count, e->name, left);
        enum st st = ST_OK;
        if (!strcmp(e->name, "vertex"))
            st = e->count > VERTICES_MAX
                     ? errctx_set(err, ST_NOMEM, "%lld vertices are too many", (long long)e->count)
                     : read_vertices(data, header, e, body, grid, err);
        else if (!strcmp(e->name, "range_grid"))
            st = read_grid(data, header, e, body, grid, err);
        else
            st = skip_element(data, header, e, body, err);
        if (st)
            return st;
    }
    if (!grid->vertex || !grid->p)
        return errctx_set(err, ST_UNSUPPORTED, "there is no %s in it: this is no range image",
                          grid->p ? "range_grid" : "vertex");
    for (size_t i = 0; i < (size_t)grid->rows * (size_t)grid->columns; i++)
        if (grid->vertex[i] >= 0 && (size_t)grid->vertex[i] >= grid->vertex_count)
            return errctx_set(err, ST_FORMAT, "place %zu of the grid names vertex %d of %zu", i,
                              grid->vertex[i], grid->vertex_count);
    return ST_OK;
}

enum st ply_grid_parse(const void *data, size_t size, struct ply_grid *out_grid,
                       struct errctx *err) {
    struct ply_header header;
    struct number_text body;
    enum st st = ply_header_parse(data, size, &header, &body, err);
    if (st)
        return st;
    struct ply_grid grid;
    memset(&grid, 0, sizeof grid);
    st = parse_body(data, &header, &body, &grid, err);
    if (st) {
        ply_grid_destroy(&grid);
        return st;
    }
    *out_grid = grid;
    return ST_OK;
}

/* ---- to a scan ---- */

static double unit_m(const struct ply_grid_options *options) {
    return options->unit_m > 0.0 ? options->unit_m : 1.0;
}

static struct vec3 to_station(const struct mat3 *turn, double scale, struct vec3 p) {
    return vec3_scale(mat3_mulv(turn, p), scale);
}

/* Middle and extent (length of the diagonal) of the box around the samples that the grid uses. */
static size_t bounding_box(const struct ply_grid *grid, struct vec3 *out_middle,
                           double *out_extent) {
    struct vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    size_t used = 0;
    for (size_t i = 0; i < (size_t)grid->rows * (size_t)grid->columns; i++) {
        if (grid->vertex[i] < 0)
            continue;
        const struct vec3 p = grid->p[grid->vertex[i]];
        low = vec3_make(fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z));
        high = vec3_make(fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z));
        used++;
    }
    *out_middle = vec3_scale(vec3_add(low, high), 0.5);
    *out_extent = vec3_norm(vec3_sub(high, low));
    return used;
}

static void fill_scan(const struct ply_grid *grid, const struct mat3 *turn, double scale,
                      struct scan *scan) {
    float brightest = 0.0f;
    for (size_t i = 0; grid->intensity && i < grid->vertex_count; i++)
        brightest = fmaxf(brightest, grid->intensity[i]);
    for (int32_t row = 0; row < grid->rows; row++)
        for (int32_t column = 0; column < grid->columns; column++) {
            const int32_t k = grid->vertex[(size_t)row * (size_t)grid->columns + (size_t)column];
            if (k < 0)
                continue;
            struct polar_sample *s = scan->samples + scan->count++;
            const struct vec3 p = to_station(turn, scale, grid->p[k]);
            *s = sample_from_point(vec3_sub(p, scan->origin_m));
            s->row = (uint32_t)row;
            s->column = (uint32_t)column;
            if (brightest > 0.0f && grid->intensity[k] >= 0.0f) {
                s->flags |= SAMPLE_INTENSITY;
                s->intensity = grid->intensity[k] / brightest;
            }
            if (grid->rgb) {
                s->flags |= SAMPLE_COLOUR;
                memcpy(s->rgb, grid->rgb + 3 * (size_t)k, 3);
            }
        }
}

enum st ply_grid_to_scan(const struct ply_grid *grid, const struct ply_grid_options *options,
                         struct scan *out_scan, struct errctx *err) {
    struct vec3 middle, viewer = options->towards_viewer;
    double extent = 0;
    const size_t used = bounding_box(grid, &middle, &extent);
    if (used < 2 || !(extent > 0.0))
        return errctx_set(err, ST_UNSUPPORTED, "%zu samples in the grid are too few", used);
    if (vec3_norm(viewer) == 0.0)
        viewer = vec3_make(0, 0, 1);
    viewer = vec3_unit(viewer);
    if (!vec3_is_finite(viewer))
        return errctx_set(err, ST_INVALID, "the direction to the viewer is no direction");
    const double scale = unit_m(options);
    const double standoff_m =
        options->standoff_m > 0.0 ? options->standoff_m : STANDOFF_EXTENTS * extent * scale;
    const struct mat3 turn = frame_up_rotation(options->up);
    struct scan scan;
    memset(&scan, 0, sizeof scan);
    scan.samples = calloc(used, sizeof *scan.samples);
    if (!scan.samples)
        return errctx_set(err, ST_NOMEM, "no memory for %zu samples", used);
    scan.rows = grid->rows;
    scan.columns = grid->columns;
    scan.world_from_station = pose_identity();
    scan.origin_m = to_station(&turn, scale, vec3_madd(middle, viewer, standoff_m / scale));
    fill_scan(grid, &turn, scale, &scan);
    (void)snprintf(scan.meta, sizeof scan.meta,
                   "{\"grid\":\"range_grid\",\"rows\":%d,\"columns\":%d,\"unit_m\":%.9g,"
                   "\"assumed\":\"rays from a point %.4g m from the middle of the samples, towards "
                   "(%.3g %.3g %.3g) of the file\"}",
                   grid->rows, grid->columns, scale, standoff_m, viewer.x, viewer.y, viewer.z);
    *out_scan = scan;
    return ST_OK;
}

/* ---- the .conf ---- */

static enum st parse_conf_line(struct number_text *text, const char *file,
                               struct pose *out_world_from_file, bool *out_found,
                               struct errctx *err) {
    char word[64], name[256];
    if (!number_text_word(text, word, sizeof word) ||
        (strcmp(word, "bmesh") != 0 && strcmp(word, "mesh") != 0 && strcmp(word, "bpolygon") != 0))
        return ST_OK; /* a camera, a comment */
    if (!number_text_word(text, name, sizeof name))
        return errctx_set(err, ST_FORMAT, "line %zu names no file", text->line);
    if (strcmp(fileio_basename(name), fileio_basename(file)) != 0)
        return ST_OK;
    double v[7];
    for (int i = 0; i < 7; i++)
        if (!number_text_double(text, &v[i]))
            return errctx_set(err, ST_FORMAT,
                              "line %zu: x y z and a quaternion, seven numbers, are wanted",
                              text->line);
    struct mat3 r;
    if (*out_found)
        return errctx_set(err, ST_FORMAT, "line %zu names %s again", text->line, name);
    if (pose_rotation_from_quat(v[3], v[4], v[5], v[6], &r))
        return errctx_set(err, ST_FORMAT, "line %zu: the quaternion is 0", text->line);
    out_world_from_file->r = mat3_transpose(&r);
    out_world_from_file->t_m = vec3_make(v[0], v[1], v[2]);
    *out_found = true;
    return ST_OK;
}

enum st ply_grid_conf_pose(const void *data, size_t size, const char *file,
                           struct pose *out_world_from_file, struct errctx *err) {
    struct number_text text = number_text_start(data, size);
    struct pose pose = pose_identity();
    bool found = false;
    while (!number_text_at_end(&text)) {
        enum st st = parse_conf_line(&text, file, &pose, &found, err);
        if (st)
            return st;
        number_text_next_line(&text);
    }
    if (!found)
        return errctx_set(err, ST_NOT_FOUND, "no line of it names %s", fileio_basename(file));
    *out_world_from_file = pose;
    return ST_OK;
}

struct pose ply_grid_station_pose(const struct pose *world_from_file,
                                  const struct ply_grid_options *options) {
    const struct mat3 turn = frame_up_rotation(options->up), back = mat3_transpose(&turn);
    const struct mat3 half = mat3_mul(&turn, &world_from_file->r);
    const struct pose pose = {mat3_mul(&half, &back),
                              to_station(&turn, unit_m(options), world_from_file->t_m)};
    return pose;
}
