/* Commissioning values in flash: magic, length, map version, the COM registers in order, CRC-32. */
#ifndef SC_CORE_COMMISSION_H
#define SC_CORE_COMMISSION_H

#include "firmware/shared/regmap.h"

enum commission_state {
    COMMISSION_DEFAULTS = 0, /* flash erased */
    COMMISSION_VALID = 1,
    COMMISSION_DAMAGED = 2, /* defaults used */
    COMMISSION_CHANGED = 3  /* written since, not saved */
};

/* Loads the stored values into `holding` (values out of range count as damage; then nothing is
 * changed). */
enum commission_state commission_load(struct regmap_holding *holding);

/* Stores them and reads them back. Blocks up to 1 s: only with motors and laser off. */
bool commission_save(const struct regmap_holding *holding);

/* CRC-32 (reflected 0xEDB88320), bitwise: this runs on 200 bytes once. */
uint32_t commission_crc32(const uint8_t *bytes, unsigned count);

#endif
