#include "render/gles/gl_api.h"

#include <string.h>

static void (*look_up(void (*(*find)(const char *))(void), const char *name))(void) {
    return find(name);
}

enum st gl_api_load(void (*(*find)(const char *name))(void), struct gl_api *out_api,
                    struct errctx *err) {
    struct gl_api api;
    memset(&api, 0, sizeof api);
    const char *missing = NULL;
#define GL_API_FIND(type, name, needed)                                                            \
    api.name = (type)look_up(find, "gl" #name);                                                    \
    if (!api.name && (needed))                                                                     \
        missing = "gl" #name;
    GL_API_LIST(GL_API_FIND)
#undef GL_API_FIND
    if (missing)
        return errctx_set(err, ST_UNSUPPORTED, "this OpenGL ES has no %s", missing);
    *out_api = api;
    return ST_OK;
}
