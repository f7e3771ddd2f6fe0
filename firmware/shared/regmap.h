/* Accessors of the register map, generated from regmap.def. Plain C11, no library calls: the same
 * source runs on the controller and on the host.
 *
 * Three views of the table:
 *  - `struct regmap_input`, `struct regmap_holding`: one typed member a register (the firmware's
 * storage, and what a host decodes a block into);
 *  - REGMAP_ADDR_<name>, REGMAP_WORDS_<name>, REGMAP_COIL_<name>, REGMAP_DISCRETE_<name>: numbers;
 *  - regmap_get_<name>(block, start), regmap_put_<name>(block, start, value): one value in a block
 * of words that starts at register address `start`; values are raw (see scale). */
#ifndef SC_SHARED_REGMAP_H
#define SC_SHARED_REGMAP_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Raised whenever a register changes place or meaning. */
#define REGMAP_VERSION 1

#define REGMAP_CTYPE_U16 uint16_t
#define REGMAP_CTYPE_I16 int16_t
#define REGMAP_CTYPE_U32 uint32_t
#define REGMAP_CTYPE_I32 int32_t
#define REGMAP_CTYPE_U64 uint64_t

enum regmap_type { REGMAP_U16, REGMAP_I16, REGMAP_U32, REGMAP_I32, REGMAP_U64 };
enum regmap_access { REGMAP_RO, REGMAP_CFG, REGMAP_CMD, REGMAP_COM };

/* 16-bit words that a type occupies. */
enum {
    REGMAP_SIZE_U16 = 1,
    REGMAP_SIZE_I16 = 1,
    REGMAP_SIZE_U32 = 2,
    REGMAP_SIZE_I32 = 2,
    REGMAP_SIZE_U64 = 4
};

enum regmap_address {
#define REG_INPUT(name, address, type, unit, scale, doc) REGMAP_ADDR_##name = (address),
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    REGMAP_ADDR_##name = (address),
#include "firmware/shared/regmap.def"
};

enum regmap_words {
#define REG_INPUT(name, address, type, unit, scale, doc) REGMAP_WORDS_##name = REGMAP_SIZE_##type,
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    REGMAP_WORDS_##name = REGMAP_SIZE_##type,
#include "firmware/shared/regmap.def"
};

enum regmap_coil {
#define REG_COIL(name, address, doc) REGMAP_COIL_##name = (address),
#include "firmware/shared/regmap.def"
    REGMAP_COIL_COUNT_
};

enum regmap_discrete {
#define REG_DISCRETE(name, address, doc) REGMAP_DISCRETE_##name = (address),
#include "firmware/shared/regmap.def"
    REGMAP_DISCRETE_COUNT_
};

/* Position of a register in its table (not its address). */
enum regmap_input_index {
#define REG_INPUT(name, address, type, unit, scale, doc) REGMAP_INPUT_##name,
#include "firmware/shared/regmap.def"
    REGMAP_INPUT_COUNT_
};
enum regmap_holding_index {
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    REGMAP_HOLDING_##name,
#include "firmware/shared/regmap.def"
    REGMAP_HOLDING_COUNT_
};

struct regmap_input {
#define REG_INPUT(name, address, type, unit, scale, doc) REGMAP_CTYPE_##type name;
#include "firmware/shared/regmap.def"
};

struct regmap_holding {
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    REGMAP_CTYPE_##type name;
#include "firmware/shared/regmap.def"
};

/* One row without its texts: what the firmware needs. */
struct regmap_entry {
    uint16_t address;
    uint16_t offset; /* of the member in struct regmap_input or regmap_holding */
    uint8_t type;    /* enum regmap_type */
    uint8_t access;  /* enum regmap_access */
    int64_t min, max;
};

/* In order of address. */
extern const struct regmap_entry regmap_inputs[REGMAP_INPUT_COUNT_];
extern const struct regmap_entry regmap_holdings[REGMAP_HOLDING_COUNT_];

/* Initial values of all holding registers. */
extern const struct regmap_holding regmap_holding_initial;

/* Words of a type, 1, 2 or 4. */
unsigned regmap_type_words(uint8_t type);

/* The row that holds `address` (any of its words), or NULL. `table` is regmap_inputs or
 * regmap_holdings, `rows` its length. O(log rows). */
const struct regmap_entry *regmap_find(const struct regmap_entry *table, unsigned rows,
                                       uint16_t address);

/* Writes words `start` .. `start + count - 1` of `values` (the struct that belongs to `table`) to
 * `out`. A block may begin or end inside a value. Returns false, and leaves `out` undefined, if an
 * address has no register. O(count log rows), no allocation. */
bool regmap_encode(const struct regmap_entry *table, unsigned rows, const void *values,
                   uint16_t start, unsigned count, uint16_t *out);

/* The reverse, for a host: stores every value that lies whole in the block; others keep what they
 * were. Words without a register are skipped. Returns how many values were stored. Ranges are not
 * checked. */
unsigned regmap_decode(const struct regmap_entry *table, unsigned rows, void *values,
                       uint16_t start, unsigned count, const uint16_t *words);

/* Value of one row in its struct, and the reverse; U64 is returned as its two's complement. */
int64_t regmap_value(const struct regmap_entry *entry, const void *values);
void regmap_set(const struct regmap_entry *entry, void *values, int64_t value);

/* Big-endian words of a block. */
static inline uint16_t regmap_load_U16(const uint16_t *w) {
    return w[0];
}
static inline int16_t regmap_load_I16(const uint16_t *w) {
    return (int16_t)w[0];
}
static inline uint32_t regmap_load_U32(const uint16_t *w) {
    return (uint32_t)w[0] << 16 | w[1];
}
static inline int32_t regmap_load_I32(const uint16_t *w) {
    return (int32_t)regmap_load_U32(w);
}
static inline uint64_t regmap_load_U64(const uint16_t *w) {
    return (uint64_t)regmap_load_U32(w) << 32 | regmap_load_U32(w + 2);
}
static inline void regmap_store_U16(uint16_t *w, uint16_t v) {
    w[0] = v;
}
static inline void regmap_store_I16(uint16_t *w, int16_t v) {
    w[0] = (uint16_t)v;
}
static inline void regmap_store_U32(uint16_t *w, uint32_t v) {
    w[0] = (uint16_t)(v >> 16);
    w[1] = (uint16_t)(v & 0xffffu);
}
static inline void regmap_store_I32(uint16_t *w, int32_t v) {
    regmap_store_U32(w, (uint32_t)v);
}
static inline void regmap_store_U64(uint16_t *w, uint64_t v) {
    regmap_store_U32(w, (uint32_t)(v >> 32));
    regmap_store_U32(w + 2, (uint32_t)(v & 0xffffffffu));
}

/* regmap_get_<name>, regmap_put_<name>: the block must hold the whole value. */
#define REG_INPUT(name, address, type, unit, scale, doc)                                           \
    static inline REGMAP_CTYPE_##type regmap_get_##name(const uint16_t *block, uint16_t start) {   \
        return regmap_load_##type(block + ((address)-start));                                      \
    }
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    REG_INPUT(name, address, type, unit, scale, doc)                                               \
    static inline void regmap_put_##name(uint16_t *block, uint16_t start,                          \
                                         REGMAP_CTYPE_##type value) {                              \
        regmap_store_##type(block + ((address)-start), value);                                     \
    }
#include "firmware/shared/regmap.def"

/* Texts of a row, host side only (regmap_text.c is not linked into images). */
struct regmap_text {
    const char *name, *type, *unit, *doc;
    double scale;
};
extern const struct regmap_text regmap_input_text[REGMAP_INPUT_COUNT_];
extern const struct regmap_text regmap_holding_text[REGMAP_HOLDING_COUNT_];
struct regmap_bit_text {
    uint16_t address;
    const char *name, *doc;
};
extern const struct regmap_bit_text regmap_coil_text[REGMAP_COIL_COUNT_];
extern const struct regmap_bit_text regmap_discrete_text[REGMAP_DISCRETE_COUNT_];

#ifdef __cplusplus
}
#endif
#endif
