/* Conventions of all shaders. Row y of the picture is row y of the framebuffer: what GL calls up is
 * down, and nothing has to be turned over when the picture is read. A sample without disparity has
 * -1 in the texture. Depths are larger for what is nearer, cleared to 0, and scaled by a power of
 * two so that what is a millimetre away still fits 0..1. Meta texture: red bit 0 the cell is a
 * skin, bit 1 one of the cell's corners is a guess, bit 2 the sample is shown, bit 3 the skin is
 * disproved; green: which corners of the cell are shown (low half) and which are there at all (high
 * half). */
#include "render/gles/gles_shaders.h"

#define VERSION_30 "#version 300 es\n"
#define VERSION_31 "#version 310 es\n"

static const char head[] =
    "precision highp float;\nprecision highp int;\n"
    "precision highp sampler2D;\nprecision highp sampler2DArray;\n"
    "precision highp usampler2D;\nprecision highp usampler2DArray;\n"
    "struct tile_rec { vec4 x; vec4 y; vec4 d; vec4 w; ivec4 place; vec4 scale; vec4 plane; };\n"
    "uniform sampler2DArray u_disparity;\n"
    "uniform sampler2DArray u_colour;\n"
    "uniform usampler2DArray u_meta;\n"
    "uniform sampler2D u_skins;\n"
    "uniform ivec2 u_size;\n"
    "uniform vec4 u_bounds;\n" /* depth_max, radius_max_px, fall_rel, fall_abs */
    "uniform vec4 u_push;\n"   /* gain, sigma of unknown confidence, depth scale, nearest filter */
    "uniform int u_layered;\n"
    "const vec4 nowhere = vec4(2.0, 2.0, 2.0, 1.0);\n"
    "ivec4 tile_size(ivec4 place) { return ivec4(place.w, place.w >> 8, place.w >> 16, "
    "place.w >> 24) & 255; }\n"
    "float push_back(float confidence, float inv_w, float lin_px) {\n"
    "  float c = floor(confidence * 255.0 + 0.5);\n"
    "  float sigma = c > 0.0 ? 1e-6 * exp2((255.0 - c) * 0.1) : u_push.y;\n"
    "  float inv2 = inv_w * inv_w;\n"
    "  float octaves = float(floatBitsToInt(lin_px * lin_px * inv2) - 0x3f800000) / 8388608.0 "
    "+ 4.0;\n"
    "  return u_push.x * sigma * inv2 * clamp(octaves, 0.0, 12.0);\n"
    "}\n";

static const char tiles_block[] = "layout(std140) uniform Tiles { tile_rec tiles[128]; };\n";
static const char tiles_buffer[] =
    "layout(std430, binding = 2) readonly buffer Tiles { tile_rec tiles[]; };\n";

/* One sample of a tile as a disc or a point. */
static const char sample_part[] =
    "struct disc { vec2 centre; float r; float top; float fall; vec3 rgb; };\n"
    "bool disc_of(int tile, int u, int v, bool point, out disc o) {\n"
    "  ivec4 place = tiles[tile].place;\n"
    "  ivec4 size = tile_size(place);\n"
    "  if (u >= size.x || v >= size.y) return false;\n"
    "  ivec3 at = ivec3(place.x + u, place.y + v, place.z);\n"
    "  float delta = texelFetch(u_disparity, at, 0).r;\n"
    "  if (!(delta >= 0.0) || (texelFetch(u_meta, at, 0).r & 4u) == 0u) return false;\n"
    "  vec4 q = vec4(float(u), float(v), 1.0, delta);\n"
    "  float w = dot(tiles[tile].w, q);\n"
    "  if (!(w > 0.0)) return false;\n"
    "  float inv_w = 1.0 / w;\n"
    "  o.centre = vec2(dot(tiles[tile].x, q), dot(tiles[tile].y, q)) * inv_w;\n"
    "  float depth = dot(tiles[tile].d, q) * inv_w;\n"
    "  o.r = point ? 0.5 : min(max(tiles[tile].scale.x * inv_w, 0.70710678), u_bounds.y);\n"
    "  vec2 last = vec2(u_size - 1);\n"
    "  if (!(depth >= 0.0 && depth <= u_bounds.x) || any(lessThan(o.centre + o.r, vec2(0.0))) ||\n"
    "      any(greaterThan(o.centre - o.r, last))) return false;\n"
    "  vec4 colour = texelFetch(u_colour, at, 0);\n"
    "  o.rgb = colour.rgb;\n"
    "  o.top = depth;\n"
    "  o.fall = (u_bounds.z * depth + u_bounds.w) / o.r;\n"
    "  float rim = point ? 0.0 : 0.2 * o.fall * o.r * o.r;\n" /* RASTER_SPLAT_RIM */
    "  if (u_push.x > 0.0)\n"
    "    o.top = max(depth - push_back(colour.a, inv_w, tiles[tile].scale.y) - rim, 0.0);\n"
    "  return true;\n"
    "}\n";

static const char point_vertex[] =
    "flat out float v_top;\nflat out vec3 v_rgb;\n"
    "void main() {\n"
    "  int s = gl_VertexID & 1023;\n"
    "  disc o;\n"
    "  gl_PointSize = 1.0;\n"
    "  gl_Position = nowhere;\n"
    "  v_top = 0.0; v_rgb = vec3(0.0);\n"
    "  if (!disc_of(gl_VertexID >> 10, s & 31, s >> 5, true, o)) return;\n"
    "  vec2 px = floor(o.centre + 0.5);\n"
    "  if (any(lessThan(px, vec2(0.0))) || any(greaterThanEqual(px, vec2(u_size)))) return;\n"
    "  v_top = o.top; v_rgb = o.rgb;\n"
    "  gl_Position = vec4((px + 0.5) * 2.0 / vec2(u_size) - 1.0, 0.0, 1.0);\n"
    "}\n";

static const char fragment_out[] =
    "layout(location = 0) out vec4 o_rgba;\nlayout(location = 1) out uint o_depth;\n"
    "bool behind_skin(float depth) {\n"
    "  return u_layered != 0 && depth * u_push.z < texelFetch(u_skins, ivec2(gl_FragCoord.xy), "
    "0).r;\n"
    "}\n"
    "void put(float depth, vec4 rgba) {\n"
    "  if (behind_skin(depth)) discard;\n"
    "  gl_FragDepth = min(depth * u_push.z, 1.0);\n"
    "  o_rgba = rgba;\n"
    "  o_depth = floatBitsToUint(depth) + 1u;\n"
    "}\n";

static const char point_fragment[] = "flat in float v_top;\nflat in vec3 v_rgb;\n"
                                     "void main() { put(v_top, vec4(v_rgb, 1.0)); }\n";

/* The square of whole pixels around the disc; a centre outside the picture is pulled in, because GL
 * drops points whose centre is clipped. */
static const char splat_vertex[] =
    "flat out vec4 v_disc;\nflat out float v_fall;\nflat out vec3 v_rgb;\n"
    "void main() {\n"
    "  int s = gl_VertexID & 1023;\n"
    "  disc o;\n"
    "  gl_PointSize = 1.0;\n"
    "  gl_Position = nowhere;\n"
    "  v_disc = vec4(0.0); v_fall = 0.0; v_rgb = vec3(0.0);\n"
    "  if (!disc_of(gl_VertexID >> 10, s & 31, s >> 5, false, o)) return;\n"
    "  vec2 lo = max(ceil(o.centre - o.r), vec2(0.0));\n"
    "  vec2 hi = min(floor(o.centre + o.r), vec2(u_size - 1));\n"
    "  if (any(lessThan(hi, lo))) return;\n"
    "  vec2 n = hi - lo + 1.0;\n"
    "  float side = max(n.x, n.y);\n"
    "  vec2 middle = lo + 0.5 * side;\n"
    "  vec2 inside = clamp(middle, vec2(0.5), vec2(u_size) - 0.5);\n"
    "  vec2 off = abs(inside - middle);\n"
    "  v_disc = vec4(o.centre, o.r, o.top); v_fall = o.fall; v_rgb = o.rgb;\n"
    "  gl_PointSize = side + 2.0 * ceil(max(off.x, off.y));\n"
    "  gl_Position = vec4(inside * 2.0 / vec2(u_size) - 1.0, 0.0, 1.0);\n"
    "}\n";

static const char splat_fragment[] =
    "flat in vec4 v_disc;\nflat in float v_fall;\nflat in vec3 v_rgb;\n"
    "void main() {\n"
    "  vec2 d = gl_FragCoord.xy - 0.5 - v_disc.xy;\n"
    "  float s = dot(d, d);\n"
    "  if (!(s < v_disc.z * v_disc.z)) discard;\n"
    "  put(max(v_disc.w - v_fall * s, 0.0), vec4(v_rgb, 1.0));\n"
    "}\n";

/* Mesh: six vertices a cell. u_mode: 0 cells that are no skins, 1 all skins, 2 those with a guess,
 * 3 every cell as a surface. */
static const char mesh_vertex[] =
    "uniform int u_mode;\n"
    "flat out ivec4 v_place;\nflat out ivec2 v_size;\nout vec4 v_q;\n"
    "void main() {\n"
    "  int tile = gl_VertexID / 6144;\n"
    "  int rest = gl_VertexID - tile * 6144;\n"
    "  int cell = rest / 6;\n"
    "  int k = rest - cell * 6;\n"
    "  int u = cell & 31, v = cell >> 5;\n"
    "  ivec4 place = tiles[tile].place;\n"
    "  ivec4 size = tile_size(place);\n"
    "  gl_Position = nowhere;\n"
    "  v_place = place; v_size = size.zw; v_q = vec4(0.0);\n"
    "  if (u >= size.z || v >= size.w) return;\n"
    "  uvec4 meta = texelFetch(u_meta, ivec3(place.x + u, place.y + v, place.z), 0);\n"
    "  bool skin = (meta.r & 1u) != 0u;\n"
    "  if (u_mode == 0 && skin) return;\n"
    "  if ((u_mode == 1 || u_mode == 2) && (!skin || (meta.r & 8u) != 0u)) return;\n"
    "  if (u_mode == 2 && (meta.r & 2u) == 0u) return;\n"
    "  int mask = int(u_mode == 1 || u_mode == 2 ? meta.g >> 4 : meta.g & 15u);\n"
    "  int want = k < 3 ? k : (k == 3 ? 0 : k - 2);\n" /* of the fan: 0 1 2, 0 2 3 */
    "  int corner = -1, count = 0;\n"
    "  for (int i = 0; i < 4; i++)\n"
    "    if ((mask & (1 << i)) != 0) { if (count == want) corner = i; count++; }\n"
    "  if (count < 3 || (count == 3 && k >= 3)) return;\n"
    "  u += corner == 1 || corner == 2 ? 1 : 0;\n"
    "  v += corner >= 2 ? 1 : 0;\n"
    "  ivec3 at = ivec3(place.x + u, place.y + v, place.z);\n"
    "  vec4 q = vec4(float(u), float(v), 1.0, texelFetch(u_disparity, at, 0).r);\n"
    "  float x = dot(tiles[tile].x, q), y = dot(tiles[tile].y, q);\n"
    "  float d = dot(tiles[tile].d, q), w = dot(tiles[tile].w, q);\n"
    "  float push = 0.0;\n"
    "  if (u_push.x > 0.0 && w > 0.0)\n"
    "    push = push_back(texelFetch(u_colour, at, 0).a, 1.0 / w, tiles[tile].scale.y) * w;\n"
    "  v_q = vec4(q.xy, d, d - push);\n"
    "  gl_Position = vec4((2.0 * x + w) / float(u_size.x) - w, (2.0 * y + w) / float(u_size.y) - "
    "w, 0.0, w);\n"
    "}\n";

static const char texture_part[] =
    "vec3 colour_at(ivec4 place, vec2 uv) {\n"
    "  vec2 at = vec2(place.xy) + uv;\n"
    "  if (u_push.w > 0.0) return texelFetch(u_colour, ivec3(floor(at + 0.5), place.z), 0).rgb;\n"
    "  ivec2 i = ivec2(floor(at));\n"
    "  vec2 f = at - vec2(i);\n"
    "  ivec2 j = i + ivec2(greaterThan(f, vec2(0.0)));\n"
    "  vec3 a = texelFetch(u_colour, ivec3(i, place.z), 0).rgb;\n"
    "  vec3 b = texelFetch(u_colour, ivec3(j.x, i.y, place.z), 0).rgb;\n"
    "  vec3 c = texelFetch(u_colour, ivec3(i.x, j.y, place.z), 0).rgb;\n"
    "  vec3 d = texelFetch(u_colour, ivec3(j, place.z), 0).rgb;\n"
    "  return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);\n"
    "}\n";

static const char mesh_fragment[] =
    "uniform int u_mode;\nuniform vec4 u_skin;\n"
    "flat in ivec4 v_place;\nflat in ivec2 v_size;\nin vec4 v_q;\n"
    "void main() {\n"
    "  float depth = v_q.z * gl_FragCoord.w, top = max(v_q.w * gl_FragCoord.w, 0.0);\n"
    "  if (!(depth >= 0.0 && depth <= u_bounds.x)) discard;\n"
    "  if (u_mode == 1 || u_mode == 2) put(top, u_skin);\n"
    "  else put(top, vec4(colour_at(v_place, clamp(v_q.xy, vec2(0.0), vec2(v_size))), 1.0));\n"
    "}\n";

/* Plane: six vertices a tile. */
static const char plane_vertex[] =
    "flat out ivec4 v_place;\nflat out ivec2 v_size;\nflat out float v_lin;\nout vec4 v_q;\n"
    "void main() {\n"
    "  int tile = gl_VertexID / 6;\n"
    "  int k = gl_VertexID - tile * 6;\n"
    "  int corner = k < 3 ? k : (k == 3 ? 0 : k - 2);\n"
    "  ivec4 place = tiles[tile].place;\n"
    "  ivec4 size = tile_size(place);\n"
    "  v_place = place; v_size = size.zw; v_lin = tiles[tile].scale.y;\n"
    "  float u = corner == 1 || corner == 2 ? float(size.z) : 0.0;\n"
    "  float v = corner >= 2 ? float(size.w) : 0.0;\n"
    "  vec4 q = vec4(u, v, 1.0, dot(tiles[tile].plane.xyz, vec3(1.0, u, v)));\n"
    "  float x = dot(tiles[tile].x, q), y = dot(tiles[tile].y, q);\n"
    "  float d = dot(tiles[tile].d, q), w = dot(tiles[tile].w, q);\n"
    "  v_q = vec4(u, v, d, 0.0);\n"
    "  gl_Position = vec4((2.0 * x + w) / float(u_size.x) - w, (2.0 * y + w) / float(u_size.y) - "
    "w, 0.0, w);\n"
    "}\n";

static const char plane_fragment[] =
    "flat in ivec4 v_place;\nflat in ivec2 v_size;\nflat in float v_lin;\nin vec4 v_q;\n"
    "void main() {\n"
    "  float depth = v_q.z * gl_FragCoord.w, top = depth;\n"
    "  if (!(depth >= 0.0 && depth <= u_bounds.x)) discard;\n"
    "  vec2 uv = clamp(v_q.xy, vec2(0.0), vec2(v_size));\n"
    "  ivec2 cell = min(ivec2(uv), v_size - 1);\n"
    "  uvec4 meta = texelFetch(u_meta, ivec3(v_place.xy + cell, v_place.z), 0);\n"
    "  if ((meta.r & 1u) != 0u || (meta.g & 15u) != 15u) discard;\n"
    "  if (u_push.x > 0.0) {\n"
    "    ivec2 near = ivec2(floor(uv + 0.5));\n"
    "    float confidence = texelFetch(u_colour, ivec3(v_place.xy + near, v_place.z), 0).a;\n"
    "    top = max(depth - push_back(confidence, gl_FragCoord.w, v_lin), 0.0);\n"
    "  }\n"
    "  put(top, vec4(colour_at(v_place, uv), 1.0));\n"
    "}\n";

const struct gles_shaders_source gles_shaders_point = {
    {VERSION_30, head, tiles_block, sample_part, point_vertex},
    {VERSION_30, head, fragment_out, point_fragment}};
const struct gles_shaders_source gles_shaders_splat = {
    {VERSION_30, head, tiles_block, sample_part, splat_vertex},
    {VERSION_30, head, fragment_out, splat_fragment}};
const struct gles_shaders_source gles_shaders_mesh = {
    {VERSION_30, head, tiles_block, mesh_vertex},
    {VERSION_30, head, fragment_out, texture_part, mesh_fragment}};
const struct gles_shaders_source gles_shaders_plane = {
    {VERSION_30, head, tiles_block, plane_vertex},
    {VERSION_30, head, fragment_out, texture_part, plane_fragment}};

/* ---- compute ---- */

static const char compute_part[] =
    "layout(local_size_x = 64) in;\n"
    "layout(std430, binding = 0) buffer Depths { uint depths[]; };\n"
    "layout(std430, binding = 1) buffer Colours { uint colours[]; };\n"
    "uniform int u_points;\n"
    "void touch(int at, float depth, uint rgba);\n"
    "void main() {\n"
    "  int id = int(gl_GlobalInvocationID.x);\n"
    "  int s = id & 1023;\n"
    "  disc o;\n"
    "  if (!disc_of(id >> 10, s & 31, s >> 5, u_points != 0, o)) return;\n"
    "  uvec3 rgb = uvec3(o.rgb * 255.0 + 0.5);\n"
    "  uint rgba = rgb.r | rgb.g << 8 | rgb.b << 16 | 0xff000000u;\n"
    "  ivec2 lo = ivec2(floor(o.centre + 0.5)), hi = lo;\n"
    "  if (u_points == 0) {\n"
    "    lo = ivec2(max(ceil(o.centre - o.r), vec2(0.0)));\n"
    "    hi = ivec2(min(floor(o.centre + o.r), vec2(u_size - 1)));\n"
    "  } else if (any(lessThan(lo, ivec2(0))) || any(greaterThanEqual(lo, u_size))) return;\n"
    "  for (int y = lo.y; y <= hi.y; y++)\n"
    "    for (int x = lo.x; x <= hi.x; x++) {\n"
    "      float depth = o.top;\n"
    "      if (u_points == 0) {\n"
    "        vec2 d = vec2(float(x), float(y)) - o.centre;\n"
    "        float q = dot(d, d);\n"
    "        if (!(q < o.r * o.r)) continue;\n"
    "        depth = max(o.top - o.fall * q, 0.0);\n"
    "      }\n"
    "      if (u_layered != 0 && depth * u_push.z < texelFetch(u_skins, ivec2(x, y), 0).r) "
    "continue;\n"
    "      touch(y * u_size.x + x, depth, rgba);\n"
    "    }\n"
    "}\n";

/* Reading before the atomic spares most of them. */
static const char compute_depth[] = "void touch(int at, float depth, uint rgba) {\n"
                                    "  uint mine = floatBitsToUint(depth) + 1u;\n"
                                    "  if (depths[at] < mine) atomicMax(depths[at], mine);\n"
                                    "}\n";
static const char compute_colour[] =
    "void touch(int at, float depth, uint rgba) {\n"
    "  if (depths[at] == floatBitsToUint(depth) + 1u) atomicMax(colours[at], rgba);\n"
    "}\n";

const char *const gles_shaders_compute_depth[GLES_SHADERS_PARTS] = {
    VERSION_31, head, tiles_buffer, sample_part, compute_part, compute_depth};
const char *const gles_shaders_compute_colour[GLES_SHADERS_PARTS] = {
    VERSION_31, head, tiles_buffer, sample_part, compute_part, compute_colour};

const char *const gles_shaders_compute_image[GLES_SHADERS_PARTS] = {
    VERSION_31, "precision highp float;\nprecision highp int;\n"
                "layout(local_size_x = 64) in;\n"
                "layout(std430, binding = 0) buffer Depths { uint depths[]; };\n"
                "layout(std430, binding = 1) buffer Colours { uint colours[]; };\n"
                "layout(r32ui, binding = 0) writeonly uniform highp uimage2D u_depth_image;\n"
                "layout(r32ui, binding = 1) writeonly uniform highp uimage2D u_colour_image;\n"
                "uniform ivec2 u_size;\n"
                "void main() {\n"
                "  int at = int(gl_GlobalInvocationID.x + gl_GlobalInvocationID.y * "
                "gl_NumWorkGroups.x * 64u);\n"
                "  if (at >= u_size.x * u_size.y) return;\n"
                "  ivec2 px = ivec2(at % u_size.x, at / u_size.x);\n"
                "  imageStore(u_depth_image, px, uvec4(depths[at]));\n"
                "  imageStore(u_colour_image, px, uvec4(colours[at]));\n"
                "  depths[at] = 0u;\n"
                "  colours[at] = 0u;\n"
                "}\n"};

/* The images as a picture with depths, into the same framebuffer as everything else. */
const struct gles_shaders_source gles_shaders_resolve = {
    {VERSION_31, "void main() {\n"
                 "  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : "
                 "-1.0, 0.0, 1.0);\n"
                 "}\n"},
    {VERSION_31, head,
     "layout(location = 0) out vec4 o_rgba;\nlayout(location = 1) out uint o_depth;\n"
     "uniform usampler2D u_depth_image;\nuniform usampler2D u_colour_image;\n"
     "void main() {\n"
     "  ivec2 px = ivec2(gl_FragCoord.xy);\n"
     "  uint depth = texelFetch(u_depth_image, px, 0).r;\n"
     "  if (depth == 0u) discard;\n"
     "  uint c = texelFetch(u_colour_image, px, 0).r;\n"
     "  gl_FragDepth = min(uintBitsToFloat(depth - 1u) * u_push.z, 1.0);\n"
     "  o_rgba = vec4(float(c & 255u), float(c >> 8 & 255u), float(c >> 16 & 255u), 255.0) / "
     "255.0;\n"
     "  o_depth = depth;\n"
     "}\n"}};
