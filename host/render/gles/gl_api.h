/* OpenGL ES by name: the functions that the renderer calls, found at run time, so that the program
 * starts on machines that have no GL at all. */
#ifndef SC_RENDER_GLES_GL_API_H
#define SC_RENDER_GLES_GL_API_H

#include "base/st.h"

#include <GLES3/gl31.h>

#ifdef __cplusplus
extern "C" {
#endif

/* X(type of the function pointer, name without gl, needed for 3.0) */
#define GL_API_LIST(X)                                                                             \
    X(PFNGLACTIVETEXTUREPROC, ActiveTexture, 1)                                                    \
    X(PFNGLATTACHSHADERPROC, AttachShader, 1)                                                      \
    X(PFNGLBINDBUFFERPROC, BindBuffer, 1)                                                          \
    X(PFNGLBINDBUFFERBASEPROC, BindBufferBase, 1)                                                  \
    X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer, 1)                                                \
    X(PFNGLBINDRENDERBUFFERPROC, BindRenderbuffer, 1)                                              \
    X(PFNGLBINDTEXTUREPROC, BindTexture, 1)                                                        \
    X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray, 1)                                                \
    X(PFNGLBUFFERDATAPROC, BufferData, 1)                                                          \
    X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus, 1)                                  \
    X(PFNGLCLEARBUFFERFVPROC, ClearBufferfv, 1)                                                    \
    X(PFNGLCLEARBUFFERIVPROC, ClearBufferiv, 1)                                                    \
    X(PFNGLCLEARBUFFERUIVPROC, ClearBufferuiv, 1)                                                  \
    X(PFNGLCOLORMASKPROC, ColorMask, 1)                                                            \
    X(PFNGLCOMPILESHADERPROC, CompileShader, 1)                                                    \
    X(PFNGLCREATEPROGRAMPROC, CreateProgram, 1)                                                    \
    X(PFNGLCREATESHADERPROC, CreateShader, 1)                                                      \
    X(PFNGLDELETEBUFFERSPROC, DeleteBuffers, 1)                                                    \
    X(PFNGLDELETEFRAMEBUFFERSPROC, DeleteFramebuffers, 1)                                          \
    X(PFNGLDELETEPROGRAMPROC, DeleteProgram, 1)                                                    \
    X(PFNGLDELETERENDERBUFFERSPROC, DeleteRenderbuffers, 1)                                        \
    X(PFNGLDELETESHADERPROC, DeleteShader, 1)                                                      \
    X(PFNGLDELETETEXTURESPROC, DeleteTextures, 1)                                                  \
    X(PFNGLDELETEVERTEXARRAYSPROC, DeleteVertexArrays, 1)                                          \
    X(PFNGLDEPTHFUNCPROC, DepthFunc, 1)                                                            \
    X(PFNGLDEPTHMASKPROC, DepthMask, 1)                                                            \
    X(PFNGLDISABLEPROC, Disable, 1)                                                                \
    X(PFNGLDRAWARRAYSPROC, DrawArrays, 1)                                                          \
    X(PFNGLDRAWBUFFERSPROC, DrawBuffers, 1)                                                        \
    X(PFNGLENABLEPROC, Enable, 1)                                                                  \
    X(PFNGLFINISHPROC, Finish, 1)                                                                  \
    X(PFNGLFRAMEBUFFERRENDERBUFFERPROC, FramebufferRenderbuffer, 1)                                \
    X(PFNGLFRAMEBUFFERTEXTURE2DPROC, FramebufferTexture2D, 1)                                      \
    X(PFNGLGENBUFFERSPROC, GenBuffers, 1)                                                          \
    X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers, 1)                                                \
    X(PFNGLGENRENDERBUFFERSPROC, GenRenderbuffers, 1)                                              \
    X(PFNGLGENTEXTURESPROC, GenTextures, 1)                                                        \
    X(PFNGLGENVERTEXARRAYSPROC, GenVertexArrays, 1)                                                \
    X(PFNGLGETERRORPROC, GetError, 1)                                                              \
    X(PFNGLGETFLOATVPROC, GetFloatv, 1)                                                            \
    X(PFNGLGETINTEGERVPROC, GetIntegerv, 1)                                                        \
    X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog, 1)                                            \
    X(PFNGLGETPROGRAMIVPROC, GetProgramiv, 1)                                                      \
    X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog, 1)                                              \
    X(PFNGLGETSHADERIVPROC, GetShaderiv, 1)                                                        \
    X(PFNGLGETSTRINGPROC, GetString, 1)                                                            \
    X(PFNGLGETUNIFORMBLOCKINDEXPROC, GetUniformBlockIndex, 1)                                      \
    X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation, 1)                                          \
    X(PFNGLLINKPROGRAMPROC, LinkProgram, 1)                                                        \
    X(PFNGLPIXELSTOREIPROC, PixelStorei, 1)                                                        \
    X(PFNGLREADBUFFERPROC, ReadBuffer, 1)                                                          \
    X(PFNGLREADPIXELSPROC, ReadPixels, 1)                                                          \
    X(PFNGLRENDERBUFFERSTORAGEPROC, RenderbufferStorage, 1)                                        \
    X(PFNGLSHADERSOURCEPROC, ShaderSource, 1)                                                      \
    X(PFNGLSTENCILFUNCPROC, StencilFunc, 1)                                                        \
    X(PFNGLSTENCILOPPROC, StencilOp, 1)                                                            \
    X(PFNGLTEXPARAMETERIPROC, TexParameteri, 1)                                                    \
    X(PFNGLTEXSTORAGE2DPROC, TexStorage2D, 1)                                                      \
    X(PFNGLTEXSTORAGE3DPROC, TexStorage3D, 1)                                                      \
    X(PFNGLTEXSUBIMAGE3DPROC, TexSubImage3D, 1)                                                    \
    X(PFNGLUNIFORM1FPROC, Uniform1f, 1)                                                            \
    X(PFNGLUNIFORM1IPROC, Uniform1i, 1)                                                            \
    X(PFNGLUNIFORM2IPROC, Uniform2i, 1)                                                            \
    X(PFNGLUNIFORM4FPROC, Uniform4f, 1)                                                            \
    X(PFNGLUNIFORMBLOCKBINDINGPROC, UniformBlockBinding, 1)                                        \
    X(PFNGLUSEPROGRAMPROC, UseProgram, 1)                                                          \
    X(PFNGLVIEWPORTPROC, Viewport, 1)                                                              \
    X(PFNGLBINDIMAGETEXTUREPROC, BindImageTexture, 0)                                              \
    X(PFNGLDISPATCHCOMPUTEPROC, DispatchCompute, 0)                                                \
    X(PFNGLMEMORYBARRIERPROC, MemoryBarrier, 0)

struct gl_api {
#define GL_API_FIELD(type, name, needed) type name;
    GL_API_LIST(GL_API_FIELD)
#undef GL_API_FIELD
};

/* Fills the table with `find` (eglGetProcAddress or the like). ST_UNSUPPORTED names what is
 * missing; functions of 3.1 may be. */
ST_MUST_CHECK enum st gl_api_load(void (*(*find)(const char *name))(void), struct gl_api *out_api,
                                  struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
