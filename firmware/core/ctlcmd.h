/* What a write to the map does: whether each command may be obeyed now, and obeying it. core/cregs
 * checks all of a request with these before it applies any of it. All are called from the main loop
 * and take the interrupt lock themselves. */
#ifndef SC_CORE_CTLCMD_H
#define SC_CORE_CTLCMD_H

#include "firmware/shared/faultcode.h"
#include "firmware/shared/mbframe.h"
#include "firmware/shared/regmap.h"

struct firmware;

/* The Modbus exception that tells of a refusal: 04 device failure, 06 busy, 03 value. */
enum mbexc ctlcmd_exception(enum refusal refusal);

/* May row `row` of regmap_holdings take its value of `wanted`? Ranges have been checked. */
enum refusal ctlcmd_check_register(struct firmware *fw, unsigned row,
                                   const struct regmap_holding *wanted);

/* Takes over rows first .. first + n - 1 of `wanted` and does what they command. Only a flash write
 * can still fail. */
enum refusal ctlcmd_apply_registers(struct firmware *fw, unsigned first, unsigned n,
                                    const struct regmap_holding *wanted);

enum refusal ctlcmd_check_coil(struct firmware *fw, unsigned coil, bool on);
void ctlcmd_apply_coil(struct firmware *fw, unsigned coil, bool on);

/* Gives the modules the settings in fw->holding. */
void ctlcmd_use_settings(struct firmware *fw);

#endif
