/* Triangle meshes from files: OBJ (Wavefront), PLY (ASCII, binary little and big endian). Bounded
 * parsers that trust nothing; only shape is read. Polygons become fans. */
#ifndef SC_TWIN_MESH_LOAD_H
#define SC_TWIN_MESH_LOAD_H

#include "base/st.h"
#include "twin/mesh.h"

/* Largest file. */
#define MESH_LOAD_MAX_BYTES ((size_t)4 << 30)

/* Reads a file into an empty mesh; all triangles are of part 0. The kind is told by the content
 * ("ply" first, else OBJ). ST_FORMAT, ST_INVALID (coordinates that are not finite, no triangle),
 * ST_NOMEM, ST_NOT_FOUND, ST_IO: one line with file and line or element. On failure the mesh is
 * empty. About 0.3 us a triangle (binary) to 1 us (text). */
ST_MUST_CHECK enum st mesh_load(const char *path, struct mesh *out_mesh, struct errctx *err);

/* The same from memory; `name` is for messages. */
ST_MUST_CHECK enum st mesh_load_bytes(const void *bytes, size_t size, const char *name,
                                      struct mesh *out_mesh, struct errctx *err);

#endif
