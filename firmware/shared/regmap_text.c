/* Names and texts of the register map: host side, never linked into an image. */
#include "firmware/shared/regmap.h"

const struct regmap_text regmap_input_text[REGMAP_INPUT_COUNT_] = {
#define REG_INPUT(name, address, type, unit, scale, doc) {#name, #type, unit, doc, scale},
#include "firmware/shared/regmap.def"
};

const struct regmap_text regmap_holding_text[REGMAP_HOLDING_COUNT_] = {
#define REG_HOLDING(name, address, type, unit, scale, access, min, max, initial, doc)              \
    {#name, #type, unit, doc, scale},
#include "firmware/shared/regmap.def"
};

const struct regmap_bit_text regmap_coil_text[REGMAP_COIL_COUNT_] = {
#define REG_COIL(name, address, doc) {(address), #name, doc},
#include "firmware/shared/regmap.def"
};

const struct regmap_bit_text regmap_discrete_text[REGMAP_DISCRETE_COUNT_] = {
#define REG_DISCRETE(name, address, doc) {(address), #name, doc},
#include "firmware/shared/regmap.def"
};
