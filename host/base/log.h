/* Log: messages of library code for whoever runs the program. Nothing is printed until the program
 * sets a sink. Results and failures do not go here: they are return values. Never from the
 * real-time path, which counts instead. */
#ifndef SC_BASE_LOG_H
#define SC_BASE_LOG_H

#include "base/st.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

enum log_level { LOG_ERROR, LOG_WARN, LOG_INFO, LOG_DEBUG };

/* Gets one message without a newline, at most 1023 bytes. Called under the log's lock: one at a
 * time, from any thread; it must not log. */
typedef void log_sink_fn(void *context, enum log_level level, const char *text);

/* Messages up to `level` go to `sink`; NULL stops them. Call before threads start or at any time.
 */
void log_set_sink(log_sink_fn *sink, void *context, enum log_level level);

/* True if a message of that level goes anywhere: for messages that cost something to make. */
bool log_enabled(enum log_level level);

/* "error", "warning", "info", "debug" */
const char *log_level_name(enum log_level level);

/* printf style; costs one atomic read if nobody listens. */
void log_write(enum log_level level, const char *fmt, ...) ST_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
