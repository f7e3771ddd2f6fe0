/* Packets of the rangefinder head, as sent over its USB bulk endpoint and as stored in a site's
 * "head" stream. docs/head-protocol.md is the specification; this is its one encoder and decoder.
 * All integers little-endian. No allocation; safe on the real-time path.
 *
 *   packet = header (32 bytes) | sample_count samples (14 bytes each) | CRC-32 (4 bytes)
 *
 * 34 samples fill the 512 bytes of a high-speed bulk packet exactly. */
#ifndef SC_BASE_HEAD_PACKET_H
#define SC_BASE_HEAD_PACKET_H

#include "base/st.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    HEAD_PACKET_VERSION = 1,
    HEAD_PACKET_HEADER_BYTES = 32,
    HEAD_PACKET_SAMPLE_BYTES = 14,
    HEAD_PACKET_CRC_BYTES = 4,
    HEAD_PACKET_MAX_SAMPLES = 34,
    HEAD_PACKET_MAX_BYTES = 512,
    HEAD_POSITION_FRACTION_BITS = 20, /* position = count * 2^20 + interpolated fraction */
    HEAD_ENCODER_COUNTS = 4096
};

/* Range unit: 2^-20 m, 0.95 um. */
#define HEAD_RANGE_LSB_M (1.0 / 1048576.0)
/* Largest range that the wire carries; the field is HEAD_RANGE_NONE where there is none. */
#define HEAD_RANGE_MAX_M 4095.0
#define HEAD_RANGE_NONE  0xffffffffu
/* Longest sample interval that the decoder believes: 1 s. */
#define HEAD_INTERVAL_MAX_NS 1000000000u

enum head_sample_flag {
    HEAD_SAMPLE_NO_RETURN = 1u << 0, /* the beam met nothing in range; no range */
    HEAD_SAMPLE_DROPPED =
        1u << 1, /* an echo, but nothing usable (too weak, overloaded); no range */
    HEAD_SAMPLE_SATURATED =
        1u << 2, /* the detector was near its limit; range is given, but biased */
    HEAD_SAMPLE_LASER_OFF = 1u << 3, /* nothing was sent, so nothing is known; no range */
    HEAD_SAMPLE_INDEX = 1u << 4      /* the encoder wrapped since the sample before */
};

enum head_packet_flag {
    HEAD_PACKET_RESET =
        1u << 0 /* first packet since the head started: counters and time begin anew */
};

enum head_status {
    HEAD_STATUS_LASER_ON = 1u << 0,
    HEAD_STATUS_MIRROR_LOCKED = 1u << 1, /* mirror speed within its limits */
    HEAD_STATUS_OVERRUN = 1u << 2        /* the head itself lost samples since the packet before */
};

struct head_sample {
    uint32_t position;  /* encoder: bits 31..20 count 0..4095, bits 19..0 fraction of a count */
    uint32_t range;     /* HEAD_RANGE_LSB_M, or HEAD_RANGE_NONE */
    uint16_t intensity; /* returned laser light, 65535 is full scale */
    uint16_t ambient;   /* background light subtracted, 65535 is full scale */
    uint8_t flags;      /* enum head_sample_flag */
    uint8_t seq8;       /* low 8 bits of the sample's sequence number */
};

struct head_packet {
    uint32_t packet_seq;       /* +1 a packet, wraps */
    uint32_t first_sample_seq; /* sequence number of samples[0], +1 a sample, wraps */
    int64_t head_t_ns;         /* head time, middle of the integration of samples[0] */
    uint32_t interval_ns;      /* from one sample to the next */
    uint32_t status;           /* enum head_status */
    uint8_t flags;             /* enum head_packet_flag */
    uint8_t sample_count;      /* 0..34 */
    struct head_sample samples[HEAD_PACKET_MAX_SAMPLES];
};

/* Encoder counts 0..4096 with fraction; wraps at one turn. */
static inline double head_position_counts(uint32_t position) {
    return (double)position / (double)(1u << HEAD_POSITION_FRACTION_BITS);
}
/* Nearest position for encoder counts of any size and sign (finite); whole turns are dropped. */
uint32_t head_position_from_counts(double counts);

/* Metres, or NaN for HEAD_RANGE_NONE. */
double head_range_m(uint32_t range);
/* Nearest wire value; HEAD_RANGE_NONE for NaN, negative or above HEAD_RANGE_MAX_M. */
uint32_t head_range_from_m(double range_m);

/* Bytes of a packet with that many samples. */
static inline size_t head_packet_bytes(unsigned sample_count) {
    return HEAD_PACKET_HEADER_BYTES + (size_t)sample_count * HEAD_PACKET_SAMPLE_BYTES +
           HEAD_PACKET_CRC_BYTES;
}

/* Writes the packet to out_bytes (room for HEAD_PACKET_MAX_BYTES) and its size. ST_INVALID if a
 * count, interval or time is outside the protocol. seq8 of the samples is written from
 * first_sample_seq. */
ST_MUST_CHECK enum st head_packet_encode(const struct head_packet *packet, uint8_t *out_bytes,
                                         size_t *out_size);

/* Decodes one packet at the start of bytes[0..size). ST_OK with the packet and its size; ST_TIMEOUT
 * if the bytes are the beginning of a packet and more must come; ST_FORMAT if they are no packet;
 * ST_DAMAGED if the frame fits but its CRC does not. Trusts nothing. */
ST_MUST_CHECK enum st head_packet_decode(const uint8_t *bytes, size_t size,
                                         struct head_packet *out_packet, size_t *out_size);

/* What a scan over a byte stream met besides good packets. */
struct head_stream_stats {
    uint64_t packets, bytes_skipped, damaged;
};

/* Finds the next good packet in bytes[*offset..size), skipping what is none, and moves *offset
 * behind it. ST_OK with the packet; ST_TIMEOUT when no further whole packet is there: *offset is
 * then where the unread rest begins (keep it and append). Linear time; stats are added to. */
ST_MUST_CHECK enum st head_stream_next(const uint8_t *bytes, size_t size, size_t *offset,
                                       struct head_packet *out_packet,
                                       struct head_stream_stats *stats);

#ifdef __cplusplus
}
#endif
#endif
