/* A mesh file may hold anything: the parsers must neither read beyond it nor give a mesh whose
 * triangles name vertices that are not there. */
#include "twin/mesh_load.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct mesh mesh = {.st = ST_OK};
    struct errctx err = {0};
    if (mesh_load_bytes(data, size, "fuzz", &mesh, &err)) {
        if (mesh.position_m || !err.text[0])
            abort();
        return 0;
    }
    for (size_t i = 0; i < 3 * mesh.triangle_count; i++)
        if (mesh.corner[i] >= mesh.vertex_count)
            abort();
    mesh_fini(&mesh);
    return 0;
}
