/* The slow lines that the host watches: mirror index, camera strobe, e-stop and interlock chains.
 * Backends: lines_gpiod (libgpiod 1.x or 2.x), lines_replay (a recording), the twin's.
 *
 * Threads: one thread at a time. pump() neither allocates, locks, formats nor touches files unless
 * it fails. Statuses as in device/head.h. */
#ifndef SC_DEVICE_LINES_H
#define SC_DEVICE_LINES_H

#include "base/edge_record.h"
#include "base/st.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { LINES_COUNT = 4 }; /* enum edge_record_line */

struct lines_levels {
    uint8_t wired; /* bit n: line n (enum edge_record_line) is there */
    uint8_t high;  /* bit n: line n is high; chains are high when closed */
};

struct lines_stats {
    uint64_t edges[LINES_COUNT];
    uint64_t lost; /* edges that the system dropped, as far as it tells (0 with libgpiod 1.x) */
};

/* Takes one edge; t_ns in the host time, stamped where the edge was caught (in the kernel's
 * interrupt). Edges of one line come in order. Must be safe on the real-time path. */
struct lines_sink {
    void *ctx;
    void (*edge)(void *ctx, const struct edge_record *edge);
};

struct lines;

struct lines_ops {
    /* Required. Levels now. */
    enum st (*levels)(struct lines *lines, struct lines_levels *out_levels, struct errctx *err);
    /* Required. Hands over all edges since the last call; waits at most timeout_ms for the first.
     */
    enum st (*pump)(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                    struct errctx *err);
    /* Required. */
    void (*stats)(const struct lines *lines, struct lines_stats *out_stats);
    /* Required. */
    void (*close)(struct lines *lines);
};

struct lines {
    const struct lines_ops *ops;
};

/* Calls close; takes NULL. */
static inline void lines_close(struct lines *lines) {
    if (lines)
        lines->ops->close(lines);
}

#ifdef __cplusplus
}
#endif
#endif
