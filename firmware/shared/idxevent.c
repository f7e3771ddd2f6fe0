#include "firmware/shared/idxevent.h"
#include "firmware/shared/regmap.h"

void idxevent_encode(const struct idxevent *event, uint16_t out_words[IDXEVENT_WORDS]) {
    regmap_store_U32(out_words, event->seq);
    regmap_store_U64(out_words + 2, event->time_us);
    regmap_store_U32(out_words + 6, event->revolution);
    regmap_store_I32(out_words + 8, event->pan_steps);
    regmap_store_I32(out_words + 10, event->tilt_steps);
    out_words[12] = event->pan_phase;
    out_words[13] = event->flags;
}

struct idxevent idxevent_decode(const uint16_t words[IDXEVENT_WORDS]) {
    return (struct idxevent){.seq = regmap_load_U32(words),
                             .time_us = regmap_load_U64(words + 2),
                             .revolution = regmap_load_U32(words + 6),
                             .pan_steps = regmap_load_I32(words + 8),
                             .tilt_steps = regmap_load_I32(words + 10),
                             .pan_phase = words[12],
                             .flags = words[13]};
}
