/* The recorder: drains the rings into the site, a batch at least every 250 ms, and keeps the
 * ledger. The only code of capture that touches the site while a scan runs. A batch that the disk
 * refuses is kept and tried again; what has come stays in memory and in the rings meanwhile.
 *
 * Streams of a station: "head" (head_packet.1, an item is a packet), "index" (idxevent.1, the
 * controller's events by their own numbers), "gpio" (gpio_edge.1), "clock" (clock_pair.1: three
 * little-endian i64: host time before and after one request, controller time in its answer).
 *
 * Threads: recorder_step() and what is below it on one thread; the recorder_put_...() on the plan's
 * thread; the counts can be read by any. Not for the real-time path. */
#ifndef SC_CAPTURE_RECORDER_H
#define SC_CAPTURE_RECORDER_H

#include "base/index_event.h"
#include "base/st.h"
#include "capture/head_ledger.h"
#include "capture/source.h"
#include "site/frame_row.h"
#include "site/site.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { RECORDER_BATCH_MS = 200, RECORDER_CLOCK_PAIR_BYTES = 24 };

struct recorder; /* on the heap */

struct recorder_config {
    struct site *site;
    int64_t station_id;
    const char *device;      /* name of the streams: "twin", "rpi5"; a resumed scan has ".2", ... */
    const char *head_meta;   /* JSON of the head stream; NULL: none */
    double head_bytes_per_s; /* expected */
    struct source_head *head;
    struct source_lines *lines;   /* NULL: none */
    bool (*disk_full)(void *ctx); /* a simulated disk; NULL: the site's own */
    void *disk_ctx;
    /* Where a scan that died had come to in its head stream; 0: none. Packets that the head has
     * sent since, if it is still counting on, go into that stream's ledger as power_loss. */
    int64_t before_stream_id;
};

/* What the recorder has done; a consistent copy. */
struct recorder_counts {
    struct head_ledger_totals head;
    uint64_t index_events, index_lost, edges, edges_lost, frames;
    uint64_t batches, failed_batches;
    uint64_t stored_bytes;     /* committed payload */
    uint64_t unstored_packets; /* that the disk did not take: lost at the end */
    int64_t longest_batch_ns;
    int64_t last_commit_ns; /* host time */
    uint32_t
        head_version_seen; /* of what came and was no packet: another protocol's version, or 0 */
};

/* Adds the streams and allocates all. Errors of the site; ST_NOMEM. */
ST_MUST_CHECK enum st recorder_open(const struct recorder_config *config,
                                    struct recorder **out_recorder, struct errctx *err);

/* Takes what the rings hold; commits if a batch is due (or `flush`). A failure is not the end: it
 * is returned each time a batch fails, and the same data are tried again at the next one. ST_FULL:
 * the disk. */
ST_MUST_CHECK enum st recorder_step(struct recorder *recorder, int64_t now_ns, bool flush,
                                    struct errctx *err);

/* Since when batches fail, host time; INT64_MAX: they do not. */
int64_t recorder_failing_since(const struct recorder *recorder);

/* Ends the streams: drains all, tries `attempts` batches. What cannot be stored is counted. */
ST_MUST_CHECK enum st recorder_finish(struct recorder *recorder, int64_t now_ns, int attempts,
                                      struct errctx *err);

void recorder_counts(struct recorder *recorder, struct recorder_counts *out_counts);
void recorder_close(struct recorder *recorder); /* takes NULL; stores nothing */

/* ---- from the plan's thread; none waits ---- */

/* An event, with the host time of its edge as far as known. lost: events before it that the
 * controller no longer had. */
void recorder_put_event(struct recorder *recorder, const struct index_event *event,
                        int64_t t_host_ns, uint64_t lost);
void recorder_put_clock_pair(struct recorder *recorder, int64_t before_ns, int64_t after_ns,
                             int64_t controller_ns);
/* A custody event. */
void recorder_put_note(struct recorder *recorder, const char *what, const char *detail_json);
/* A photograph: `bytes` is malloc'ed and taken over whatever happens; station, hash, are filled in
 * by the recorder. ST_NOMEM, ST_FULL. */
ST_MUST_CHECK enum st recorder_put_frame(struct recorder *recorder, uint8_t *bytes, size_t size,
                                         const char *extension, const struct frame_row *row);

#ifdef __cplusplus
}
#endif
#endif
