/* The twin's slow lines behind the ops of device/lines.h. */
#include "twin/twin_world.h"

static struct twin_world_lines *lines_of(struct lines *lines) {
    return (struct twin_world_lines *)lines;
}

void twin_lines_edge(struct twin_devices *twin, const struct cart_edge *edge) {
    struct twin_world_lines *l = &twin->lines;
    bool chain = edge->line == CART_LINE_ESTOP || edge->line == CART_LINE_INTERLOCK;
    uint8_t bit = (uint8_t)(1u << edge->line);
    if (chain)
        l->high = (uint8_t)(edge->high ? l->high | bit : l->high & ~bit);
    int slot = twin_world_put(&l->queue, TWIN_WORLD_EDGES);
    if (slot < 0)
        l->stats.lost++;
    else
        l->edge[slot] = (struct edge_record){twin_world_host_ns(twin, edge->t_host_ns), edge->seq,
                                             (uint8_t)edge->line, edge->high};
}

static enum st levels(struct lines *lines, struct lines_levels *out_levels, struct errctx *err) {
    struct twin_world_lines *l = lines_of(lines);
    enum st st = twin_world_enter(l->twin, err);
    if (st)
        return st;
    *out_levels = (struct lines_levels){.wired = (1u << LINES_COUNT) - 1, .high = l->high};
    twin_world_leave(l->twin);
    return ST_OK;
}

static bool hand_over(struct twin_world_lines *l, const struct lines_sink *sink) {
    bool any = false;
    while (l->queue.taken != l->queue.put) {
        struct edge_record edge = l->edge[l->queue.taken % TWIN_WORLD_EDGES];
        if (edge.t_ns > twin_world_now_ns(l->twin))
            break; /* the host has not woken up yet */
        l->queue.taken++;
        l->stats.edges[edge.line]++;
        (void)pthread_mutex_unlock(&l->twin->lock);
        sink->edge(sink->ctx, &edge);
        (void)pthread_mutex_lock(&l->twin->lock);
        any = true;
    }
    return any;
}

static enum st pump(struct lines *lines, unsigned timeout_ms, const struct lines_sink *sink,
                    struct errctx *err) {
    struct twin_world_lines *l = lines_of(lines);
    enum st st = twin_world_enter(l->twin, err);
    if (st)
        return st;
    int64_t until_ns = twin_world_now_ns(l->twin) + (int64_t)timeout_ms * 1000000;
    for (bool over = false; !hand_over(l, sink) && !over;) {
        st = twin_world_await(l->twin, until_ns, &over, err);
        if (st)
            return st;
    }
    twin_world_leave(l->twin);
    return ST_OK;
}

static void stats(const struct lines *lines, struct lines_stats *out_stats) {
    *out_stats = ((const struct twin_world_lines *)lines)->stats;
}

static void close_lines(struct lines *lines) {
    (void)lines; /* they end with the twin */
}

static const struct lines_ops ops = {levels, pump, stats, close_lines};

void twin_lines_init(struct twin_devices *twin) {
    twin->lines.lines.ops = &ops;
    twin->lines.twin = twin;
    twin->lines.high = 1u << EDGE_RECORD_ESTOP | 1u << EDGE_RECORD_INTERLOCK; /* closed */
}
