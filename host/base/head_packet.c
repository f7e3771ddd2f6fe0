#include "base/head_packet.h"

#include <math.h>
#include <string.h>
#include <zlib.h>

static const uint8_t magic[4] = {'S', 'C', 'H', 'P'};

/* Offsets in the header; see docs/head-protocol.md. */
enum {
    AT_VERSION = 4,
    AT_FLAGS = 5,
    AT_COUNT = 6,
    AT_RESERVED = 7,
    AT_PACKET_SEQ = 8,
    AT_SAMPLE_SEQ = 12,
    AT_TIME = 16,
    AT_INTERVAL = 24,
    AT_STATUS = 28
};

static void put_u16(uint8_t *at, uint16_t v) {
    at[0] = (uint8_t)v;
    at[1] = (uint8_t)(v >> 8);
}

static void put_u32(uint8_t *at, uint32_t v) {
    put_u16(at, (uint16_t)v);
    put_u16(at + 2, (uint16_t)(v >> 16));
}

static uint16_t get_u16(const uint8_t *at) {
    return (uint16_t)(at[0] | (unsigned)at[1] << 8);
}

static uint32_t get_u32(const uint8_t *at) {
    return (uint32_t)get_u16(at) | (uint32_t)get_u16(at + 2) << 16;
}

uint32_t head_position_from_counts(double counts) {
    double turns = counts / HEAD_ENCODER_COUNTS;
    double whole = (turns - floor(turns)) * 4294967296.0; /* 2^12 counts * 2^20 */
    return (uint32_t)((uint64_t)(whole + 0.5) & 0xffffffffu);
}

double head_range_m(uint32_t range) {
    return range == HEAD_RANGE_NONE ? (double)NAN : (double)range * HEAD_RANGE_LSB_M;
}

uint32_t head_range_from_m(double range_m) {
    if (!(range_m >= 0 && range_m <= HEAD_RANGE_MAX_M))
        return HEAD_RANGE_NONE;
    return (uint32_t)(range_m / HEAD_RANGE_LSB_M + 0.5);
}

static uint32_t crc_of(const uint8_t *bytes, size_t size) {
    return (uint32_t)crc32(0, bytes, (uInt)size);
}

enum st head_packet_encode(const struct head_packet *packet, uint8_t *out_bytes, size_t *out_size) {
    if (packet->sample_count > HEAD_PACKET_MAX_SAMPLES || packet->head_t_ns < 0 ||
        packet->interval_ns > HEAD_INTERVAL_MAX_NS)
        return ST_INVALID;
    uint8_t *b = out_bytes;
    memcpy(b, magic, sizeof magic);
    b[AT_VERSION] = HEAD_PACKET_VERSION;
    b[AT_FLAGS] = packet->flags;
    b[AT_COUNT] = packet->sample_count;
    b[AT_RESERVED] = 0;
    put_u32(b + AT_PACKET_SEQ, packet->packet_seq);
    put_u32(b + AT_SAMPLE_SEQ, packet->first_sample_seq);
    put_u32(b + AT_TIME, (uint32_t)((uint64_t)packet->head_t_ns & 0xffffffffu));
    put_u32(b + AT_TIME + 4, (uint32_t)((uint64_t)packet->head_t_ns >> 32));
    put_u32(b + AT_INTERVAL, packet->interval_ns);
    put_u32(b + AT_STATUS, packet->status);
    uint8_t *at = b + HEAD_PACKET_HEADER_BYTES;
    for (unsigned i = 0; i < packet->sample_count; i++, at += HEAD_PACKET_SAMPLE_BYTES) {
        const struct head_sample *s = &packet->samples[i];
        at[0] = (uint8_t)(packet->first_sample_seq + i);
        at[1] = s->flags;
        put_u32(at + 2, s->range);
        put_u32(at + 6, s->position);
        put_u16(at + 10, s->intensity);
        put_u16(at + 12, s->ambient);
    }
    put_u32(at, crc_of(b, (size_t)(at - b)));
    *out_size = head_packet_bytes(packet->sample_count);
    return ST_OK;
}

/* Does the header make sense? Size is at least a header. */
static int header_fits(const uint8_t *b) {
    return !memcmp(b, magic, sizeof magic) && b[AT_VERSION] == HEAD_PACKET_VERSION &&
           b[AT_COUNT] <= HEAD_PACKET_MAX_SAMPLES && b[AT_RESERVED] == 0 &&
           (b[AT_TIME + 7] & 0x80) == 0 && get_u32(b + AT_INTERVAL) <= HEAD_INTERVAL_MAX_NS;
}

enum st head_packet_decode(const uint8_t *bytes, size_t size, struct head_packet *out_packet,
                           size_t *out_size) {
    size_t known = size < sizeof magic ? size : sizeof magic;
    if (memcmp(bytes, magic, known))
        return ST_FORMAT;
    if (size < HEAD_PACKET_HEADER_BYTES)
        return ST_TIMEOUT;
    if (!header_fits(bytes))
        return ST_FORMAT;
    unsigned count = bytes[AT_COUNT];
    size_t need = head_packet_bytes(count);
    if (size < need)
        return ST_TIMEOUT;
    if (get_u32(bytes + need - HEAD_PACKET_CRC_BYTES) !=
        crc_of(bytes, need - HEAD_PACKET_CRC_BYTES))
        return ST_DAMAGED;

    struct head_packet *p = out_packet;
    p->flags = bytes[AT_FLAGS];
    p->sample_count = (uint8_t)count;
    p->packet_seq = get_u32(bytes + AT_PACKET_SEQ);
    p->first_sample_seq = get_u32(bytes + AT_SAMPLE_SEQ);
    p->head_t_ns = (int64_t)((uint64_t)get_u32(bytes + AT_TIME) |
                             (uint64_t)get_u32(bytes + AT_TIME + 4) << 32);
    p->interval_ns = get_u32(bytes + AT_INTERVAL);
    p->status = get_u32(bytes + AT_STATUS);
    const uint8_t *at = bytes + HEAD_PACKET_HEADER_BYTES;
    for (unsigned i = 0; i < count; i++, at += HEAD_PACKET_SAMPLE_BYTES) {
        struct head_sample *s = &p->samples[i];
        s->seq8 = at[0];
        s->flags = at[1];
        s->range = get_u32(at + 2);
        s->position = get_u32(at + 6);
        s->intensity = get_u16(at + 10);
        s->ambient = get_u16(at + 12);
    }
    *out_size = need;
    return ST_OK;
}

enum st head_stream_next(const uint8_t *bytes, size_t size, size_t *offset,
                         struct head_packet *out_packet, struct head_stream_stats *stats) {
    while (*offset < size) {
        size_t used = 0;
        enum st st = head_packet_decode(bytes + *offset, size - *offset, out_packet, &used);
        if (st == ST_OK) {
            *offset += used;
            stats->packets++;
            return ST_OK;
        }
        if (st == ST_TIMEOUT)
            return ST_TIMEOUT;
        if (st == ST_DAMAGED)
            stats->damaged++;
        /* Not a packet here: go on at the next byte that could begin one. */
        const uint8_t *next = memchr(bytes + *offset + 1, magic[0], size - *offset - 1);
        size_t to = next ? (size_t)(next - bytes) : size;
        stats->bytes_skipped += to - *offset;
        *offset = to;
    }
    return ST_TIMEOUT;
}
