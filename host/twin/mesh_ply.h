/* The PLY side of mesh_load.h. */
#ifndef SC_TWIN_MESH_PLY_H
#define SC_TWIN_MESH_PLY_H

#include "base/st.h"
#include "twin/mesh.h"

/* Parses text[0..size), followed by a readable 0, into an empty mesh. */
ST_MUST_CHECK enum st mesh_ply(const char *text, size_t size, const char *name, struct mesh *mesh,
                               struct errctx *err);

#endif
