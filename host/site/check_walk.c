#include "site/check_walk.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* Keeps what may come from a damaged file from steering a terminal. */
static void make_printable(char *text) {
    for (; *text; text++)
        if ((uint8_t)*text < ' ' || *text == 0x7f)
            *text = '?';
}

static void report(struct check_walk *walk, enum site_check_severity severity, const char *where,
                   const char *format, va_list args) {
    struct site_check_finding finding = {.severity = severity};
    (void)snprintf(finding.where, sizeof finding.where, "%s", where);
    (void)vsnprintf(finding.what, sizeof finding.what, format, args);
    make_printable(finding.where);
    make_printable(finding.what);
    bool is_error = severity == SITE_CHECK_ERROR;
    if (walk->result.errors == 0 && (is_error || walk->result.warnings == 0))
        walk->result.first = finding;
    if (is_error)
        walk->result.errors++;
    else
        walk->result.warnings++;
    if (walk->options && walk->options->on_finding)
        walk->options->on_finding(walk->options->context, &finding);
}

void check_walk_error(struct check_walk *walk, const char *where, const char *format, ...) {
    va_list args;
    va_start(args, format);
    report(walk, SITE_CHECK_ERROR, where, format, args);
    va_end(args);
}

void check_walk_warning(struct check_walk *walk, const char *where, const char *format, ...) {
    va_list args;
    va_start(args, format);
    report(walk, SITE_CHECK_WARNING, where, format, args);
    va_end(args);
}

void check_walk_row(struct check_walk *walk, enum store_table table, int64_t id, const char *format,
                    ...) {
    char where[128];
    (void)snprintf(where, sizeof where, "site.db: table %s, row %lld", store_table_name(table),
                   (long long)id);
    va_list args;
    va_start(args, format);
    report(walk, SITE_CHECK_ERROR, where, format, args);
    va_end(args);
}

enum st check_walk_progress(struct check_walk *walk, int64_t bytes) {
    walk->done_bytes += bytes;
    if (walk->result.errors >= walk->max_errors)
        return ST_FULL;
    if (walk->options && walk->options->on_progress &&
        !walk->options->on_progress(walk->options->context, walk->done_bytes, walk->total_bytes))
        return ST_CANCELLED;
    return ST_OK;
}
