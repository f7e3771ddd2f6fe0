/* The motor ops on top of reads and writes of the controller's registers: what every backend that
 * speaks the register map shares. */
#ifndef SC_DEVICE_MOTOR_MAP_H
#define SC_DEVICE_MOTOR_MAP_H

#include "device/motor.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One request to the controller. Returns 0, a Modbus exception code (positive), or a negative enum
 * st with `err` filled. `repeat`: may be sent again if no answer comes, because twice is the same
 * as once. */
struct motor_line {
    void *ctx;
    int (*read)(void *ctx, uint16_t start, unsigned count, uint16_t *out_words, struct errctx *err);
    int (*read_discrete)(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits,
                         struct errctx *err);
    int (*write)(void *ctx, uint16_t start, unsigned count, const uint16_t *words, bool repeat,
                 struct errctx *err);
    int (*write_coil)(void *ctx, uint16_t coil, bool on, bool repeat, struct errctx *err);
    /* Writes, then reads, in one request (function 23). Always repeatable. */
    int (*write_read)(void *ctx, uint16_t write_start, unsigned write_count, const uint16_t *words,
                      uint16_t read_start, unsigned read_count, uint16_t *out_words,
                      struct errctx *err);
    void (*close)(void *ctx);
    /* Host time of answers; NULL: the host's own clock. */
    int64_t (*now_ns)(void *ctx);
};

/* A motor over a line, on the heap. Takes the line over: closing the motor closes it, and a failure
 * here does so too. ST_NOMEM. */
ST_MUST_CHECK enum st motor_map_open(const struct motor_line *line, unsigned block_ms,
                                     struct motor **out_motor, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
