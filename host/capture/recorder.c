#include "capture/recorder.h"

#include "base/clock.h"
#include "base/ring.h"
#include "capture/event_wire.h"
#include "capture/tape.h"
#include "site/custody.h"
#include "site/files.h"
#include "site/stream.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    EVENTS = 4096,
    PAIRS = 1024,
    NOTES = 64,
    FRAMES = 64,
    SLOW_TAPE_BYTES = 1 << 18,
    HEAD_TAPE_MIN_BYTES = 8 << 20,
    HEAD_TAPE_MAX_BYTES = TAPE_CHUNKS / 2 * TAPE_CHUNK_BYTES,
    NS_A_MS = 1000000
};

struct event_item {
    struct index_event event;
    int64_t t_host_ns;
    uint64_t lost;
};

struct pair_item {
    int64_t before_ns, after_ns, controller_ns;
};

struct note {
    char what[SITE_KIND_MAX], detail[SITE_TEXT_MAX];
};

struct frame_item {
    uint8_t *bytes;
    size_t size;
    char extension[8];
    struct frame_row row;
};

struct recorder {
    struct recorder_config config;
    /* plan's thread to recorder's */
    struct ring events, pairs, notes, frames;
    void *memory[4];
    /* recorder's thread */
    struct tape head, index, gpio, clock;
    bool has_gpio;
    struct head_ledger ledger;
    struct head_packet packet; /* being looked at */
    int64_t index_base;        /* item number = event's number + base */
    uint64_t next_event;
    uint64_t lines_refused;
    uint64_t last_lines_lost;
    int64_t next_batch_ns, last_ns;
    int64_t failing_since_ns; /* INT64_MAX: not */
    struct recorder_counts counts;
    int64_t before_gap; /* packets sent between two sessions; -1: not known yet */
    /* any thread, under the lock */
    pthread_mutex_t lock;
    struct recorder_counts shown;
};

/* ---- from the plan's thread ---- */

void recorder_put_event(struct recorder *recorder, const struct index_event *event,
                        int64_t t_host_ns, uint64_t lost) {
    struct event_item item = {*event, t_host_ns, lost};
    (void)ring_push(&recorder->events, &item, 1);
}

void recorder_put_clock_pair(struct recorder *recorder, int64_t before_ns, int64_t after_ns,
                             int64_t controller_ns) {
    struct pair_item item = {before_ns, after_ns, controller_ns};
    (void)ring_push(&recorder->pairs, &item, 1);
}

void recorder_put_note(struct recorder *recorder, const char *what, const char *detail_json) {
    struct note note;
    memset(&note, 0, sizeof note);
    (void)snprintf(note.what, sizeof note.what, "%s", what);
    (void)snprintf(note.detail, sizeof note.detail, "%s", detail_json ? detail_json : "");
    (void)ring_push(&recorder->notes, &note, 1);
}

enum st recorder_put_frame(struct recorder *recorder, uint8_t *bytes, size_t size,
                           const char *extension, const struct frame_row *row) {
    struct frame_item item = {.bytes = bytes, .size = size, .row = *row};
    (void)snprintf(item.extension, sizeof item.extension, "%s", extension);
    item.row.station_id = recorder->config.station_id;
    if (ring_push(&recorder->frames, &item, 1) == 1)
        return ST_OK;
    free(bytes);
    return ST_FULL;
}

/* ---- the head ---- */

/* Junk between packets is kept in the chunk where it came. */
static bool cut_junk(struct recorder *r, size_t size, int64_t t_ns) {
    const uint8_t *at = r->head.bytes + r->head.cut;
    static const uint8_t magic[4] = {'S', 'C', 'H', 'P'};
    if (size > 4 && !memcmp(at, magic, sizeof magic) && at[4] != HEAD_PACKET_VERSION)
        r->counts.head_version_seen = at[4];
    head_ledger_damaged(&r->ledger, size);
    return tape_cut(&r->head, size, r->ledger.next_item, 0, t_ns);
}

/* What the packets' numbers say about the time between a session that died and this one. */
static void meet_before(struct recorder *r, const struct head_packet *packet, int64_t t_ns);

static enum st put_packet(struct recorder *r, size_t size, int64_t t_ns) {
    if (r->before_gap < 0)
        meet_before(r, &r->packet, t_ns);
    struct head_ledger_verdict v = head_ledger_packet(&r->ledger, &r->packet);
    for (unsigned i = 0; i < v.gaps; i++) {
        enum st st = tape_miss(&r->head, v.gap[i].first_item, v.gap[i].end_item, t_ns,
                               head_ledger_reason_name(v.gap[i].reason));
        if (st)
            return st;
    }
    (void)tape_cut(&r->head, size, v.item, v.counts, t_ns); /* the caller left room */
    return ST_OK;
}

/* Length of what is no packet at the beginning of bytes[0..size), or 0 where more must come. */
static size_t junk_length(const uint8_t *bytes, size_t size, enum st why) {
    if (why == ST_TIMEOUT)
        return 0;
    const uint8_t *next = memchr(bytes + 1, 'S', size - 1);
    return next ? (size_t)(next - bytes) : size;
}

/* The chunk that a transfer began starts with a packet that came before the transfer was complete:
 * by how much, the head's own clock says. */
static void date_chunk(struct stream_chunk *chunk, int64_t t_host_ns, int64_t head_ns) {
    const int64_t longest_ns = 1000000000;
    if (head_ns > 0 && head_ns < longest_ns)
        chunk->t_first_ns = t_host_ns - head_ns;
}

/* Cuts what a transfer brought into items. */
static enum st cut_transfer(struct recorder *r, int64_t t_host_ns) {
    struct tape *t = &r->head;
    struct stream_chunk *begun = NULL;
    int64_t begun_head_ns = 0;
    size_t size = 0;
    while (t->cut < t->size) {
        if (t->chunks + 2 > TAPE_CHUNKS)
            return ST_FULL;
        const uint8_t *bytes = t->bytes + t->cut;
        enum st st = head_packet_decode(bytes, t->size - t->cut, &r->packet, &size);
        if (st) {
            size_t junk = junk_length(bytes, t->size - t->cut, st);
            if (!junk)
                break;
            (void)cut_junk(r, junk, t_host_ns);
            continue;
        }
        size_t chunks = t->chunks;
        if ((st = put_packet(r, size, t_host_ns)))
            return st;
        if (t->chunks > chunks) {
            begun = &t->chunk[t->chunks - 1];
            begun_head_ns = r->packet.head_t_ns;
        }
        if (begun)
            date_chunk(begun, t_host_ns, r->packet.head_t_ns - begun_head_ns);
    }
    return ST_OK;
}

static enum st drain_head(struct recorder *r) {
    struct source_transfer transfer;
    struct tape *t = &r->head;
    while (t->chunks + 2 <= TAPE_CHUNKS &&
           source_head_take(r->config.head, t->bytes + t->size, t->capacity - t->size, &transfer)) {
        if (transfer.refused_before)
            head_ledger_ring_full(&r->ledger, transfer.refused_before);
        t->size += transfer.size;
        enum st st = cut_transfer(r, transfer.t_host_ns);
        if (st && st != ST_FULL)
            return st;
    }
    return ST_OK;
}

/* ---- a session that died before this one ---- */

/* The last good packet of a stream. */
static enum st last_packet(struct site *site, int64_t stream_id, struct head_packet *out_packet,
                           int64_t *out_end_item, struct errctx *err) {
    struct stream_state state;
    struct stream_reader *reader = NULL;
    struct stream_chunk chunk;
    enum st st = stream_get_state(site, stream_id, &state, err);
    if (!st && !state.chunk_count)
        return ST_NOT_FOUND;
    if (!st)
        st = stream_reader_open(site, stream_id, state.chunk_count - 1, &reader, err);
    if (!st)
        st = stream_reader_next(reader, &chunk, err);
    bool found = false;
    if (!st) {
        struct head_stream_stats stats = {0};
        struct head_packet packet;
        size_t at = 0;
        while (!head_stream_next(chunk.payload, chunk.size_bytes, &at, &packet, &stats)) {
            *out_packet = packet;
            found = true;
        }
        *out_end_item = state.end_item;
    }
    stream_reader_close(reader);
    return st ? st : found ? ST_OK : ST_NOT_FOUND;
}

static void meet_before(struct recorder *r, const struct head_packet *packet, int64_t t_ns) {
    const double clocks_agree = 0.05; /* of the head's own time and its count of samples */
    struct head_packet last;
    int64_t end_item = 0;
    struct errctx err;
    r->before_gap = 0;
    if (last_packet(r->config.site, r->config.before_stream_id, &last, &end_item, &err))
        return;
    uint32_t packets = packet->packet_seq - last.packet_seq - 1;
    uint32_t samples = packet->first_sample_seq - last.first_sample_seq;
    double went_ns = (double)(packet->head_t_ns - last.head_t_ns);
    double counted_ns = (double)samples * packet->interval_ns;
    bool same = !(packet->flags & HEAD_PACKET_RESET) && packets < UINT32_MAX / 2 &&
                fabs(went_ns - counted_ns) <= clocks_agree * counted_ns;
    if (!same || !packets)
        return;
    struct stream_ledger entry;
    memset(&entry, 0, sizeof entry);
    entry.stream_id = r->config.before_stream_id;
    entry.first_item = end_item;
    entry.end_item = end_item + packets;
    entry.t_ns = t_ns;
    (void)snprintf(entry.reason, sizeof entry.reason, "%s",
                   head_ledger_reason_name(HEAD_LEDGER_POWER_LOSS));
    if (!stream_ledger_add(r->config.site, &entry, &err)) {
        r->before_gap = packets;
        r->counts.head.lost_packets[HEAD_LEDGER_POWER_LOSS] = packets;
    }
}

/* ---- events, edges, pairs ---- */

static enum st drain_events(struct recorder *r) {
    struct event_item item;
    enum st st = ST_OK;
    while (!st && r->index.cut + EVENT_WIRE_BYTES <= r->index.capacity &&
           r->index.chunks < TAPE_CHUNKS && ring_pop(&r->events, &item, 1) == 1) {
        bool restarted = !r->counts.index_events || item.event.seq < r->next_event;
        if (restarted) /* the first one, or the controller began anew */
            r->index_base = r->index.next_item - (int64_t)(item.event.seq - item.lost);
        int64_t number = (int64_t)item.event.seq + r->index_base;
        if (number > r->index.next_item) {
            r->counts.index_lost += (uint64_t)(number - r->index.next_item);
            st = tape_miss(&r->index, r->index.next_item, number, item.t_host_ns, "overwritten");
        }
        uint8_t bytes[EVENT_WIRE_BYTES];
        event_wire_encode(&item.event, bytes);
        (void)tape_put(&r->index, bytes, sizeof bytes, number, item.t_host_ns);
        r->next_event = item.event.seq + 1;
        r->counts.index_events++;
    }
    return st;
}

static enum st drain_edges(struct recorder *r, int64_t now_ns) {
    struct edge_record edge;
    while (r->gpio.cut + EDGE_RECORD_BYTES <= r->gpio.capacity && r->gpio.chunks < TAPE_CHUNKS &&
           ring_pop(&r->config.lines->edges, &edge, 1) == 1) {
        uint8_t bytes[EDGE_RECORD_BYTES];
        edge_record_encode(&edge, bytes);
        (void)tape_put(&r->gpio, bytes, sizeof bytes, r->gpio.next_item, edge.t_ns);
        r->counts.edges++;
    }
    uint64_t refused = ring_refused(&r->config.lines->edges), lost = refused - r->lines_refused;
    r->lines_refused = refused;
    r->counts.edges_lost += lost;
    return lost ? tape_miss(&r->gpio, r->gpio.next_item, r->gpio.next_item + (int64_t)lost, now_ns,
                            head_ledger_reason_name(HEAD_LEDGER_RING_FULL))
                : ST_OK;
}

static void drain_pairs(struct recorder *r) {
    struct pair_item item;
    while (r->clock.cut + RECORDER_CLOCK_PAIR_BYTES <= r->clock.capacity &&
           r->clock.chunks < TAPE_CHUNKS && ring_pop(&r->pairs, &item, 1) == 1) {
        uint8_t bytes[RECORDER_CLOCK_PAIR_BYTES];
        int64_t values[3] = {item.before_ns, item.after_ns, item.controller_ns};
        for (int i = 0; i < RECORDER_CLOCK_PAIR_BYTES; i++)
            bytes[i] = (uint8_t)((uint64_t)values[i / 8] >> (8 * (i % 8)));
        (void)tape_put(&r->clock, bytes, sizeof bytes, r->clock.next_item, item.after_ns);
    }
}

static enum st drain(struct recorder *r, int64_t now_ns) {
    enum st st = drain_head(r);
    if (!st)
        st = drain_events(r);
    if (!st && r->has_gpio)
        st = drain_edges(r, now_ns);
    drain_pairs(r);
    return st;
}

/* ---- batches ---- */

static enum st store_frame(struct recorder *r, struct frame_item *f, struct errctx *err) {
    int64_t id = 0;
    enum st st =
        files_put(r->config.site, FILES_FRAME, f->extension, f->bytes, f->size, f->row.sha256, err);
    return st ? st : frame_row_add(r->config.site, &f->row, &id, err);
}

/* What is in the rings of notes and frames, left there until it is committed. */
static enum st store_rest(struct recorder *r, size_t *out_notes, size_t *out_frames,
                          struct errctx *err) {
    enum st st = ST_OK;
    struct ring_regions notes = ring_waiting(&r->notes), frames = ring_waiting(&r->frames);
    *out_notes = notes.first_count;
    *out_frames = frames.first_count;
    struct note *note = notes.first;
    for (size_t i = 0; i < notes.first_count && !st; i++)
        st = custody_add(r->config.site, note[i].what, note[i].detail[0] ? note[i].detail : NULL,
                         err);
    struct frame_item *frame = frames.first;
    for (size_t i = 0; i < frames.first_count && !st; i++)
        st = store_frame(r, &frame[i], err);
    return st;
}

static enum st store(struct recorder *r, size_t *out_notes, size_t *out_frames,
                     struct errctx *err) {
    struct tape *tapes[] = {&r->head, &r->index, &r->clock, &r->gpio};
    if (r->config.disk_full && r->config.disk_full(r->config.disk_ctx))
        return errctx_set(err, ST_FULL, "%s: the disk is full", site_path(r->config.site));
    enum st st = site_begin(r->config.site, err);
    if (st)
        return st;
    for (size_t i = 0; i < (r->has_gpio ? 4 : 3) && !st; i++)
        st = tape_store(tapes[i], r->config.site, err);
    if (!st)
        st = store_rest(r, out_notes, out_frames, err);
    if (!st)
        return site_commit(r->config.site, err);
    site_rollback(r->config.site);
    return st;
}

static bool anything(struct recorder *r) {
    return r->head.cut || r->head.entries || r->index.cut || r->index.entries || r->gpio.cut ||
           r->gpio.entries || r->clock.cut || ring_waiting(&r->notes).first_count ||
           ring_waiting(&r->frames).first_count;
}

static void committed(struct recorder *r, size_t notes, size_t frames) {
    r->counts.batches++;
    r->counts.stored_bytes +=
        tape_bytes(&r->head) + tape_bytes(&r->index) + tape_bytes(&r->gpio) + tape_bytes(&r->clock);
    tape_clear(&r->head);
    tape_clear(&r->index);
    tape_clear(&r->clock);
    if (r->has_gpio)
        tape_clear(&r->gpio);
    ring_release(&r->notes, notes);
    struct frame_item *frame = ring_waiting(&r->frames).first;
    for (size_t i = 0; i < frames; i++) {
        r->counts.stored_bytes += frame[i].size;
        free(frame[i].bytes);
    }
    ring_release(&r->frames, frames);
    r->counts.frames += frames;
    r->failing_since_ns = INT64_MAX;
}

static void show(struct recorder *r) {
    r->counts.head = r->ledger.totals;
    if (r->before_gap > 0)
        r->counts.head.lost_packets[HEAD_LEDGER_POWER_LOSS] = (uint64_t)r->before_gap;
    (void)pthread_mutex_lock(&r->lock);
    r->shown = r->counts;
    (void)pthread_mutex_unlock(&r->lock);
}

static enum st batch(struct recorder *r, int64_t now_ns, struct errctx *err) {
    size_t notes = 0, frames = 0;
    struct errctx own = {0};
    int64_t start_ns = clock_now_ns();
    enum st st = store(r, &notes, &frames, &own);
    int64_t took_ns = clock_now_ns() - start_ns;
    if (took_ns > r->counts.longest_batch_ns)
        r->counts.longest_batch_ns = took_ns;
    if (!st) {
        committed(r, notes, frames);
        r->counts.last_commit_ns = now_ns;
        return ST_OK;
    }
    r->counts.failed_batches++;
    if (r->failing_since_ns == INT64_MAX)
        r->failing_since_ns = now_ns;
    if (err)
        *err = own;
    return st;
}

enum st recorder_step(struct recorder *recorder, int64_t now_ns, bool flush, struct errctx *err) {
    struct recorder *r = recorder;
    enum st st = drain(r, now_ns);
    if (st)
        return errctx_set(err, st, "no memory for the ledger");
    if (now_ns < r->last_ns && r->next_batch_ns > now_ns) /* the clock was set back */
        r->next_batch_ns = now_ns;
    r->last_ns = now_ns;
    bool full = r->head.cut > r->head.capacity / 2 && r->failing_since_ns == INT64_MAX;
    if (flush || full || now_ns >= r->next_batch_ns) {
        r->next_batch_ns = now_ns + (int64_t)RECORDER_BATCH_MS * NS_A_MS;
        if (anything(r))
            st = batch(r, now_ns, err);
    }
    show(r);
    return st;
}

int64_t recorder_failing_since(const struct recorder *recorder) {
    return recorder->failing_since_ns;
}

enum st recorder_finish(struct recorder *recorder, int64_t now_ns, int attempts,
                        struct errctx *err) {
    struct recorder *r = recorder;
    struct head_ledger_gap gaps[HEAD_LEDGER_MAX_GAPS];
    enum st st = ST_OK;
    for (int i = 0; i < attempts; i++) {
        st = recorder_step(r, now_ns, true, err);
        if (st)
            continue;
        if (r->head.size > r->head.cut) /* half a packet: it ends here */
            (void)cut_junk(r, r->head.size - r->head.cut, now_ns);
        if (r->config.head && source_head_refused_at_end(r->config.head))
            head_ledger_ring_full(&r->ledger, source_head_refused_at_end(r->config.head));
        unsigned count = head_ledger_end(&r->ledger, gaps);
        for (unsigned g = 0; g < count && !st; g++)
            st = tape_miss(&r->head, gaps[g].first_item, gaps[g].end_item, now_ns,
                           head_ledger_reason_name(gaps[g].reason));
        if (!st)
            st = recorder_step(r, now_ns, true, err);
        if (!st)
            break;
    }
    if (st)
        for (size_t i = 0; i < r->head.chunks; i++)
            r->counts.unstored_packets += (uint64_t)r->head.chunk[i].item_count;
    show(r);
    return st;
}

void recorder_counts(struct recorder *recorder, struct recorder_counts *out_counts) {
    (void)pthread_mutex_lock(&recorder->lock);
    *out_counts = recorder->shown;
    (void)pthread_mutex_unlock(&recorder->lock);
}

/* ---- opening ---- */

static enum st make_ring(struct recorder *r, int number, struct ring *ring, size_t count,
                         size_t bytes) {
    r->memory[number] = calloc(count, bytes);
    return r->memory[number] ? ring_init(ring, r->memory[number], count, bytes) : ST_NOMEM;
}

static enum st add_stream(struct recorder *r, struct tape *tape, const char *kind,
                          const char *format, size_t capacity, struct errctx *err) {
    struct stream stream;
    memset(&stream, 0, sizeof stream);
    stream.station_id = r->config.station_id;
    (void)snprintf(stream.kind, sizeof stream.kind, "%s", kind);
    (void)snprintf(stream.name, sizeof stream.name, "%s", r->config.device);
    (void)snprintf(stream.format, sizeof stream.format, "%s", format);
    if (!strcmp(kind, "head") && r->config.head_meta)
        (void)snprintf(stream.meta, sizeof stream.meta, "%s", r->config.head_meta);
    return tape_open(tape, r->config.site, &stream, capacity, err);
}

static enum st add_streams(struct recorder *r, struct errctx *err) {
    double wanted = r->config.head_bytes_per_s * 2;
    size_t head_bytes = wanted < HEAD_TAPE_MIN_BYTES   ? HEAD_TAPE_MIN_BYTES
                        : wanted > HEAD_TAPE_MAX_BYTES ? HEAD_TAPE_MAX_BYTES
                                                       : (size_t)wanted;
    const bool own = !site_in_batch(r->config.site); /* else the caller decides what remains */
    enum st st = own ? site_begin(r->config.site, err) : ST_OK;
    if (st)
        return st;
    st = add_stream(r, &r->head, "head", "head_packet.1", head_bytes, err);
    if (!st)
        st = add_stream(r, &r->index, "index", "idxevent.1", SLOW_TAPE_BYTES, err);
    if (!st)
        st = add_stream(r, &r->clock, "clock", "clock_pair.1", SLOW_TAPE_BYTES, err);
    if (!st && r->config.lines)
        st = add_stream(r, &r->gpio, "gpio", "gpio_edge.1", SLOW_TAPE_BYTES, err);
    r->has_gpio = r->config.lines != NULL;
    if (own && !st)
        return site_commit(r->config.site, err);
    if (own)
        site_rollback(r->config.site);
    return st;
}

enum st recorder_open(const struct recorder_config *config, struct recorder **out_recorder,
                      struct errctx *err) {
    struct recorder *r = calloc(1, sizeof *r);
    if (!r || pthread_mutex_init(&r->lock, NULL)) {
        free(r);
        return errctx_set(err, ST_NOMEM, "no memory to record");
    }
    r->config = *config;
    r->failing_since_ns = INT64_MAX;
    r->before_gap = config->before_stream_id ? -1 : 0;
    head_ledger_init(&r->ledger);
    enum st st = make_ring(r, 0, &r->events, EVENTS, sizeof(struct event_item));
    if (!st)
        st = make_ring(r, 1, &r->pairs, PAIRS, sizeof(struct pair_item));
    if (!st)
        st = make_ring(r, 2, &r->notes, NOTES, sizeof(struct note));
    if (!st)
        st = make_ring(r, 3, &r->frames, FRAMES, sizeof(struct frame_item));
    if (st)
        (void)errctx_set(err, st, "no memory to record");
    if (!st)
        st = add_streams(r, err);
    if (st)
        recorder_close(r);
    else
        *out_recorder = r;
    return st;
}

void recorder_close(struct recorder *recorder) {
    if (!recorder)
        return;
    struct frame_item frame;
    while (recorder->memory[3] && ring_pop(&recorder->frames, &frame, 1) == 1)
        free(frame.bytes);
    for (int i = 0; i < 4; i++)
        free(recorder->memory[i]);
    tape_fini(&recorder->head);
    tape_fini(&recorder->index);
    tape_fini(&recorder->gpio);
    tape_fini(&recorder->clock);
    (void)pthread_mutex_destroy(&recorder->lock);
    free(recorder);
}
