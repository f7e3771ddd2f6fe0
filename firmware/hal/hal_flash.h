/* Non-volatile storage of the commissioning values: one small record. */
#ifndef SC_HAL_FLASH_H
#define SC_HAL_FLASH_H

#include <stdbool.h>
#include <stdint.h>

/* Bytes that a port must be able to keep. */
#define HAL_FLASH_SIZE 256u

/* Copies the first `count` bytes of the record (count <= HAL_FLASH_SIZE); erased bytes read 0xff.
 * Main loop, at start-up. Budget 100 us. */
void hal_flash_read(uint8_t *out_bytes, unsigned count);

/* Replaces the record. Blocks up to 1 s (sector erase); the core calls it only with motors and
 * laser off, and the safety tick may be late meanwhile. A port with two sectors writes the other
 * one first, so that a power cut leaves the old or the new record. False if the read-back differs.
 * Main loop. */
bool hal_flash_write(const uint8_t *bytes, unsigned count);

#endif
