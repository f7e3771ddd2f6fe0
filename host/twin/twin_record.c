#include "twin/twin_record.h"

#include "base/edge_record.h"
#include "site/stream.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A chunk of the head is about 2.7 s of it: large enough to be cheap, small enough to lose little.
 */
enum { HEAD_CHUNK_BYTES = 1 << 20, SLOW_CHUNK_BYTES = 1 << 12 };

static enum st open_stream(struct twin_record *r, struct twin_record_stream *out, const char *kind,
                           const char *format, const char *meta, size_t capacity,
                           struct errctx *err) {
    struct stream stream;
    memset(&stream, 0, sizeof stream);
    stream.station_id = r->station_id;
    (void)snprintf(stream.kind, sizeof stream.kind, "%s", kind);
    (void)snprintf(stream.name, sizeof stream.name, "twin");
    (void)snprintf(stream.format, sizeof stream.format, "%s", format);
    (void)snprintf(stream.meta, sizeof stream.meta, "%s", meta);
    out->capacity = capacity;
    out->bytes = malloc(capacity);
    if (!out->bytes)
        return errctx_set(err, ST_NOMEM, "recording: out of memory");
    return stream_add(r->site, &stream, &out->id, err);
}

enum st twin_record_open(struct twin_record *record, struct site *site, int64_t station_id,
                         uint32_t interval_ns, struct errctx *err) {
    memset(record, 0, sizeof *record);
    record->site = site;
    record->station_id = station_id;
    char meta[128];
    (void)snprintf(meta, sizeof meta, "{\"interval_ns\": %u}", (unsigned)interval_ns);
    enum st st =
        open_stream(record, &record->head, "head", "head_packet.1", meta, HEAD_CHUNK_BYTES, err);
    if (!st)
        st = open_stream(record, &record->index, "index", "idxevent.1", "", SLOW_CHUNK_BYTES, err);
    if (!st)
        st = open_stream(record, &record->gpio, "gpio", "gpio_edge.1", "", SLOW_CHUNK_BYTES, err);
    return st;
}

void twin_record_fini(struct twin_record *record) {
    free(record->head.bytes);
    free(record->index.bytes);
    free(record->gpio.bytes);
    memset(record, 0, sizeof *record);
}

static enum st store(struct twin_record *r, struct twin_record_stream *s, struct errctx *err) {
    if (!s->items)
        return ST_OK;
    if (r->disk_full)
        return errctx_set(err, ST_FULL, "the site's disk is full");
    struct stream_chunk chunk;
    memset(&chunk, 0, sizeof chunk);
    chunk.t_first_ns = s->t_first_ns;
    chunk.t_last_ns = s->t_last_ns;
    chunk.first_item = s->first_item;
    chunk.end_item = s->next_item;
    chunk.item_count = s->items;
    chunk.payload = s->bytes;
    chunk.size_bytes = s->size;
    enum st st = stream_append(r->site, s->id, &chunk, 1, err);
    s->size = 0;
    s->items = 0;
    s->first_item = s->next_item;
    return st;
}

/* Adds an item. Its number is its place in the stream: what the device calls it is in its bytes. */
static enum st put(struct twin_record *r, struct twin_record_stream *s, const void *bytes,
                   size_t size, int64_t t_ns, struct errctx *err) {
    enum st st = s->size + size > s->capacity ? store(r, s, err) : ST_OK;
    if (st)
        return st;
    if (!s->items)
        s->t_first_ns = s->t_last_ns = t_ns;
    s->t_first_ns = t_ns < s->t_first_ns ? t_ns : s->t_first_ns;
    s->t_last_ns = t_ns > s->t_last_ns ? t_ns : s->t_last_ns;
    memcpy(s->bytes + s->size, bytes, size);
    s->size += size;
    s->items++;
    s->next_item++;
    return ST_OK;
}

/* How many packets are missing before this one, by its sequence number; -1: it is a repetition. A
 * damaged packet, a reset or a number from nowhere counts as the next one: what was sent is stored,
 * whatever it says. */
static int64_t missing_before(struct twin_record *r, const struct cart_packet *packet) {
    const uint32_t believable = 100000; /* two minutes of packets */
    struct head_packet p;
    size_t size = 0;
    if (head_packet_decode(packet->bytes, packet->size, &p, &size)) {
        r->next_seq++;
        return 0;
    }
    uint32_t ahead = p.packet_seq - r->next_seq;
    bool reset = (p.flags & HEAD_PACKET_RESET) || !r->head.next_item;
    if (!reset && ahead == UINT32_MAX)
        return -1;
    bool strange = !reset && ahead >= believable;
    r->next_seq = strange ? r->next_seq + 1 : p.packet_seq + 1;
    return reset || strange ? 0 : (int64_t)ahead;
}

/* Leaves numbers for packets that did not come, and says so in the ledger. */
static enum st leave_out(struct twin_record *r, int64_t count, int64_t t_ns, struct errctx *err) {
    struct stream_ledger entry;
    memset(&entry, 0, sizeof entry);
    entry.stream_id = r->head.id;
    entry.first_item = r->head.next_item;
    entry.end_item = r->head.next_item + count;
    entry.t_ns = t_ns;
    (void)snprintf(entry.reason, sizeof entry.reason, "usb_lost");
    r->head.next_item += count;
    return stream_ledger_add(r->site, &entry, err);
}

enum st twin_record_packet(struct twin_record *record, const struct cart_packet *packet,
                           struct errctx *err) {
    struct twin_record_stream *s = &record->head;
    int64_t missing = missing_before(record, packet);
    enum st st = missing > 0 ? leave_out(record, missing, packet->t_host_ns, err) : ST_OK;
    if (!st)
        st = put(record, s, packet->bytes, packet->size, packet->t_host_ns, err);
    if (!st && missing < 0 && s->items > 1) { /* the bytes are kept, the number is not used twice */
        s->items--;
        s->next_item--;
    }
    return st;
}

/* The record that the controller sent. */
static struct idxevent wire_of(const struct index_event *event) {
    bool positive = event->flags & INDEX_EVENT_PAN_POSITIVE;
    double whole = positive ? floor(event->pan_steps) : ceil(event->pan_steps);
    return (struct idxevent){.seq = (uint32_t)event->seq,
                             .time_us = (uint64_t)(event->t_ns / 1000),
                             .revolution = (uint32_t)event->revolution,
                             .pan_steps = (int32_t)whole,
                             .tilt_steps = event->tilt_steps,
                             .pan_phase = (uint16_t)(fabs(event->pan_steps - whole) * 65536 + 0.5),
                             .flags = (uint16_t)(event->kind | event->flags << 4)};
}

enum st twin_record_index(struct twin_record *record, const struct index_event *event,
                          int64_t t_host_ns, struct errctx *err) {
    uint16_t words[IDXEVENT_WORDS];
    uint8_t bytes[2 * IDXEVENT_WORDS];
    struct idxevent wire = wire_of(event);
    idxevent_encode(&wire, words);
    for (int i = 0; i < IDXEVENT_WORDS; i++) { /* as on the controller's line: high byte first */
        bytes[2 * i] = (uint8_t)(words[i] >> 8);
        bytes[2 * i + 1] = (uint8_t)words[i];
    }
    return put(record, &record->index, bytes, sizeof bytes, t_host_ns, err);
}

enum st twin_record_edge(struct twin_record *record, const struct cart_edge *edge,
                         struct errctx *err) {
    struct edge_record e = {edge->t_host_ns, edge->seq, (uint8_t)edge->line, edge->high};
    uint8_t bytes[EDGE_RECORD_BYTES];
    edge_record_encode(&e, bytes);
    return put(record, &record->gpio, bytes, sizeof bytes, edge->t_host_ns, err);
}

enum st twin_record_flush(struct twin_record *record, struct errctx *err) {
    enum st st = site_begin(record->site, err);
    if (st)
        return st;
    st = store(record, &record->head, err);
    if (!st)
        st = store(record, &record->index, err);
    if (!st)
        st = store(record, &record->gpio, err);
    if (st) {
        site_rollback(record->site);
        return st;
    }
    return site_commit(record->site, err);
}
