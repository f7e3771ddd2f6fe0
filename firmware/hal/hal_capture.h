/* The mirror's encoder and the camera. Edges are counted and stamped by timer hardware. */
#ifndef SC_HAL_CAPTURE_H
#define SC_HAL_CAPTURE_H

#include <stdbool.h>
#include <stdint.h>

/* Counter and the times that go with it, taken together. */
struct hal_encoder {
    uint16_t count;  /* free-running 16-bit counter, counts up with the mirror's forward rotation */
    uint32_t now_us; /* when `count` was read */
    uint32_t
        edge_us; /* when `count` was reached (last edge); equal to now_us if the port cannot say */
};

/* Any core context. Budget 2 us. On a board without HAL_CAP_ENCODER count stays 0. */
struct hal_encoder hal_capture_encoder(void);

/* Starts a trigger pulse of `length_us` (10 to 50000) on the camera's trigger line; returns at
 * once. The camera answers with a strobe edge, stamped by hardware and passed to
 * firmware_isr_strobe. A pulse that still lasts is prolonged. Any core context. Budget 1 us. */
void hal_capture_trigger(uint16_t length_us);

#endif
