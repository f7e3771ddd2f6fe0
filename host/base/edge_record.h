/* A line edge as stored in a site's "gpio" stream, format "gpio_edge.1": 16 bytes, little-endian.
 * Inline, no allocation, safe on the real-time path. */
#ifndef SC_BASE_EDGE_RECORD_H
#define SC_BASE_EDGE_RECORD_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { EDGE_RECORD_BYTES = 16 };

enum edge_record_line {
    EDGE_RECORD_INDEX = 0,  /* mirror index pulse */
    EDGE_RECORD_STROBE = 1, /* camera exposes */
    EDGE_RECORD_ESTOP = 2,  /* emergency stop chain */
    EDGE_RECORD_INTERLOCK = 3
};

/* At 0 i64 t_ns, 8 u32 seq, 12 u8 line, 13 u8 rising, 14 u16 0. */
struct edge_record {
    int64_t t_ns; /* host monotonic, of the edge */
    uint32_t seq; /* counts the edges of that line from 0, as far as the system tells */
    uint8_t line; /* enum edge_record_line */
    uint8_t rising;
};

static inline void edge_record_encode(const struct edge_record *record,
                                      uint8_t out_bytes[EDGE_RECORD_BYTES]) {
    for (int i = 0; i < 8; i++)
        out_bytes[i] = (uint8_t)((uint64_t)record->t_ns >> (8 * i));
    for (int i = 0; i < 4; i++)
        out_bytes[8 + i] = (uint8_t)(record->seq >> (8 * i));
    out_bytes[12] = record->line;
    out_bytes[13] = record->rising;
    out_bytes[14] = out_bytes[15] = 0;
}

static inline struct edge_record edge_record_decode(const uint8_t bytes[EDGE_RECORD_BYTES]) {
    uint64_t t = 0;
    uint32_t seq = 0;
    for (int i = 7; i >= 0; i--)
        t = t << 8 | bytes[i];
    for (int i = 11; i >= 8; i--)
        seq = seq << 8 | bytes[i];
    struct edge_record record = {(int64_t)t, seq, bytes[12], bytes[13]};
    return record;
}

#ifdef __cplusplus
}
#endif
#endif
