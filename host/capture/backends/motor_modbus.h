/* The controller over a serial line, Modbus RTU by libmodbus: time-outs, repetitions and recovery
 * are this file's own and bounded; libmodbus' own recovery is off. */
#ifndef SC_CAPTURE_MOTOR_MODBUS_H
#define SC_CAPTURE_MOTOR_MODBUS_H

#include "device/motor.h"

#ifdef __cplusplus
extern "C" {
#endif

struct motor_modbus_config {
    const char *device; /* "/dev/scancart-controller" */
    unsigned baud;
    char parity;   /* 'N', 'E', 'O' */
    unsigned unit; /* Modbus address, 1 to 247 */
    unsigned
        timeout_ms; /* for an answer; at least 200: the first one through a USB converter is late */
    unsigned retries; /* of requests that may be repeated */
};

/* 115 200 baud, even parity, unit 1, 1000 ms, 2 repetitions; device NULL. */
struct motor_modbus_config motor_modbus_default(void);

/* Opens the line and locks it against other programs (advisory). Says nothing on the line yet:
 * identify does. ST_NOT_FOUND no such device; ST_PERMISSION; ST_BUSY another program holds it;
 * ST_INVALID a configuration that makes no sense; ST_IO, ST_NOMEM. The texts say what to do. */
ST_MUST_CHECK enum st motor_modbus_open(const struct motor_modbus_config *config,
                                        struct motor **out_motor, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
