#include "firmware/shared/mbframe.h"

/* CRC of one nibble: reflected polynomial 0xA001. */
static const uint16_t crc_nibble[16] = {0x0000, 0xcc01, 0xd801, 0x1400, 0xf001, 0x3c00,
                                        0x2800, 0xe401, 0xa001, 0x6c00, 0x7800, 0xb401,
                                        0x5000, 0x9c01, 0x8801, 0x4400};

uint16_t mbframe_crc(const uint8_t *bytes, unsigned count) {
    unsigned crc = 0xffff;
    for (unsigned i = 0; i < count; i++) {
        crc ^= bytes[i];
        crc = crc >> 4 ^ crc_nibble[crc & 15u];
        crc = crc >> 4 ^ crc_nibble[crc & 15u];
    }
    return (uint16_t)crc;
}

unsigned mbframe_seal(uint8_t *frame, unsigned count) {
    uint16_t crc = mbframe_crc(frame, count);
    frame[count] = (uint8_t)(crc & 0xffu);
    frame[count + 1] = (uint8_t)(crc >> 8);
    return count + 2;
}

bool mbframe_ok(const uint8_t *frame, unsigned count) {
    if (count < MBFRAME_MIN || count > MBFRAME_MAX)
        return false;
    uint16_t crc = mbframe_crc(frame, count - 2);
    return frame[count - 2] == (crc & 0xffu) && frame[count - 1] == crc >> 8;
}

uint32_t mbframe_gap_us(uint32_t baud) {
    if (!baud || baud > 19200)
        return 1750;
    return 38500000u / baud + 1; /* 3.5 * 11 bits */
}
