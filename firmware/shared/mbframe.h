/* Modbus RTU frames: CRC-16, sealing and checking. Used by the slave, by the host's tests and
 * tools. */
#ifndef SC_SHARED_MBFRAME_H
#define SC_SHARED_MBFRAME_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define MBFRAME_MAX 256 /* bytes of the longest frame: address, 253 of PDU, CRC */
#define MBFRAME_MIN 4   /* address, function, CRC */

/* Modbus exception codes. */
enum mbexc {
    MBEXC_OK = 0, /* not on the wire */
    MBEXC_FUNCTION = 1,
    MBEXC_ADDRESS = 2,
    MBEXC_VALUE = 3,
    MBEXC_DEVICE = 4,
    MBEXC_BUSY = 6
};

/* CRC-16 of Modbus: reflected polynomial 0xA001, start 0xFFFF. On the wire the low byte goes first.
 * A table of 16 words, two look-ups a byte. */
uint16_t mbframe_crc(const uint8_t *bytes, unsigned count);

/* Appends the CRC to `count` bytes (count <= 254); returns count + 2. `frame` must have room for
 * them. */
unsigned mbframe_seal(uint8_t *frame, unsigned count);

/* True if the length is a frame's and the CRC fits. */
bool mbframe_ok(const uint8_t *frame, unsigned count);

static inline uint16_t mbframe_get16(const uint8_t *p) {
    return (uint16_t)((unsigned)p[0] << 8 | p[1]);
}
static inline void mbframe_put16(uint8_t *p, uint16_t value) {
    p[0] = (uint8_t)(value >> 8);
    p[1] = (uint8_t)(value & 0xffu);
}

/* The end-of-frame gap in microseconds that the serial line specification gives for a baud rate (11
 * bits a character): 3.5 characters, and 1750 us above 19 200 baud. */
uint32_t mbframe_gap_us(uint32_t baud);

#ifdef __cplusplus
}
#endif
#endif
