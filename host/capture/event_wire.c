#include "capture/event_wire.h"

#include "firmware/shared/idxevent.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

static const struct {
    unsigned host, wire;
} flag_pairs[] = {{INDEX_EVENT_PAN_MOVING, IDXEVENT_PAN_MOVING},
                  {INDEX_EVENT_TILT_MOVING, IDXEVENT_TILT_MOVING},
                  {INDEX_EVENT_PAN_HOMED, IDXEVENT_PAN_HOMED},
                  {INDEX_EVENT_TILT_HOMED, IDXEVENT_TILT_HOMED},
                  {INDEX_EVENT_PAN_POSITIVE, IDXEVENT_PAN_POSITIVE},
                  {INDEX_EVENT_PAN_TAKEN_UP, IDXEVENT_PAN_TAKEN_UP},
                  {INDEX_EVENT_LASER, IDXEVENT_LASER},
                  {INDEX_EVENT_SWEEP, IDXEVENT_SWEEP},
                  {INDEX_EVENT_MIRROR_OK, IDXEVENT_MIRROR_OK},
                  {INDEX_EVENT_AFTER_MISSED, IDXEVENT_AFTER_MISSED},
                  {INDEX_EVENT_OVERRUN, IDXEVENT_OVERRUN}};
enum { FLAG_PAIRS = sizeof flag_pairs / sizeof flag_pairs[0] };

_Static_assert(EVENT_WIRE_BYTES == 2 * IDXEVENT_WORDS, "the window's record");

void event_wire_encode(const struct index_event *event, uint8_t out_bytes[EVENT_WIRE_BYTES]) {
    const struct index_event *e = event;
    bool positive = (e->flags & INDEX_EVENT_PAN_POSITIVE) != 0;
    double whole = positive ? floor(e->pan_steps) : ceil(e->pan_steps);
    unsigned flags = e->kind & IDXEVENT_KIND;
    for (size_t i = 0; i < FLAG_PAIRS; i++)
        flags |= e->flags & flag_pairs[i].host ? flag_pairs[i].wire : 0u;
    struct idxevent wire = {.seq = (uint32_t)e->seq,
                            .time_us = (uint64_t)(e->t_ns / 1000),
                            .revolution = (uint32_t)e->revolution,
                            .pan_steps = (int32_t)whole,
                            .tilt_steps = e->tilt_steps,
                            .pan_phase = (uint16_t)lrint(fabs(e->pan_steps - whole) * 65536),
                            .flags = (uint16_t)flags};
    uint16_t words[IDXEVENT_WORDS];
    idxevent_encode(&wire, words);
    for (int i = 0; i < IDXEVENT_WORDS; i++) {
        out_bytes[2 * i] = (uint8_t)(words[i] >> 8);
        out_bytes[2 * i + 1] = (uint8_t)words[i];
    }
}

struct index_event event_wire_decode(const uint8_t bytes[EVENT_WIRE_BYTES]) {
    uint16_t words[IDXEVENT_WORDS];
    for (int i = 0; i < IDXEVENT_WORDS; i++)
        words[i] = (uint16_t)(bytes[2 * i] << 8 | bytes[2 * i + 1]);
    struct idxevent wire = idxevent_decode(words);
    unsigned flags = 0;
    for (size_t i = 0; i < FLAG_PAIRS; i++)
        flags |= wire.flags & flag_pairs[i].wire ? flag_pairs[i].host : 0u;
    double part = wire.pan_phase / 65536.0;
    return (struct index_event){.seq = wire.seq,
                                .t_ns = (int64_t)(wire.time_us * 1000),
                                .revolution = wire.revolution,
                                .pan_steps = wire.pan_steps +
                                             (wire.flags & IDXEVENT_PAN_POSITIVE ? part : -part),
                                .tilt_steps = wire.tilt_steps,
                                .kind = (uint16_t)(wire.flags & IDXEVENT_KIND),
                                .flags = (uint16_t)flags};
}
