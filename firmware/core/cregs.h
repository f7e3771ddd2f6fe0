/* The controller behind its register map: reads take a consistent picture of the firmware's state,
 * writes are checked whole, then applied whole. This is the model that mbslave calls. */
#ifndef SC_CORE_CREGS_H
#define SC_CORE_CREGS_H

#include "firmware/core/mbslave.h"
#include "firmware/shared/regmap.h"

struct firmware;

/* The mbslave model; ctx is the struct firmware. */
extern const struct mbslave_model cregs_model;

/* Start: holding registers to their initial and stored values, and these to all modules. */
void cregs_init(struct firmware *fw);

/* Fills the picture of all input registers at this instant (one interrupt lock, 5 us). Main loop.
 */
void cregs_picture(struct firmware *fw, struct regmap_input *out_picture);

#endif
