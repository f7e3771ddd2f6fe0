#include "render/gles/egl_context.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <dlfcn.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* What is taken from libEGL. */
struct egl_api {
    PFNEGLGETPROCADDRESSPROC get_proc;
    PFNEGLQUERYSTRINGPROC query_string;
    PFNEGLGETDISPLAYPROC get_display;
    PFNEGLINITIALIZEPROC initialize;
    PFNEGLTERMINATEPROC terminate;
    PFNEGLCHOOSECONFIGPROC choose_config;
    PFNEGLBINDAPIPROC bind_api;
    PFNEGLCREATECONTEXTPROC create_context;
    PFNEGLDESTROYCONTEXTPROC destroy_context;
    PFNEGLMAKECURRENTPROC make_current;
};

struct egl_context {
    void *library;
    struct egl_api egl;
    EGLDisplay display;
    EGLContext context;
    struct gl_api gl;
};

static enum st load_library(struct egl_context *c, struct errctx *err) {
    if (getenv("SCANCART_NO_GL"))
        return errctx_set(err, ST_UNSUPPORTED, "OpenGL is switched off by SCANCART_NO_GL");
    c->library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (!c->library)
        return errctx_set(err, ST_UNSUPPORTED, "there is no EGL on this machine (%s)", dlerror());
    union {
        void *data;
        PFNEGLGETPROCADDRESSPROC function;
    } find = {.data = dlsym(c->library, "eglGetProcAddress")};
    c->egl.get_proc = find.function;
    if (!c->egl.get_proc)
        return errctx_set(err, ST_UNSUPPORTED, "libEGL has no eglGetProcAddress");
    struct egl_api *e = &c->egl;
    e->query_string = (PFNEGLQUERYSTRINGPROC)e->get_proc("eglQueryString");
    e->get_display = (PFNEGLGETDISPLAYPROC)e->get_proc("eglGetDisplay");
    e->initialize = (PFNEGLINITIALIZEPROC)e->get_proc("eglInitialize");
    e->terminate = (PFNEGLTERMINATEPROC)e->get_proc("eglTerminate");
    e->choose_config = (PFNEGLCHOOSECONFIGPROC)e->get_proc("eglChooseConfig");
    e->bind_api = (PFNEGLBINDAPIPROC)e->get_proc("eglBindAPI");
    e->create_context = (PFNEGLCREATECONTEXTPROC)e->get_proc("eglCreateContext");
    e->destroy_context = (PFNEGLDESTROYCONTEXTPROC)e->get_proc("eglDestroyContext");
    e->make_current = (PFNEGLMAKECURRENTPROC)e->get_proc("eglMakeCurrent");
    bool all = e->query_string && e->get_display && e->initialize && e->terminate &&
               e->choose_config && e->bind_api && e->create_context && e->destroy_context &&
               e->make_current;
    return all ? ST_OK : errctx_set(err, ST_UNSUPPORTED, "this EGL is older than version 1.5");
}

static bool try_display(struct egl_context *c, EGLDisplay display, int minor) {
    EGLint major_version = 0, minor_version = 0, configs = 0;
    if (display == EGL_NO_DISPLAY || !c->egl.initialize(display, &major_version, &minor_version))
        return false;
    const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_ES3_BIT, EGL_SURFACE_TYPE, 0,
                             EGL_NONE};
    const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, minor,
                              EGL_NONE};
    EGLConfig config = NULL;
    EGLContext context = EGL_NO_CONTEXT;
    if (c->egl.bind_api(EGL_OPENGL_ES_API) &&
        c->egl.choose_config(display, wanted, &config, 1, &configs) && configs > 0)
        context = c->egl.create_context(display, config, EGL_NO_CONTEXT, version);
    if (context != EGL_NO_CONTEXT &&
        c->egl.make_current(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
        c->display = display;
        c->context = context;
        return true;
    }
    if (context != EGL_NO_CONTEXT)
        (void)c->egl.destroy_context(display, context);
    return false;
}

/* A GPU without a screen first; Mesa's surfaceless platform has the software renderer, too. */
static bool find_display(struct egl_context *c, int minor) {
    enum { DEVICES_MAX = 8 };
    PFNEGLGETPLATFORMDISPLAYEXTPROC platform =
        (PFNEGLGETPLATFORMDISPLAYEXTPROC)c->egl.get_proc("eglGetPlatformDisplayEXT");
    PFNEGLQUERYDEVICESEXTPROC devices =
        (PFNEGLQUERYDEVICESEXTPROC)c->egl.get_proc("eglQueryDevicesEXT");
    const char *extensions = c->egl.query_string(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    extensions = extensions ? extensions : "";
    EGLDeviceEXT device[DEVICES_MAX];
    EGLint count = 0;
    bool can_device = platform && devices && strstr(extensions, "EGL_EXT_platform_device");
    if (can_device && devices(DEVICES_MAX, device, &count))
        for (EGLint i = 0; i < count; i++)
            if (try_display(c, platform(EGL_PLATFORM_DEVICE_EXT, device[i], NULL), minor))
                return true;
    if (platform && strstr(extensions, "EGL_MESA_platform_surfaceless") &&
        try_display(c, platform(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL), minor))
        return true;
    return try_display(c, c->egl.get_display(EGL_DEFAULT_DISPLAY), minor);
}

enum st egl_context_open(int minor, struct egl_context **out_context, struct errctx *err) {
    struct egl_context *c = calloc(1, sizeof *c);
    if (!c)
        return errctx_set(err, ST_NOMEM, "no memory for a GL context");
    enum st st = load_library(c, err);
    if (!st && !find_display(c, minor))
        st = errctx_set(err, ST_UNSUPPORTED,
                        "no display or GPU here gives OpenGL ES 3.%d without a window", minor);
    if (!st)
        st = gl_api_load(c->egl.get_proc, &c->gl, err);
    if (st) {
        egl_context_close(c);
        return st;
    }
    *out_context = c;
    return ST_OK;
}

void egl_context_close(struct egl_context *context) {
    if (!context)
        return;
    if (context->context) {
        (void)context->egl.make_current(context->display, EGL_NO_SURFACE, EGL_NO_SURFACE,
                                        EGL_NO_CONTEXT);
        (void)context->egl.destroy_context(context->display, context->context);
    }
    /* Displays are shared by the process and the library keeps threads: neither is given back. */
    free(context);
}

enum st egl_context_use(struct egl_context *c, struct errctx *err) {
    if (c->egl.make_current(c->display, EGL_NO_SURFACE, EGL_NO_SURFACE, c->context))
        return ST_OK;
    return errctx_set(err, ST_DEVICE, "the OpenGL context was lost");
}

const struct gl_api *egl_context_gl(const struct egl_context *context) {
    return &context->gl;
}
