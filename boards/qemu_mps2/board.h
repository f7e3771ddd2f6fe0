/* The emulated controller: Arm's MPS2 board with the AN386 image, as QEMU's machine mps2-an386 has
 * it. */
#ifndef SC_BOARD_QEMU_MPS2_H
#define SC_BOARD_QEMU_MPS2_H

#define BOARD_NAME   "qemu_mps2"
#define BOARD_ID     2u
#define BOARD_SERIAL 386u
#define BOARD_BAUD   115200u
/* The bytes of a frame reach the emulated UART when the emulator's host thread finds time: on a
 * busy machine milliseconds lie between them. */
#define BOARD_FRAME_GAP_US 4000u
#define BOARD_STACK_MIN    128u  /* bytes */
#define BOARD_WATCHDOG_MS  2000u /* long: the emulator may be stopped by its host for a while */
#ifndef BOARD_BUILD_ID
#define BOARD_BUILD_ID 0u /* set by the build to the head of the source revision */
#endif

#endif
