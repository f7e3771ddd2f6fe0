#include "firmware/core/commission.h"
#include "firmware/hal/hal_flash.h"

/* Record: magic (4), version (2), words (2), the words big-endian, CRC-32 of all before (4,
 * big-endian). */
#define MAGIC  0x53434152u /* "SCAR" */
#define HEADER 8u

/* Words of all commissioning values; commission_save itself is not stored. */
enum {
    STORED_WORDS = 0
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    +(REGMAP_##access == REGMAP_COM ? REGMAP_SIZE_##type : 0)
#include "firmware/shared/regmap.def"
                   - 1
};
#define RECORD (HEADER + 2u * STORED_WORDS + 4u)
_Static_assert(RECORD <= HAL_FLASH_SIZE, "the record must fit what every port keeps");

uint32_t commission_crc32(const uint8_t *bytes, unsigned count) {
    uint32_t crc = 0xffffffffu;
    for (unsigned i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 1u ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    }
    return ~crc;
}

static bool is_stored(const struct regmap_entry *entry) {
    return entry->access == REGMAP_COM && entry->address != REGMAP_ADDR_commission_save;
}

static void put16(uint8_t *bytes, uint32_t value) {
    bytes[0] = (uint8_t)(value >> 8 & 0xffu);
    bytes[1] = (uint8_t)(value & 0xffu);
}

static void put32(uint8_t *bytes, uint32_t value) {
    put16(bytes, value >> 16);
    put16(bytes + 2, value & 0xffffu);
}

static uint32_t get16(const uint8_t *bytes) {
    return (uint32_t)bytes[0] << 8 | bytes[1];
}

static uint32_t get32(const uint8_t *bytes) {
    return get16(bytes) << 16 | get16(bytes + 2);
}

/* The record of `holding`: values in order of the table, each in its own size. */
static void build(const struct regmap_holding *holding, uint8_t out_record[RECORD]) {
    unsigned at = HEADER;
    for (unsigned row = 0; row < REGMAP_HOLDING_COUNT_; row++) {
        const struct regmap_entry *entry = &regmap_holdings[row];
        if (!is_stored(entry))
            continue;
        uint32_t value = (uint32_t)regmap_value(entry, holding);
        if (regmap_type_words(entry->type) == 2) {
            put16(out_record + at, value >> 16);
            at += 2;
        }
        put16(out_record + at, value & 0xffffu);
        at += 2;
    }
    put32(out_record, MAGIC);
    put16(out_record + 4, REGMAP_VERSION);
    put16(out_record + 6, (at - HEADER) / 2);
    put32(out_record + at, commission_crc32(out_record, at));
}

/* The value at `*at`, sign-extended by its type. */
static int64_t take(uint8_t type, const uint8_t *record, unsigned *at) {
    unsigned words = regmap_type_words(type);
    uint32_t value = words == 2 ? get32(record + *at) : get16(record + *at);
    *at += 2 * words;
    if (type == REGMAP_I16)
        return (int16_t)(uint16_t)value;
    return type == REGMAP_I32 ? (int64_t)(int32_t)value : (int64_t)value;
}

enum commission_state commission_load(struct regmap_holding *holding) {
    uint8_t record[RECORD], expected[RECORD];
    build(holding, expected); /* for its header */
    hal_flash_read(record, RECORD);
    bool erased = true;
    for (unsigned i = 0; i < RECORD; i++)
        erased = erased && record[i] == 0xff;
    if (erased)
        return COMMISSION_DEFAULTS;
    for (unsigned i = 0; i < HEADER; i++)
        if (record[i] != expected[i])
            return COMMISSION_DAMAGED;
    if (get32(record + RECORD - 4) != commission_crc32(record, RECORD - 4))
        return COMMISSION_DAMAGED;
    struct regmap_holding loaded = *holding;
    unsigned at = HEADER;
    for (unsigned row = 0; row < REGMAP_HOLDING_COUNT_; row++) {
        const struct regmap_entry *entry = &regmap_holdings[row];
        if (!is_stored(entry))
            continue;
        int64_t value = take(entry->type, record, &at);
        if (value < entry->min || value > entry->max)
            return COMMISSION_DAMAGED;
        regmap_set(entry, &loaded, value);
    }
    *holding = loaded;
    return COMMISSION_VALID;
}

bool commission_save(const struct regmap_holding *holding) {
    uint8_t record[RECORD];
    build(holding, record);
    return hal_flash_write(record, RECORD);
}
