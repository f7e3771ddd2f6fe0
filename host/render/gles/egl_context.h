/* A GLES context without a window or a screen. libEGL is loaded at run time. */
#ifndef SC_RENDER_GLES_EGL_CONTEXT_H
#define SC_RENDER_GLES_EGL_CONTEXT_H

#include "base/st.h"
#include "render/gles/gl_api.h"

#ifdef __cplusplus
extern "C" {
#endif

struct egl_context; /* belongs to the thread that opened it */

/* Opens a context of at least GLES 3.`minor` and makes it current: on the first of a device
 * (EGL_EXT_platform_device), Mesa's surfaceless platform, the default display that gives one.
 * ST_UNSUPPORTED with one line: no libEGL, no display, GLES 2 only. $SCANCART_NO_GL set to anything
 * makes it fail: to see what a machine without GL would do. */
ST_MUST_CHECK enum st egl_context_open(int minor, struct egl_context **out_context,
                                       struct errctx *err);
void egl_context_close(struct egl_context *context); /* takes NULL */

/* Makes it the thread's context again, after another one was; ST_DEVICE if it was lost. */
ST_MUST_CHECK enum st egl_context_use(struct egl_context *context, struct errctx *err);

const struct gl_api *egl_context_gl(const struct egl_context *context);

#ifdef __cplusplus
}
#endif
#endif
