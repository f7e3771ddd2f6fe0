/* The plant of the emulated board: mirror with inertia, index and encoder, pan and tilt with their
 * switches, camera, safety chains. QEMU has no quadrature, PWM or GPIO, so this model stands where
 * the cart would be wired. It is the board's, no part of the firmware's behaviour.
 *
 * Integer only, no registers, no time of its own: plant_run is told the time and makes up for what
 * has passed since, so a late call loses no index pulse and shifts none. */
#ifndef SC_PORT_MPS2_PLANT_H
#define SC_PORT_MPS2_PLANT_H

#include "firmware/hal/hal_axis.h"
#include "firmware/hal/hal_safety.h"
#include <stdbool.h>
#include <stdint.h>

#define PLANT_STEP_US 500u /* the mirror's speed is constant in between */

struct plant {
    uint64_t now_us; /* the model stands here */
    /* mirror: angle and speed in 2^-40 revolutions and 2^-40 revolutions per us */
    uint64_t turn;
    uint32_t speed;
    uint16_t drive; /* 0.01 % */
    bool blocked;   /* the mirror stands, whatever the drive does */
    bool motors, laser;
    int32_t position[HAL_AXES]; /* steps from the mechanical zero */
    bool positive[HAL_AXES];
    uint32_t closed;     /* chains: bits of enum hal_input */
    uint32_t forced;     /* limit switches closed by hand: bits of enum hal_input */
    int16_t temperature; /* 0.1 C */
    uint64_t strobe_us;  /* 0: none on its way */
};

/* What happened, in order of time; told by plant_run. */
struct plant_events {
    void (*index)(uint64_t t_us, uint16_t encoder_count);
    void (*strobe)(uint64_t t_us);
};

/* Chains closed, 25.0 C, mirror at rest, axes a little off their home switches, at time now_us. */
void plant_init(struct plant *plant, uint64_t now_us);

/* Moves the model on to now_us. O(time passed / 500 us). */
void plant_run(struct plant *plant, uint64_t now_us, const struct plant_events *events);

/* Time of the next event if nothing is commanded, at most now + 500 us: when to call plant_run. */
uint64_t plant_due_us(const struct plant *plant);

/* Free-running encoder counter at time t_us >= plant->now_us, at most 500 us later. 4096 counts a
 * revolution. */
uint16_t plant_encoder(const struct plant *plant, uint64_t t_us);

/* The controller's outputs. Steps without motor power are lost, as on the cart. */
void plant_step(struct plant *plant, enum hal_axis axis);
void plant_direction(struct plant *plant, enum hal_axis axis, bool positive);
void plant_trigger(struct plant *plant, uint64_t now_us);

/* All inputs, enum hal_input. */
uint32_t plant_inputs(const struct plant *plant);

/* What a bench technician would do to the cart, one letter each (upper case undoes it):
 * e emergency stop, i interlock, d door, l pan limit switch closes, t 80 C, b mirror blocked.
 * False if the letter means nothing. */
bool plant_console(struct plant *plant, char letter);

#endif
