/* 64-bit microseconds since reset out of hal_time_now, which wraps after 71 minutes. */
#ifndef SC_CORE_TIMEBASE_H
#define SC_CORE_TIMEBASE_H

#include <stdint.h>

struct firmware;

/* Time now. Must be called at least every 35 minutes, which the safety tick does. Interrupts, or
 * under the interrupt lock. */
uint64_t timebase_now(struct firmware *fw);

/* A captured time, at most 35 minutes before or after the last timebase_now, in 64 bits. Context as
 * timebase_now. */
uint64_t timebase_extend(const struct firmware *fw, uint32_t captured_us);

#endif
