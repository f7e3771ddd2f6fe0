/* From a device to the recorder: what pump() hands over goes into rings, and nothing else happens
 * on that thread. The sinks here are the real-time path: no allocation, lock, text, file or wait;
 * what does not fit is counted and left out whole.
 *
 * Threads: the sinks belong to the device's thread, the ..._take functions to the recorder's. */
#ifndef SC_CAPTURE_SOURCE_H
#define SC_CAPTURE_SOURCE_H

#include "base/ring.h"
#include "base/st.h"
#include "device/head.h"
#include "device/lines.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One transfer of the head, whose bytes are in the byte ring. */
struct source_transfer {
    int64_t t_host_ns;
    uint32_t size;
    uint32_t refused_before; /* transfers that did not fit, directly before this one */
};

struct source_head {
    /* constant after init */
    struct head_sink sink;
    void *memory;
    /* both sides, each as base/ring.h says */
    struct ring bytes, transfers;
    /* device thread */
    uint32_t refused; /* since the last transfer that fitted */
    /* any thread */
    SC_ATOMIC(uint64_t) transfers_total, refused_total; /* that came; that did not fit */
};

struct source_lines {
    struct lines_sink sink;
    void *memory;
    struct ring edges; /* of struct edge_record */
};

/* Rings that hold `seconds` at that many bytes a second (rounded up to a power of two), in memory
 * that is touched once so that it is there. ST_NOMEM. */
ST_MUST_CHECK enum st source_head_init(struct source_head *source, double bytes_per_s,
                                       double seconds, struct errctx *err);
void source_head_fini(struct source_head *source); /* takes a zeroed one */

/* Recorder: the next transfer, if its bytes fit into `capacity`: copies them and returns true.
 * False: there is none, or it does not fit (out_transfer->size then says how large it is, else 0).
 */
bool source_head_take(struct source_head *source, uint8_t *out_bytes, size_t capacity,
                      struct source_transfer *out_transfer);

/* Recorder: transfers refused since the last one that was taken (at the end of a scan). */
uint32_t source_head_refused_at_end(const struct source_head *source);

/* Most of the byte ring that was in use, 0 to 1. Any thread. */
double source_head_peak(const struct source_head *source);

ST_MUST_CHECK enum st source_lines_init(struct source_lines *source, size_t capacity,
                                        struct errctx *err);
void source_lines_fini(struct source_lines *source);

#ifdef __cplusplus
}
#endif
#endif
