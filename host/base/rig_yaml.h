/* Rig and camera as YAML: the text of a site's calibration records of kind "rig" and "camera", and
 * of a calibration file. Units are in the keys; numbers keep all their digits. */
#ifndef SC_BASE_RIG_YAML_H
#define SC_BASE_RIG_YAML_H

#include "base/rig.h"
#include "base/st.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Enough for either text. */
enum { RIG_YAML_MAX_BYTES = 4096 };

/* Writes the text with its final 0; ST_NOMEM if it does not fit. */
ST_MUST_CHECK enum st rig_yaml_write(const struct rig *rig, char *out_text, size_t capacity);
ST_MUST_CHECK enum st rig_yaml_write_camera(const struct rig_camera *cam, char *out_text,
                                            size_t capacity);

/* Reads it; `name` stands for the text in messages. ST_FORMAT with one line for a key that is
 * missing or unknown, a value out of bounds, axes that are not unit vectors, a rotation that is
 * none. */
ST_MUST_CHECK enum st rig_yaml_read(const char *text, size_t size, const char *name,
                                    struct rig *out_rig, struct errctx *err);
ST_MUST_CHECK enum st rig_yaml_read_camera(const char *text, size_t size, const char *name,
                                           struct rig_camera *out_cam, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
