/* The event record: what the controller logs at each mirror index pulse and each camera strobe, and
 * how it lies in the event window of the register map. */
#ifndef SC_SHARED_IDXEVENT_H
#define SC_SHARED_IDXEVENT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define IDXEVENT_WORDS       14 /* 16-bit words of a record */
#define IDXEVENT_WINDOW      8  /* records in the event window */
#define IDXEVENT_WINDOW_ADDR 0x0100
#define IDXEVENT_HEADER      8 /* words before the first record */
#define IDXEVENT_FIRST_ADDR  (IDXEVENT_WINDOW_ADDR + IDXEVENT_HEADER)
/* One read of the whole window: 120 words, within Modbus' limit of 125. */
#define IDXEVENT_WINDOW_WORDS (IDXEVENT_HEADER + IDXEVENT_WINDOW * IDXEVENT_WORDS)

enum idxevent_flag {
    IDXEVENT_KIND = 0x000f, /* mask of enum idxevent_kind */
    IDXEVENT_PAN_MOVING = 1 << 4,
    IDXEVENT_TILT_MOVING = 1 << 5,
    IDXEVENT_PAN_HOMED = 1 << 6,
    IDXEVENT_TILT_HOMED = 1 << 7,
    IDXEVENT_PAN_POSITIVE = 1 << 8, /* direction of the pan's last step */
    IDXEVENT_PAN_TAKEN_UP = 1 << 9, /* backlash taken up in that direction */
    IDXEVENT_LASER = 1 << 10,       /* laser was on */
    IDXEVENT_SWEEP = 1 << 11,       /* belongs to a scan's sweep */
    IDXEVENT_MIRROR_OK = 1 << 12,   /* mirror was in its speed range */
    IDXEVENT_AFTER_MISSED =
        1 << 13,               /* the encoder says that index pulses were missed before this one */
    IDXEVENT_OVERRUN = 1 << 14 /* step mode: the pan step of the last revolution had not finished */
};

enum idxevent_kind { IDXEVENT_NONE = 0, IDXEVENT_INDEX = 1, IDXEVENT_STROBE = 2 };

/* Words: 0 seq (2), 2 time_us (4), 6 revolution (2), 8 pan_steps (2), 10 tilt_steps (2), 12
 * pan_phase, 13 flags. */
struct idxevent {
    uint32_t seq;     /* counts all events since reset from 0, with no gap */
    uint64_t time_us; /* hardware capture, controller time */
    uint32_t
        revolution; /* index pulses since reset, this one included; missed ones are counted in */
    int32_t pan_steps;
    int32_t tilt_steps;
    uint16_t pan_phase; /* part of the pan's way to its next step, 1/65536; 0 when it stands */
    uint16_t flags;     /* enum idxevent_flag */
};

/* To and from the 14 words of a record. */
void idxevent_encode(const struct idxevent *event, uint16_t out_words[IDXEVENT_WORDS]);
struct idxevent idxevent_decode(const uint16_t words[IDXEVENT_WORDS]);

#ifdef __cplusplus
}
#endif
#endif
