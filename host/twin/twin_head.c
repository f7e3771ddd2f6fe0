/* The twin's rangefinder head behind the ops of device/head.h. */
#include "twin/twin_world.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* A transfer that is not full ends after this. */
static const int64_t transfer_ns = 20000000;

static struct twin_world_head *head_of(struct head *head) {
    return (struct twin_world_head *)head;
}

/* The transfer under way: slot `put`, with size > 0. */
static struct twin_world_transfer *under_way(struct twin_world_head *h) {
    return &h->transfer[h->queue.put % TWIN_WORLD_TRANSFERS];
}

/* Ends the transfer under way and begins an empty one, if there is room. */
static void end_transfer(struct twin_world_head *h) {
    h->queue.put++;
    under_way(h)->size = 0;
}

void twin_head_packet(struct twin_devices *twin, const struct cart_packet *packet) {
    struct twin_world_head *h = &twin->head;
    if (!h->started)
        return;
    if (h->queue.put - h->queue.taken >= TWIN_WORLD_TRANSFERS - 1) {
        h->queue.lost++; /* nobody fetches: the head has nowhere to keep it */
        return;
    }
    int64_t t_ns = twin_world_host_ns(twin, packet->t_host_ns);
    struct twin_world_transfer *t = under_way(h);
    if (t->size && t_ns - t->t_first_ns > transfer_ns) {
        end_transfer(h);
        t = under_way(h);
    }
    if (!t->size)
        t->t_first_ns = t_ns;
    t->t_last_ns = t_ns;
    memcpy(t->bytes + t->size, packet->bytes, packet->size);
    t->size += packet->size;
    bool is_short = packet->size < HEAD_PACKET_MAX_BYTES;
    if (is_short || t->size + HEAD_PACKET_MAX_BYTES > TWIN_WORLD_TRANSFER_BYTES)
        end_transfer(h);
}

static enum st identify(struct head *head, struct head_identity *out_identity, struct errctx *err) {
    struct twin_devices *twin = head_of(head)->twin;
    enum st st = twin_world_enter(twin, err);
    if (st)
        return st;
    double rate = twin_config_real(&twin->config, TWIN_CONFIG_SAMPLE_RATE);
    struct head_identity id = {.product = "scancart twin head",
                               .protocol_version = HEAD_PACKET_VERSION,
                               .interval_ns = (uint32_t)llround(1e9 / rate)};
    (void)snprintf(id.serial, sizeof id.serial, "twin-%llu", (unsigned long long)twin->seed);
    *out_identity = id;
    twin_world_leave(twin);
    return ST_OK;
}

static enum st start(struct head *head, struct errctx *err) {
    struct twin_world_head *h = head_of(head);
    enum st st = twin_world_enter(h->twin, err);
    if (st)
        return st;
    h->queue.taken = h->queue.put;
    under_way(h)->size = 0;
    h->started = true;
    twin_world_leave(h->twin);
    return ST_OK;
}

/* The next whole transfer that has come by now, in the entered world; NULL: none. */
static const struct twin_world_transfer *next(struct twin_world_head *h) {
    int64_t now_ns = twin_world_now_ns(h->twin);
    if (h->queue.taken == h->queue.put && under_way(h)->size &&
        now_ns - under_way(h)->t_first_ns > transfer_ns)
        end_transfer(h);
    if (h->queue.taken == h->queue.put)
        return NULL;
    const struct twin_world_transfer *t = &h->transfer[h->queue.taken % TWIN_WORLD_TRANSFERS];
    return t->t_last_ns <= now_ns ? t : NULL;
}

/* Gives the sink all that is there; in the entered world, which it leaves for each call. */
static bool hand_over(struct twin_world_head *h, const struct head_sink *sink) {
    const struct twin_world_transfer *t = next(h);
    bool any = t != NULL;
    for (; t; t = next(h)) {
        h->stats.transfers++;
        h->stats.bytes += t->size;
        (void)pthread_mutex_unlock(&h->twin->lock); /* its slot is not used again until taken */
        sink->bytes(sink->ctx, t->bytes, t->size, t->t_last_ns);
        (void)pthread_mutex_lock(&h->twin->lock);
        h->queue.taken++;
    }
    return any;
}

static enum st pump(struct head *head, unsigned timeout_ms, const struct head_sink *sink,
                    struct errctx *err) {
    struct twin_world_head *h = head_of(head);
    enum st st = twin_world_enter(h->twin, err);
    if (st)
        return st;
    int64_t until_ns = twin_world_now_ns(h->twin) + (int64_t)timeout_ms * 1000000;
    for (bool over = false; !hand_over(h, sink) && !over;) {
        st = twin_world_await(h->twin, until_ns, &over, err);
        if (st)
            return st;
    }
    twin_world_leave(h->twin);
    return ST_OK;
}

static enum st stop(struct head *head, const struct head_sink *sink, struct errctx *err) {
    struct twin_world_head *h = head_of(head);
    enum st st = twin_world_enter(h->twin, err);
    if (st)
        return st;
    if (under_way(h)->size)
        end_transfer(h);
    if (sink)
        (void)hand_over(h, sink);
    h->queue.taken = h->queue.put;
    h->started = false;
    twin_world_leave(h->twin);
    return ST_OK;
}

static void stats(const struct head *head, struct head_stats *out_stats) {
    *out_stats = ((const struct twin_world_head *)head)->stats;
}

static void close_head(struct head *head) {
    (void)head; /* it ends with the twin */
}

static const struct head_ops ops = {identify, start, pump, stop, stats, close_head};

void twin_head_init(struct twin_devices *twin) {
    twin->head.head.ops = &ops;
    twin->head.twin = twin;
}
