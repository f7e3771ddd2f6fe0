#include "firmware/core/timebase.h"
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_time.h"

uint64_t timebase_extend(const struct firmware *fw, uint32_t captured_us) {
    int32_t since = (int32_t)(captured_us - (uint32_t)fw->time_us);
    return fw->time_us + (uint64_t)(int64_t)since;
}

uint64_t timebase_now(struct firmware *fw) {
    fw->time_us = timebase_extend(fw, hal_time_now());
    return fw->time_us;
}
