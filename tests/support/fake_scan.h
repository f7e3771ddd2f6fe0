/* One scan of the small simulated cart into a site as `scancart capture --resume` would do it:
 * makes the site and the station where they are missing, goes on where a scan was cut short. */
#ifndef SC_TESTS_FAKE_SCAN_H
#define SC_TESTS_FAKE_SCAN_H

#include "base/st.h"
#include "capture/resume.h"
#include "capture/scan_plan.h"
#include "capture/session.h"
#include "tests/support/fake_cart.h"

#include <stdbool.h>

/* A preview of `degrees` with two photographs. */
struct scan_plan fake_scan_plan(double degrees);

/* ST_OK: the station is complete now. *out_result may be all zero (nothing was left to do). */
enum st fake_scan_run(const char *path, const struct scan_plan *plan,
                      const struct fake_cart_spec *spec, struct session_result *out_result,
                      struct errctx *err);

/* What the site has got; false: no site, no station or no plan yet. */
bool fake_scan_state(const char *path, struct resume *out_resume);

/* Packets in the newest head stream; 0 if there is none. */
int64_t fake_scan_packets(const char *path);

#endif
