/* The recorded bytes of a head, in pieces as large as a transfer. */
#include "base/head_packet.h"
#include "capture/backends/replay.h"

#include <stdlib.h>
#include <string.h>

enum { PIECE_BYTES = 16384, GRACE_NS = 10000000 };

struct head_replay {
    struct head head;
    struct replay *replay;
    struct replay_reader reader;
    struct head_identity identity;
    struct head_stats stats;
    bool running;
};

static struct head_replay *of(struct head *head) {
    return (struct head_replay *)head;
}

static enum st replay_identify(struct head *head, struct head_identity *out_identity,
                               struct errctx *err) {
    (void)err;
    *out_identity = of(head)->identity;
    return ST_OK;
}

static enum st replay_start(struct head *head, struct errctx *err) {
    struct head_replay *h = of(head);
    (void)err;
    replay_skip_to(h->replay, h->replay->head_first_ns - GRACE_NS);
    h->running = true;
    return ST_OK;
}

/* Hands over what has come until `until_ns`. */
static enum st hand_over(struct head_replay *h, int64_t until_ns, const struct head_sink *sink,
                         struct errctx *err) {
    for (;;) {
        const uint8_t *bytes = NULL;
        size_t size = 0;
        int64_t t_ns = 0;
        enum st st = replay_reader_peek(&h->reader, PIECE_BYTES, &bytes, &size, &t_ns, err);
        if (st || t_ns > until_ns)
            return st == ST_NOT_FOUND ? ST_OK : st;
        h->stats.transfers++;
        h->stats.bytes += size;
        if (sink)
            sink->bytes(sink->ctx, bytes, size, t_ns);
        replay_reader_take(&h->reader, size);
    }
}

static enum st replay_pump(struct head *head, unsigned timeout_ms, const struct head_sink *sink,
                           struct errctx *err) {
    struct head_replay *h = of(head);
    const uint8_t *bytes;
    size_t size;
    int64_t next_ns = 0, now_ns = replay_now_ns(h->replay);
    int64_t end_ns = now_ns + (int64_t)timeout_ms * 1000000;
    if (!h->running)
        return errctx_set(err, ST_INVALID, "the head does not run");
    enum st st = replay_reader_peek(&h->reader, PIECE_BYTES, &bytes, &size, &next_ns, err);
    if (st == ST_NOT_FOUND)
        next_ns = end_ns;
    else if (st)
        return st;
    if (timeout_ms && next_ns > now_ns)
        replay_wait_until(h->replay, next_ns < end_ns ? next_ns : end_ns);
    st = hand_over(h, replay_now_ns(h->replay), sink, err);
    bool over = h->reader.ended &&
                replay_now_ns(h->replay) > h->replay->head_last_ns + 100 * (int64_t)GRACE_NS * 10;
    return !st && over ? errctx_set(err, ST_CANCELLED, "the recording of the head has ended") : st;
}

/* What is left of the recording was under way when the head was stopped. */
static enum st replay_stop(struct head *head, const struct head_sink *sink, struct errctx *err) {
    struct head_replay *h = of(head);
    if (!h->running)
        return ST_OK;
    h->running = false;
    return hand_over(h, INT64_MAX, sink, err);
}

static void replay_stats(const struct head *head, struct head_stats *out_stats) {
    *out_stats = ((const struct head_replay *)head)->stats;
}

static void close_head(struct head *head) {
    struct head_replay *h = of(head);
    replay_reader_close(&h->reader);
    free(h);
}

static const struct head_ops replay_ops = {.identify = replay_identify,
                                           .start = replay_start,
                                           .pump = replay_pump,
                                           .stop = replay_stop,
                                           .stats = replay_stats,
                                           .close = close_head};

enum st head_replay_open(struct replay *replay, struct head **out_head, struct errctx *err) {
    struct head_replay *h = calloc(1, sizeof *h);
    if (!h)
        return errctx_set(err, ST_NOMEM, "no memory for a recording");
    h->head.ops = &replay_ops;
    h->replay = replay;
    h->identity =
        (struct head_identity){.product = "recording", .protocol_version = HEAD_PACKET_VERSION};
    enum st st = replay_reader_open(&h->reader, replay, "head", "head_packet.1", err);
    const uint8_t *bytes = NULL;
    size_t size = 0;
    int64_t t_ns;
    if (!st) /* the first packet tells the interval; an empty stream has none */
        st = replay_reader_peek(&h->reader, PIECE_BYTES, &bytes, &size, &t_ns, err);
    if (st == ST_NOT_FOUND)
        st = ST_OK;
    struct head_packet packet;
    struct head_stream_stats stats;
    size_t offset = 0;
    memset(&stats, 0, sizeof stats);
    if (!st && bytes && !head_stream_next(bytes, size, &offset, &packet, &stats))
        h->identity.interval_ns = packet.interval_ns;
    if (st)
        close_head(&h->head);
    else
        *out_head = &h->head;
    return st;
}
