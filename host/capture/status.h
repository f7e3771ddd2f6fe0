/* The state of a running scan as one line for people. */
#ifndef SC_CAPTURE_STATUS_H
#define SC_CAPTURE_STATUS_H

#include "capture/session.h"

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { STATUS_LINE_MAX = 240 };

/* "sweep 41 % pan -16.2 | 5.33 M samples, 0 lost | mirror 4.00 Hz, laser on | 12.1 MB, 210 GB free
 * | 8 min 20 s left". Returns out_line. */
const char *status_line(const struct session_status *status, char out_line[STATUS_LINE_MAX]);

/* "1.24 M", "12 k", "937": a count with three digits. */
const char *status_count(uint64_t count, char *out_text, size_t size);

#ifdef __cplusplus
}
#endif
#endif
