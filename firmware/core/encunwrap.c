#include "firmware/core/encunwrap.h"

void encunwrap_init(struct encunwrap *enc, uint16_t count) {
    enc->counts = 0;
    enc->last = count;
}

uint32_t encunwrap_update(struct encunwrap *enc, uint16_t count) {
    int32_t since = (int16_t)(uint16_t)(count - enc->last);
    enc->counts += (uint32_t)since;
    enc->last = count;
    return enc->counts;
}

uint16_t encunwrap_fraction(uint32_t since_edge_us, uint32_t period_us, uint16_t counts_per_rev) {
    if (!period_us)
        return 0;
    uint64_t fraction = (uint64_t)since_edge_us * counts_per_rev * 65536u / period_us;
    return fraction > UINT16_MAX ? UINT16_MAX : (uint16_t)fraction;
}
