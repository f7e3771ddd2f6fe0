/* The part of a 3D photograph that is not pixels, as JSON: camera, pose, unit, name. */
#ifndef SC_SITE_PHOTO_JSON_H
#define SC_SITE_PHOTO_JSON_H

#include "base/photo.h"
#include "base/st.h"
#include "site/photo_tiff.h"

/* One line of JSON, malloc'ed (free() it); numbers with 17 significant digits. NULL: out of memory.
 */
char *photo_json_print(const struct photo *photo, const struct photo_tiff_info *info);

/* Sets camera and pose of *out_photo and *out_info. ST_FORMAT names the missing or bad member;
 * values are finite numbers, not yet checked for sense. Text longer than 64 KiB is refused. */
ST_MUST_CHECK enum st photo_json_parse(const char *text, struct photo *out_photo,
                                       struct photo_tiff_info *out_info, struct errctx *err);

#endif
