/* The controller's firmware as a port sees it: start it, call its loop, call its interrupts.
 *
 * A port defines the functions of firmware/hal/, gives the storage of one struct firmware by
 * hal_firmware(), and then runs
 *
 *     firmware_init();            // outputs are off before and after
 *     enable interrupts
 *     for (;;) firmware_poll();
 *
 * All firmware_isr_* run at ONE interrupt priority: none preempts another. Each preempts
 * firmware_poll. Interrupts move bytes, latch counts, set flags, make steps; all else is done by
 * firmware_poll. Budgets are for 168 MHz and are worst cases. The core holds no global state: two
 * instances need two struct firmware. */
#ifndef SC_CORE_FIRMWARE_H
#define SC_CORE_FIRMWARE_H

#include "firmware/core/axis.h"
#include "firmware/core/commission.h"
#include "firmware/core/encunwrap.h"
#include "firmware/core/estop.h"
#include "firmware/core/evring.h"
#include "firmware/core/idxfilter.h"
#include "firmware/core/mblink.h"
#include "firmware/core/mbslave.h"
#include "firmware/core/mirrorctl.h"
#include "firmware/core/scanprog.h"
#include "firmware/core/strobe.h"
#include "firmware/shared/regmap.h"

#define FIRMWARE_VERSION_MAJOR 0
#define FIRMWARE_VERSION_MINOR 1
#define FIRMWARE_VERSION_PATCH 0
#define FIRMWARE_VERSION_TEXT  "0.1.0"

/* Longest pass of firmware_poll before FAULT_LOOP trips, flash writes excepted. */
#define FIRMWARE_LOOP_LIMIT_MS 50u

struct firmware {
    /* interrupts, and the main loop under the lock */
    uint64_t time_us; /* hal_time_now extended to 64 bits, at its last reading */
    struct axis axis[HAL_AXES];
    struct mirrorctl mirror;
    struct encunwrap encoder;
    struct idxfilter index;
    uint32_t revolution;
    uint16_t index_missed, index_rejected;
    struct strobe strobe;
    struct scanprog scan;
    struct estop estop;
    struct evring events;
    uint32_t pins; /* enum hal_input at the last tick */
    int16_t temperature;
    uint16_t stack_free;
    uint32_t tick_us; /* hal_time_now of the last tick */
    bool ticked;      /* a tick has been seen */
    bool halted;      /* everything that moves was stopped for the fault that is latched */
    uint16_t tick_max_us;
    uint16_t step_slips;
    uint64_t heard_us; /* last request of the host */
    uint64_t loop_us;  /* last start of firmware_poll */
    bool flash_busy;   /* commission_save runs: ticks may be late */
    uint16_t host_timeout_ms;
    int16_t temperature_max;
    bool commissioned;
    uint32_t ticks; /* since reset */
    /* main loop only */
    struct mblink link;
    struct mbslave slave;
    struct regmap_holding holding;
    struct regmap_input picture;
    uint8_t commission_state;
    uint16_t refusal, refusal_address;
    uint16_t host_age_ms;
    uint16_t loop_max_us;
    uint32_t kicked_tick; /* value of ticks at the last watchdog kick */
};

/* Start-up: outputs off, state from reset values and flash. Interrupts disabled. Once. */
void firmware_init(void);

/* One pass of the main loop: serial line, housekeeping, watchdog. Never waits. Typical 20 us, worst
 * 1 ms (a full block read), except commission_save (up to 1 s, motors and laser off). Call it
 * without pause; at least every FIRMWARE_LOOP_LIMIT_MS, and several times in an end-of-frame gap
 * for a prompt reply. */
void firmware_poll(void);

/* Every HAL_TICK_US: safety inputs, supervision, estop. Budget 15 us. */
void firmware_isr_tick(void);

/* Optional: a safety or limit input has changed (pin-change interrupt): judges the inputs at once,
 * so that the laser is off within microseconds instead of at the next tick. Extra calls do no harm.
 * Budget 10 us. */
void firmware_isr_pins(void);

/* The step alarm set by hal_time_alarm has come. Budget 15 us. */
void firmware_isr_alarm(void);

/* Mirror index edge, with the hardware capture's time and the encoder counter captured by the same
 * edge (or hal_capture_encoder().count if the port cannot). Budget 10 us. */
void firmware_isr_index(uint32_t capture_us, uint16_t encoder_count);

/* Camera strobe edge, with its capture time. Budget 5 us. */
void firmware_isr_strobe(uint32_t capture_us);

/* A byte has been received without error; now_us: hal_time_now() at its end. Budget 2 us. */
void firmware_isr_rx(uint8_t byte, uint32_t now_us);

/* A byte was received with a framing, parity or overrun error: the frame it belongs to is to be
 * dropped. */
void firmware_isr_rx_error(uint32_t now_us);

/* Optional: the UART's hardware has seen the end-of-frame gap. */
void firmware_isr_rx_idle(void);

/* Optional: the clock security system has reported a failure (non-maskable interrupt allowed: trips
 * at once). */
void firmware_isr_clock_failure(void);

/* Everything that moves stops at once: axes, mirror drive, scan, camera. For core/ctlcmd and the
 * safety tick; the outputs themselves are core/estop's. Interrupts, or under the lock. */
void firmware_halt(struct firmware *fw);

#endif
