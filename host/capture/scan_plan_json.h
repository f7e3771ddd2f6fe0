/* A scan plan as JSON: kept with a station's first head stream, so that a scan that was cut short
 * can be gone on with exactly as it was meant. */
#ifndef SC_CAPTURE_SCAN_PLAN_JSON_H
#define SC_CAPTURE_SCAN_PLAN_JSON_H

#include "base/st.h"
#include "capture/scan_plan.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One object, without a newline. Passes are told by tilt and number of photographs, which must be
 * evenly spaced (scan_plan_set_passes() makes them so). ST_NOMEM if it does not fit. */
ST_MUST_CHECK enum st scan_plan_json_write(const struct scan_plan *plan, char *out_text,
                                           size_t size);

/* Reads what the other wrote, also as the member "plan" of a larger object. ST_FORMAT. */
ST_MUST_CHECK enum st scan_plan_json_read(const char *text, struct scan_plan *out_plan,
                                          struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
