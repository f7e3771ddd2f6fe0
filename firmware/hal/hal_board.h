/* What the board is, and where the firmware's state lives. */
#ifndef SC_HAL_BOARD_H
#define SC_HAL_BOARD_H

#include <stdint.h>

struct firmware;

enum hal_board_cap {
    HAL_CAP_ENCODER =
        1 << 0, /* encoder counter present: the mirror is also watched between index pulses */
    HAL_CAP_LASER_CURRENT = 1 << 1, /* HAL_IN_LASER_CURRENT is wired */
    HAL_CAP_CLOCK_LAX =
        1 << 2 /* the time base is emulated: tick intervals are recorded, not a fault */
};

/* Constants of a board; const for the life of the program. */
struct hal_board {
    const char *name;      /* "cart_f405" */
    uint16_t board_id;     /* 1 cart_f405, 2 qemu_mps2, 3 sim */
    uint32_t serial;       /* 0 unknown */
    uint32_t build_id;     /* first 32 bits of the source revision, 0 unknown */
    uint32_t baud;         /* of the Modbus line */
    uint32_t frame_gap_us; /* silence that ends a frame: mbframe_gap_us(baud) on hardware, 4 to 10
                              ms emulated */
    uint16_t caps;         /* enum hal_board_cap */
    uint16_t stack_min;    /* bytes of free stack below which FAULT_STACK trips */
    uint16_t reset_cause;  /* enum resetcause, of this start */
};

/* Any context. */
const struct hal_board *hal_board(void);

/* The firmware's whole state (core/firmware.h): a static object of the port on a chip, the current
 * instance in the simulator. Any context. */
struct firmware *hal_firmware(void);

#endif
