/* Progress bar with the remaining time. The program makes one and hands it down; library code only
 * counts. It draws on a terminal alone: into a file or a pipe nothing is written. */
#ifndef SC_BASE_PROGRESS_H
#define SC_BASE_PROGRESS_H

#include "base/atomic.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

struct progress {
    /* set by init, then constant */
    FILE *out; /* NULL: silent */
    const char *label, *unit;
    int64_t total, start_ns;
    /* any thread */
    SC_ATOMIC(int64_t) done;
    SC_ATOMIC(int64_t) next_draw_ns;
    SC_ATOMIC(bool) drawing;
};

/* A bar for `total` things (`unit`, e.g. "tiles"; total <= 0: unknown, no remaining time). Silent
 * unless `out` is a terminal that can redraw a line. The strings must outlive the bar. */
void progress_init(struct progress *progress, FILE *out, const char *label, int64_t total,
                   const char *unit);

/* Counts n more things as done and draws at most ten times a second. From any thread, never waits
 * for another; NULL is silent, so that callers need not ask. 50 ns when not drawing: call it per
 * tile or chunk, not per sample. Not for the real-time path. */
void progress_add(struct progress *progress, int64_t n);

/* Draws the last state and ends the line (or wipes the line with keep = false). */
void progress_fini(struct progress *progress, bool keep);

/* The text of the bar (without control characters, at most 79 columns) after elapsed_ns. */
void progress_text(const struct progress *progress, int64_t done, int64_t elapsed_ns,
                   char *out_text, size_t size);

#ifdef __cplusplus
}
#endif
#endif
