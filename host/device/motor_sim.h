/* The motor ops against the controller's own firmware on its simulated port, without a serial line:
 * the requests are the same frames, time is virtual and passes only in a request or by
 * sim_advance(). */
#ifndef SC_DEVICE_MOTOR_SIM_H
#define SC_DEVICE_MOTOR_SIM_H

#include "device/motor.h"
#include "device/motor_map.h"

#ifdef __cplusplus
extern "C" {
#endif

struct sim;

/* A motor on a simulation, which it does not own: it must outlive the motor and may be advanced and
 * disturbed between calls. ST_NOMEM. */
ST_MUST_CHECK enum st motor_sim_open(struct sim *sim, struct motor **out_motor, struct errctx *err);

/* The same as a line, for those who want to stand between (a twin that moves on with every
 * request). timeout_us: silence after which a request is given up or, if it may be, repeated: three
 * times in all. */
struct motor_sim_line {
    struct sim *sim;
    uint64_t timeout_us;
};
struct motor_line motor_sim_line(struct motor_sim_line *line); /* ctx: `line`, the caller's */

#ifdef __cplusplus
}
#endif
#endif
