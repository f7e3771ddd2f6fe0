/* What `scancart capture` says: the plan before, warnings, the report after. */
#ifndef SC_APP_CMD_CAPTURE_TEXT_H
#define SC_APP_CMD_CAPTURE_TEXT_H

#include "base/st.h"
#include "capture/scan_plan.h"
#include "capture/session.h"
#include "site/site.h"
#include "site/station.h"

#include <stdbool.h>

/* Time, samples, bytes, on stderr. covered: of a scan that is resumed, else NaN. */
void cmd_capture_text_plan(const char *path, const char *station, const struct scan_plan *plan,
                           const struct scan_plan_forecast *forecast, double covered);

/* One line each, on stderr: no real-time priority; the newest of the scan's warnings. */
void cmd_capture_text_warnings(const struct session_result *result);

/* The report of the station as text or JSON on stdout, and as a custody event in the site. */
ST_MUST_CHECK enum st cmd_capture_text_report(struct site *site, const char *path,
                                              const struct station *station,
                                              const struct session_result *result, enum st ended,
                                              bool json, struct errctx *err);

#endif
