/* The balance of a head's packets: every packet and every sample that the head numbered was stored,
 * was lost for a reason, or was never sent (the blind arc). Fed with the good packets in the order
 * in which they came and with what lay between them; says which item numbers are missing and why.
 *
 *   samples numbered = stored + lost + not sent          packets numbered = stored + lost
 *
 * Item numbers are the packets' own numbers, moved so that the first packet of the stream is item
 * 0; after a reset of the head they go on behind the last. No allocation; the recorder's thread. */
#ifndef SC_CAPTURE_HEAD_LEDGER_H
#define SC_CAPTURE_HEAD_LEDGER_H

#include "base/head_packet.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum head_ledger_reason {
    HEAD_LEDGER_USB_LOST,   /* a gap in the packets' numbers: lost on the way */
    HEAD_LEDGER_CRC,        /* bytes came in its place, but damaged; they are stored as they came */
    HEAD_LEDGER_RING_FULL,  /* came, but the recorder was too far behind */
    HEAD_LEDGER_POWER_LOSS, /* sent between two sessions, after the first had died */
    HEAD_LEDGER_DISK_FULL,  /* came, but the site took no more */
    HEAD_LEDGER_HEAD_OVERRUN, /* the head says that it lost them itself; no packet is missing */
    HEAD_LEDGER_REASONS
};

/* "usb_lost", "crc", ...: the reason in the site's ledger. */
const char *head_ledger_reason_name(enum head_ledger_reason reason);

struct head_ledger_totals {
    uint64_t packets, samples; /* good, stored */
    uint64_t lost_packets[HEAD_LEDGER_REASONS], lost_samples[HEAD_LEDGER_REASONS];
    uint64_t not_sent;      /* samples that the head numbered and left out: its blind arc */
    uint64_t overruns;      /* packets before which the head says that it lost samples itself */
    uint64_t resets;        /* the head began anew: what it lost at that moment is not known */
    uint64_t repeated;      /* packets that came again; the bytes are kept, not counted */
    uint64_t sequence;      /* packets with a number from nowhere, taken as the next */
    uint64_t damaged_bytes; /* that are no good packet; kept in the stream */
    uint64_t returns, no_returns, dropped, saturated, laser_off; /* of the samples stored */
};

/* Sum of the lost samples, of all reasons. */
uint64_t head_ledger_lost_samples(const struct head_ledger_totals *totals);
uint64_t head_ledger_lost_packets(const struct head_ledger_totals *totals);

struct head_ledger {
    struct head_ledger_totals totals;
    int64_t next_item; /* what the next packet will get */
    /* the packet before */
    bool started;
    uint32_t next_packet_seq, next_sample_seq;
    bool strange; /* the last one had a number from nowhere */
    uint32_t after_strange;
    /* between the packet before and the next */
    uint64_t damaged_bytes, ring_full;
};

/* Packets [first_item, end_item) are missing. */
struct head_ledger_gap {
    int64_t first_item, end_item;
    enum head_ledger_reason reason;
};

enum { HEAD_LEDGER_MAX_GAPS = 2 };

/* What became of one packet. */
struct head_ledger_verdict {
    bool counts;   /* false: a repetition, it has no item number of its own */
    int64_t item;  /* its number */
    unsigned gaps; /* missing right before it */
    struct head_ledger_gap gap[HEAD_LEDGER_MAX_GAPS];
};

void head_ledger_init(struct head_ledger *ledger);

/* Bytes that are no packet came; a transfer was refused by a full ring. */
void head_ledger_damaged(struct head_ledger *ledger, uint64_t bytes);
void head_ledger_ring_full(struct head_ledger *ledger, uint64_t transfers);

/* The next good packet. */
struct head_ledger_verdict head_ledger_packet(struct head_ledger *ledger,
                                              const struct head_packet *packet);

/* The stream ends: damaged bytes behind the last packet were at least one packet each 512 bytes, a
 * refused transfer was at least one. Returns how many gaps there are. */
unsigned head_ledger_end(struct head_ledger *ledger,
                         struct head_ledger_gap out_gaps[HEAD_LEDGER_MAX_GAPS]);

#ifdef __cplusplus
}
#endif
#endif
