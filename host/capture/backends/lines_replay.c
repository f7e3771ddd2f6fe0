/* The recorded edges of the lines. */
#include "capture/backends/replay.h"

#include <stdlib.h>

struct lines_replay {
    struct lines lines;
    struct replay *replay;
    struct replay_reader reader;
    struct lines_levels levels;
    struct lines_stats stats;
};

static struct lines_replay *of(struct lines *lines) {
    return (struct lines_replay *)lines;
}

static enum st replay_levels(struct lines *lines, struct lines_levels *out_levels,
                             struct errctx *err) {
    (void)err;
    *out_levels = of(lines)->levels;
    return ST_OK;
}

/* The next edge without taking it; ST_NOT_FOUND at the end. Its own time counts, not the chunk's.
 */
static enum st peek(struct lines_replay *l, struct edge_record *out_edge, struct errctx *err) {
    const uint8_t *bytes;
    size_t size;
    int64_t t_ns;
    enum st st = replay_reader_peek(&l->reader, EDGE_RECORD_BYTES, &bytes, &size, &t_ns, err);
    if (st)
        return st;
    if (size < EDGE_RECORD_BYTES)
        return errctx_set(err, ST_DAMAGED, "recording: a line's edge is cut");
    *out_edge = edge_record_decode(bytes);
    return ST_OK;
}

static void hand_over(struct lines_replay *l, const struct edge_record *edge,
                      const struct lines_sink *sink) {
    replay_reader_take(&l->reader, EDGE_RECORD_BYTES);
    if (edge->line >= LINES_COUNT)
        return;
    unsigned bit = 1u << edge->line;
    l->levels.wired = (uint8_t)(l->levels.wired | bit);
    l->levels.high = (uint8_t)(edge->rising ? l->levels.high | bit : l->levels.high & ~bit);
    l->stats.edges[edge->line]++;
    sink->edge(sink->ctx, edge);
}

static enum st replay_pump(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                           struct errctx *err) {
    struct lines_replay *l = of(lines);
    struct edge_record edge;
    int64_t end_ns = replay_now_ns(l->replay) + (int64_t)timeout_ms * 1000000;
    enum st st = peek(l, &edge, err);
    if (timeout_ms) {
        bool soon = !st && edge.t_ns < end_ns;
        if (!soon || edge.t_ns > replay_now_ns(l->replay))
            replay_wait_until(l->replay, soon ? edge.t_ns : end_ns);
    }
    while (!st && edge.t_ns <= replay_now_ns(l->replay)) {
        hand_over(l, &edge, sink);
        st = peek(l, &edge, err);
    }
    return st == ST_NOT_FOUND ? ST_OK : st;
}

static void replay_stats(const struct lines *lines, struct lines_stats *out_stats) {
    *out_stats = ((const struct lines_replay *)lines)->stats;
}

static void close_lines(struct lines *lines) {
    struct lines_replay *l = of(lines);
    replay_reader_close(&l->reader);
    free(l);
}

static const struct lines_ops replay_ops = {
    .levels = replay_levels, .pump = replay_pump, .stats = replay_stats, .close = close_lines};

enum st lines_replay_open(struct replay *replay, struct lines **out_lines, struct errctx *err) {
    struct lines_replay *l = calloc(1, sizeof *l);
    if (!l)
        return errctx_set(err, ST_NOMEM, "no memory for a recording");
    l->lines.ops = &replay_ops;
    l->replay = replay;
    /* levels before the first edge are not recorded: a scan began with closed chains */
    l->levels.wired =
        1u << EDGE_RECORD_INDEX | 1u << EDGE_RECORD_ESTOP | 1u << EDGE_RECORD_INTERLOCK;
    l->levels.high = 1u << EDGE_RECORD_ESTOP | 1u << EDGE_RECORD_INTERLOCK;
    enum st st = replay_reader_open(&l->reader, replay, "gpio", "gpio_edge.1", err);
    if (st)
        close_lines(&l->lines);
    else
        *out_lines = &l->lines;
    return st;
}
