#include "firmware/shared/regmap.h"
#include <stddef.h>

const struct regmap_entry regmap_inputs[REGMAP_INPUT_COUNT_] = {
#define REG_INPUT(name, address, type, unit, scale, doc)                                           \
    {(address), offsetof(struct regmap_input, name), REGMAP_##type, REGMAP_RO, 0, 0},
#include "firmware/shared/regmap.def"
};

const struct regmap_entry regmap_holdings[REGMAP_HOLDING_COUNT_] = {
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    {(address), offsetof(struct regmap_holding, name), REGMAP_##type, REGMAP_##access, (min),      \
     (max)},
#include "firmware/shared/regmap.def"
};

const struct regmap_holding regmap_holding_initial = {
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    .name = (initial),
#include "firmware/shared/regmap.def"
};

unsigned regmap_type_words(uint8_t type) {
    if (type == REGMAP_U64)
        return 4;
    return type == REGMAP_U32 || type == REGMAP_I32 ? 2 : 1;
}

const struct regmap_entry *regmap_find(const struct regmap_entry *table, unsigned rows,
                                       uint16_t address) {
    unsigned low = 0, high = rows; /* the last row at or below the address is in [low - 1, high) */
    while (low < high) {
        unsigned middle = (low + high) / 2;
        if (table[middle].address <= address)
            low = middle + 1;
        else
            high = middle;
    }
    if (!low)
        return NULL;
    const struct regmap_entry *entry = &table[low - 1];
    return address - entry->address < (int)regmap_type_words(entry->type) ? entry : NULL;
}

/* Members are read and written by their own type: no aliasing, no alignment assumed. */
int64_t regmap_value(const struct regmap_entry *entry, const void *values) {
    const unsigned char *member = (const unsigned char *)values + entry->offset;
    switch (entry->type) {
    case REGMAP_U16:
        return *(const uint16_t *)(const void *)member;
    case REGMAP_I16:
        return *(const int16_t *)(const void *)member;
    case REGMAP_U32:
        return *(const uint32_t *)(const void *)member;
    case REGMAP_I32:
        return *(const int32_t *)(const void *)member;
    default:
        return (int64_t) * (const uint64_t *)(const void *)member;
    }
}

void regmap_set(const struct regmap_entry *entry, void *values, int64_t value) {
    unsigned char *member = (unsigned char *)values + entry->offset;
    switch (entry->type) {
    case REGMAP_U16:
        *(uint16_t *)(void *)member = (uint16_t)value;
        break;
    case REGMAP_I16:
        *(int16_t *)(void *)member = (int16_t)value;
        break;
    case REGMAP_U32:
        *(uint32_t *)(void *)member = (uint32_t)value;
        break;
    case REGMAP_I32:
        *(int32_t *)(void *)member = (int32_t)value;
        break;
    default:
        *(uint64_t *)(void *)member = (uint64_t)value;
        break;
    }
}

bool regmap_encode(const struct regmap_entry *table, unsigned rows, const void *values,
                   uint16_t start, unsigned count, uint16_t *out) {
    if ((uint32_t)start + count > 0x10000u)
        return false;
    unsigned done = 0;
    while (done < count) {
        uint16_t address = (uint16_t)(start + done);
        const struct regmap_entry *entry = regmap_find(table, rows, address);
        if (!entry)
            return false;
        unsigned words = regmap_type_words(entry->type);
        uint64_t value = (uint64_t)regmap_value(entry, values);
        for (unsigned i = (unsigned)(address - entry->address); i < words && done < count; i++)
            out[done++] = (uint16_t)(value >> 16 * (words - 1 - i) & 0xffffu);
    }
    return true;
}

static int64_t load(uint8_t type, const uint16_t *words) {
    switch (type) {
    case REGMAP_U16:
        return words[0];
    case REGMAP_I16:
        return (int16_t)words[0];
    case REGMAP_U32:
        return regmap_load_U32(words);
    case REGMAP_I32:
        return regmap_load_I32(words);
    default:
        return (int64_t)regmap_load_U64(words);
    }
}

unsigned regmap_decode(const struct regmap_entry *table, unsigned rows, void *values,
                       uint16_t start, unsigned count, const uint16_t *words) {
    unsigned stored = 0;
    for (unsigned row = 0; row < rows; row++) {
        const struct regmap_entry *entry = &table[row];
        unsigned size = regmap_type_words(entry->type);
        if (entry->address < start || entry->address + size > (uint32_t)start + count)
            continue;
        regmap_set(entry, values, load(entry->type, words + (entry->address - start)));
        stored++;
    }
    return stored;
}
