#include "base/log.h"

#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>

/* Level up to which messages pass; below LOG_ERROR: none. */
static atomic_int pass_level = -1;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static log_sink_fn *current_sink; /* under lock */
static void *current_context;     /* under lock */

void log_set_sink(log_sink_fn *sink, void *context, enum log_level level) {
    (void)pthread_mutex_lock(&lock);
    current_sink = sink;
    current_context = context;
    atomic_store(&pass_level, sink ? (int)level : -1);
    (void)pthread_mutex_unlock(&lock);
}

bool log_enabled(enum log_level level) {
    return (int)level <= atomic_load_explicit(&pass_level, memory_order_relaxed);
}

const char *log_level_name(enum log_level level) {
    static const char *const names[] = {"error", "warning", "info", "debug"};
    return (unsigned)level <= LOG_DEBUG ? names[level] : "unknown";
}

void log_write(enum log_level level, const char *fmt, ...) {
    if (!log_enabled(level))
        return;
    char text[1024];
    va_list args;
    va_start(args, fmt);
    (void)vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    (void)pthread_mutex_lock(&lock);
    if (current_sink)
        current_sink(current_context, level, text);
    (void)pthread_mutex_unlock(&lock);
}
