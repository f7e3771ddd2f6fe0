#include "capture/head_ledger.h"

#include <string.h>

/* Larger gaps are numbers from nowhere: more than a minute of packets at 2 million samples/s. */
static const uint32_t believable_packets = 1u << 22;
static const uint32_t believable_samples = 1u << 30;

const char *head_ledger_reason_name(enum head_ledger_reason reason) {
    static const char *const names[HEAD_LEDGER_REASONS] = {
        "usb_lost", "crc", "ring_full", "power_loss", "disk_full", "head_overrun"};
    return (unsigned)reason < HEAD_LEDGER_REASONS ? names[reason] : "unknown";
}

uint64_t head_ledger_lost_samples(const struct head_ledger_totals *totals) {
    uint64_t sum = 0;
    for (int i = 0; i < HEAD_LEDGER_REASONS; i++)
        sum += totals->lost_samples[i];
    return sum;
}

uint64_t head_ledger_lost_packets(const struct head_ledger_totals *totals) {
    uint64_t sum = 0;
    for (int i = 0; i < HEAD_LEDGER_REASONS; i++)
        sum += totals->lost_packets[i];
    return sum;
}

void head_ledger_init(struct head_ledger *ledger) {
    memset(ledger, 0, sizeof *ledger);
}

void head_ledger_damaged(struct head_ledger *ledger, uint64_t bytes) {
    ledger->damaged_bytes += bytes;
    ledger->totals.damaged_bytes += bytes;
}

void head_ledger_ring_full(struct head_ledger *ledger, uint64_t transfers) {
    ledger->ring_full += transfers;
}

static uint64_t damaged_packets(const struct head_ledger *ledger) {
    return (ledger->damaged_bytes + HEAD_PACKET_MAX_BYTES - 1) / HEAD_PACKET_MAX_BYTES;
}

/* `packets` and `samples` that are missing, as one gap behind the last one. */
static void add_gap(struct head_ledger *l, enum head_ledger_reason reason, uint64_t packets,
                    uint64_t samples, struct head_ledger_gap *out_gap) {
    *out_gap = (struct head_ledger_gap){l->next_item, l->next_item + (int64_t)packets, reason};
    l->next_item += (int64_t)packets;
    l->totals.lost_packets[reason] += packets;
    l->totals.lost_samples[reason] += samples;
}

/* `missing` packets before this one that, with what was never sent, numbered `samples`. */
static void miss(struct head_ledger *l, uint64_t missing, uint64_t samples, bool overrun,
                 struct head_ledger_verdict *verdict) {
    uint64_t most = missing * HEAD_PACKET_MAX_SAMPLES, lost = samples < most ? samples : most;
    uint64_t crc = damaged_packets(l) < missing ? damaged_packets(l) : missing;
    uint64_t crc_samples = missing ? lost * crc / missing : 0;
    if (crc)
        add_gap(l, HEAD_LEDGER_CRC, crc, crc_samples, &verdict->gap[verdict->gaps++]);
    if (missing > crc)
        add_gap(l, l->ring_full ? HEAD_LEDGER_RING_FULL : HEAD_LEDGER_USB_LOST, missing - crc,
                lost - crc_samples, &verdict->gap[verdict->gaps++]);
    if (overrun)
        l->totals.lost_samples[HEAD_LEDGER_HEAD_OVERRUN] += samples - lost;
    else
        l->totals.not_sent += samples - lost;
}

static void count_samples(struct head_ledger_totals *t, const struct head_packet *packet) {
    unsigned none = 0, dropped = 0, saturated = 0, off = 0, back = 0;
    for (unsigned i = 0; i < packet->sample_count; i++) {
        unsigned flags = packet->samples[i].flags;
        none += (flags & HEAD_SAMPLE_NO_RETURN) != 0;
        dropped += (flags & HEAD_SAMPLE_DROPPED) != 0;
        saturated += (flags & HEAD_SAMPLE_SATURATED) != 0;
        off += (flags & HEAD_SAMPLE_LASER_OFF) != 0;
        back += packet->samples[i].range != HEAD_RANGE_NONE;
    }
    t->packets++;
    t->samples += packet->sample_count;
    t->no_returns += none;
    t->dropped += dropped;
    t->saturated += saturated;
    t->laser_off += off;
    t->returns += back;
}

/* How many packets are missing before this one; sets *out_repeated. */
static uint32_t missing_before(struct head_ledger *l, const struct head_packet *packet,
                               bool *out_repeated) {
    uint32_t seq = packet->packet_seq, ahead = seq - l->next_packet_seq;
    bool follows_strange = l->strange && seq == l->after_strange;
    l->strange = false;
    if (ahead == 0)
        return 0;
    if (follows_strange) { /* the head counts from there on: its numbers jumped for good */
        l->next_packet_seq = seq;
        return 0;
    }
    if (ahead == UINT32_MAX && packet->first_sample_seq - l->next_sample_seq > UINT32_MAX / 2) {
        *out_repeated = true;
        return 0;
    }
    /* A packet that is missing took samples with it: two witnesses against one wrong number. */
    if (ahead < believable_packets && packet->first_sample_seq - l->next_sample_seq >= ahead)
        return ahead;
    l->totals.sequence++;
    l->strange = true;
    l->after_strange = seq + 1;
    return 0;
}

struct head_ledger_verdict head_ledger_packet(struct head_ledger *ledger,
                                              const struct head_packet *packet) {
    struct head_ledger *l = ledger;
    struct head_ledger_verdict v = {.counts = true};
    bool reset = (packet->flags & HEAD_PACKET_RESET) != 0, repeated = false;
    bool overrun = (packet->status & HEAD_STATUS_OVERRUN) != 0;
    l->totals.overruns += overrun;
    l->totals.resets += reset && l->started;
    if (l->started && !reset) {
        uint32_t missing = missing_before(l, packet, &repeated);
        uint32_t samples = packet->first_sample_seq - l->next_sample_seq;
        if (repeated) {
            l->totals.repeated++;
            v.counts = false;
            v.item = l->next_item - 1;
            return v;
        }
        miss(l, missing, samples < believable_samples ? samples : 0, overrun, &v);
        l->next_packet_seq += missing + 1;
    } else {
        l->strange = false;
        l->next_packet_seq = packet->packet_seq + 1;
    }
    l->started = true;
    l->next_sample_seq = packet->first_sample_seq + packet->sample_count;
    l->damaged_bytes = 0;
    l->ring_full = 0;
    v.item = l->next_item++;
    count_samples(&l->totals, packet);
    return v;
}

unsigned head_ledger_end(struct head_ledger *ledger,
                         struct head_ledger_gap out_gaps[HEAD_LEDGER_MAX_GAPS]) {
    unsigned gaps = 0;
    uint64_t crc = damaged_packets(ledger);
    if (crc)
        add_gap(ledger, HEAD_LEDGER_CRC, crc, 0, &out_gaps[gaps++]);
    if (ledger->ring_full)
        add_gap(ledger, HEAD_LEDGER_RING_FULL, ledger->ring_full, 0, &out_gaps[gaps++]);
    ledger->damaged_bytes = ledger->ring_full = 0;
    return gaps;
}
