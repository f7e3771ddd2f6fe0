/* The rangefinder head as capture sees it: a stream of bytes that hold packets
 * (base/head_packet.h), handed on as they came. Backends: head_usb (libusb), head_replay (a
 * recording), the twin's.
 *
 * Threads: one thread at a time. start() allocates all that pump() needs; pump() itself neither
 * allocates, locks, formats nor touches files unless it fails, and calls the sink in the order in
 * which the bytes came.
 *
 * Statuses: ST_NOT_FOUND no such device; ST_PERMISSION (the text names the udev rule);
 * ST_UNSUPPORTED a device of another protocol version; ST_DEVICE the device is gone or refuses;
 * ST_CANCELLED the end of a recording or of a simulated world. */
#ifndef SC_DEVICE_HEAD_H
#define SC_DEVICE_HEAD_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct head_identity {
    char product[64], serial[64];
    unsigned protocol_version; /* HEAD_PACKET_VERSION of its packets */
    uint32_t interval_ns;      /* between samples, as the head says; 0: not known before packets */
};

/* Takes what came in one transfer. t_host_ns: host time, when the transfer was complete. The bytes
 * are gone when it returns. Must be safe on the real-time path. */
struct head_sink {
    void *ctx;
    void (*bytes)(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns);
};

struct head_stats {
    uint64_t transfers, bytes;
    uint64_t transfer_errors; /* transfers that failed and were sent again */
};

struct head;

struct head_ops {
    /* Required. */
    enum st (*identify)(struct head *head, struct head_identity *out_identity, struct errctx *err);
    /* Required. From now on bytes are taken; what the device had kept before is thrown away. */
    enum st (*start)(struct head *head, struct errctx *err);
    /* Required. Hands over all that has come; waits at most timeout_ms for the first byte. ST_OK
     * also without any byte. */
    enum st (*pump)(struct head *head, unsigned timeout_ms, const struct head_sink *sink,
                    struct errctx *err);
    /* Required. Ends taking; what is in flight is handed to the sink (NULL: dropped). At most 1 s.
     */
    enum st (*stop)(struct head *head, const struct head_sink *sink, struct errctx *err);
    /* Required. */
    void (*stats)(const struct head *head, struct head_stats *out_stats);
    /* Required. */
    void (*close)(struct head *head);
};

struct head {
    const struct head_ops *ops;
};

/* Calls close; takes NULL. */
static inline void head_close(struct head *head) {
    if (head)
        head->ops->close(head);
}

#ifdef __cplusplus
}
#endif
#endif
