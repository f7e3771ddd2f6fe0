/* Time, step timer, safety signals and storage on the emulated MPS2 board. What a real board has as
 * pins is wired to the plant (plant.h). All interrupts have one priority. */
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_capture.h"
#include "firmware/hal/hal_flash.h"
#include "firmware/hal/hal_time.h"
#include "firmware/hal/hal_uart.h"
#include "firmware/port/mps2/mps2.h"
#include "firmware/port/mps2/plant.h"
#include "firmware/port/mps2/uart_mps2.h"

#include "boards/qemu_mps2/board.h"

#include <string.h>

/* Kept over a reset. */
static struct {
    uint32_t magic;
    uint32_t cause; /* enum resetcause of the reset to come */
} survivor __attribute__((section(".noinit")));
static const uint32_t survivor_magic = 0x5ca4ca47u;

/* The record of the commissioning values: in PSRAM, which QEMU can map to a file. */
struct flash_record {
    uint32_t magic;
    uint8_t bytes[HAL_FLASH_SIZE];
};
static const uint32_t flash_magic = 0xf1a54bedu;

static struct firmware instance;
static struct hal_board board = {.name = BOARD_NAME,
                                 .board_id = BOARD_ID,
                                 .serial = BOARD_SERIAL,
                                 .build_id = BOARD_BUILD_ID,
                                 .baud = BOARD_BAUD,
                                 .frame_gap_us = BOARD_FRAME_GAP_US,
                                 .caps =
                                     HAL_CAP_ENCODER | HAL_CAP_LASER_CURRENT | HAL_CAP_CLOCK_LAX,
                                 .stack_min = BOARD_STACK_MIN};
static struct plant plant;
static uint64_t plant_clock_us; /* hal_time_now extended, for the plant alone */
static uint32_t alarm_us;       /* time of the armed step alarm */
static bool hang;               /* asked for on the console: the main loop stops */

const struct hal_board *hal_board(void) {
    return &board;
}

struct firmware *hal_firmware(void) {
    return &instance;
}

/* --- time ------------------------------------------------------------------------------------- */

uint32_t hal_time_now(void) {
    return MPS2_FPGAIO_COUNTER;
}

/* Interrupts only, or locked: extends the 32-bit time. */
static uint64_t plant_time(void) {
    uint32_t now = hal_time_now();
    plant_clock_us += (uint32_t)(now - (uint32_t)plant_clock_us);
    return plant_clock_us;
}

/* One shot of a CMSDK timer `us` from now, at most 100 s. */
static uint32_t timer_clocks(int32_t us) {
    if (us < 1)
        return 1;
    return us < 100000000 ? (uint32_t)us * MPS2_CLOCKS_US : 100000000u * MPS2_CLOCKS_US;
}

void hal_time_alarm(uint32_t at_us) {
    alarm_us = at_us;
    uint32_t clocks = timer_clocks((int32_t)(at_us - hal_time_now()));
    MPS2_TIMER0_CTRL = 0;
    MPS2_TIMER0_CLEAR = 1;
    MPS2_TIMER0_RELOAD = clocks;
    MPS2_TIMER0_VALUE = clocks;
    MPS2_TIMER0_CTRL = MPS2_TIMER_ENABLE | MPS2_TIMER_INTERRUPT;
}

void hal_time_alarm_off(void) {
    MPS2_TIMER0_CTRL = 0;
    MPS2_TIMER0_CLEAR = 1;
}

/* Step alarm. Budget: that of firmware_isr_alarm and 1 us. */
static void isr_timer0(void) {
    MPS2_TIMER0_CTRL = 0;
    MPS2_TIMER0_CLEAR = 1;
    if ((int32_t)(hal_time_now() - alarm_us) < 0)
        hal_time_alarm(alarm_us); /* further away than one shot of the timer reaches */
    else
        firmware_isr_alarm();
}

/* --- the plant -------------------------------------------------------------------------------- */

static void plant_saw_index(uint64_t t_us, uint16_t encoder_count) {
    firmware_isr_index((uint32_t)t_us, encoder_count);
}

static void plant_saw_strobe(uint64_t t_us) {
    firmware_isr_strobe((uint32_t)t_us);
}

static void plant_catch_up(void) {
    static const struct plant_events events = {plant_saw_index, plant_saw_strobe};
    plant_run(&plant, plant_time(), &events);
    uint64_t due = plant_due_us(&plant);
    uint32_t clocks = timer_clocks((int32_t)(due - plant_clock_us));
    MPS2_TIMER1_CTRL = 0;
    MPS2_TIMER1_CLEAR = 1;
    MPS2_TIMER1_RELOAD = clocks;
    MPS2_TIMER1_VALUE = clocks;
    MPS2_TIMER1_CTRL = MPS2_TIMER_ENABLE | MPS2_TIMER_INTERRUPT;
}

/* The plant's next event. Budget: index and strobe of the core, and 5 us for every 500 us late. */
static void isr_timer1(void) {
    plant_catch_up();
}

struct hal_encoder hal_capture_encoder(void) {
    uint32_t lock = hal_irq_save();
    uint64_t now = plant_time();
    /* Between catch-ups the speed is constant; if the emulator is late, the counter waits. */
    uint64_t at = now < plant.now_us + PLANT_STEP_US ? now : plant.now_us + PLANT_STEP_US;
    struct hal_encoder encoder = {.count = plant_encoder(&plant, at), .now_us = (uint32_t)at};
    encoder.edge_us = encoder.now_us;
    hal_irq_restore(lock);
    return encoder;
}

void hal_capture_trigger(uint16_t length_us) {
    (void)length_us; /* the model's camera goes by the leading edge */
    uint32_t lock = hal_irq_save();
    plant_trigger(&plant, plant_time());
    hal_irq_restore(lock);
}

void hal_axis_step(enum hal_axis axis) {
    plant_step(&plant, axis);
}

void hal_axis_direction(enum hal_axis axis, bool positive) {
    plant_direction(&plant, axis, positive);
}

void hal_axis_mirror_drive(uint16_t drive) {
    plant.drive = drive;
}

void hal_safety_laser(bool on) {
    plant.laser = on;
}

void hal_safety_motors(bool on) {
    plant.motors = on;
}

void port_make_safe(void) {
    plant.laser = false;
    plant.motors = false;
}

uint32_t hal_safety_inputs(void) {
    return plant_inputs(&plant);
}

bool hal_safety_temperature(int16_t *out_decidegrees) {
    *out_decidegrees = plant.temperature;
    return true;
}

uint16_t hal_safety_stack_free(void) {
    return cortexm_stack_free();
}

bool hal_safety_clock_ok(void) {
    return true; /* the emulator has one clock only */
}

/* Safety tick. Budget: that of firmware_isr_tick and 2 us. */
static void isr_systick(void) {
    plant_catch_up();
    firmware_isr_tick();
}

/* A letter on the second serial line: see plant_console; x stops the main loop, to see the watchdog
 * act. Answered with the letter, or with '?'. Budget: that of
 * firmware_isr_pins and 2 us. */
static void isr_uart1(void) {
    MPS2_UART_CLEAR(MPS2_UART1) = MPS2_UART_CLEAR_RX;
    while (MPS2_UART_STATE(MPS2_UART1) & MPS2_UART_RX_FULL) {
        char letter = (char)MPS2_UART_DATA(MPS2_UART1);
        bool known = letter == 'x' || plant_console(&plant, letter);
        if (letter == 'x')
            hang = true;
        firmware_isr_pins(); /* as a pin-change interrupt would */
        MPS2_UART_DATA(MPS2_UART1) = known ? (uint8_t)letter : (uint8_t)'?';
    }
}

/* --- storage and watchdog -----------------------------------------------------------------------
 */

static struct flash_record *flash(void) {
    return (struct flash_record *)(uintptr_t)MPS2_PSRAM;
}

void hal_flash_read(uint8_t *out_bytes, unsigned count) {
    if (flash()->magic == flash_magic)
        memcpy(out_bytes, flash()->bytes, count);
    else
        memset(out_bytes, 0xff, count);
}

bool hal_flash_write(const uint8_t *bytes, unsigned count) {
    memset(flash()->bytes, 0xff, HAL_FLASH_SIZE);
    memcpy(flash()->bytes, bytes, count);
    flash()->magic = flash_magic;
    return !memcmp(flash()->bytes, bytes, count);
}

void hal_safety_watchdog_kick(void) {
    if (hang)
        return;
    MPS2_WDOG_LOCK = MPS2_WDOG_KEY;
    MPS2_WDOG_CLEAR = 1;
    MPS2_WDOG_LOAD = BOARD_WATCHDOG_MS * (MPS2_CLOCK_HZ / 1000u) / 2;
    MPS2_WDOG_CTRL = MPS2_WDOG_INTERRUPT | MPS2_WDOG_RESET;
    MPS2_WDOG_LOCK = 0;
}

/* First half of the watchdog's time is over: note why the reset comes. */
static void isr_nmi(void) {
    survivor.cause = RESETCAUSE_WATCHDOG;
    port_make_safe();
    for (;;)
        ;
}

void port_main(void) {
    bool warm = survivor.magic == survivor_magic;
    board.reset_cause = (uint16_t)(warm ? survivor.cause : (uint32_t)RESETCAUSE_POWER);
    survivor.magic = survivor_magic;
    survivor.cause = RESETCAUSE_PIN; /* a reset that is not announced */

    if (MPS2_GAP_OPTION >= 500 && MPS2_GAP_OPTION <= 1000000)
        board.frame_gap_us = MPS2_GAP_OPTION;

    MPS2_FPGAIO_PRESCALE = MPS2_CLOCKS_US - 1;
    MPS2_FPGAIO_COUNTER = 0;
    plant_init(&plant, 0);
    uart_mps2_init();
    MPS2_UART_BAUDDIV(MPS2_UART1) = 16;
    MPS2_UART_CTRL(MPS2_UART1) =
        MPS2_UART_CTRL_TX | MPS2_UART_CTRL_RX | MPS2_UART_CTRL_RX_INTERRUPT;
    firmware_init();
    hal_safety_watchdog_kick();

    cortexm_irq_enable(MPS2_IRQ_UART0_RX);
    cortexm_irq_enable(MPS2_IRQ_UART0_TX);
    cortexm_irq_enable(MPS2_IRQ_UART1_RX);
    cortexm_irq_enable(MPS2_IRQ_TIMER0);
    cortexm_irq_enable(MPS2_IRQ_TIMER1);
    cortexm_systick_start(HAL_TICK_US * MPS2_CLOCKS_US);
    cortexm_irq_on();
    for (;;) {
        while (hang)
            ;
        firmware_poll();
        cortexm_wait(); /* the tick ends it after 500 us: emulating an idle loop would cost a host
                           core */
    }
}

/* Vector table. */
extern uint32_t ld_stack_end[];
extern const union cortexm_vector vectors[CORTEXM_EXCEPTIONS + MPS2_IRQ_COUNT];
__attribute__((section(".vectors"), used))
const union cortexm_vector vectors[CORTEXM_EXCEPTIONS + MPS2_IRQ_COUNT] = {
    [0] = {.stack = ld_stack_end},
    [1] = {.handler = cortexm_reset},
    [2] = {.handler = isr_nmi},
    CORTEXM_FAULT_VECTORS,
    [15] = {.handler = isr_systick},
    [CORTEXM_EXCEPTIONS + MPS2_IRQ_UART0_RX] = {.handler = uart_mps2_isr_rx},
    [CORTEXM_EXCEPTIONS + MPS2_IRQ_UART0_TX] = {.handler = uart_mps2_isr_tx},
    [CORTEXM_EXCEPTIONS + MPS2_IRQ_UART1_RX] = {.handler = isr_uart1},
    [CORTEXM_EXCEPTIONS + MPS2_IRQ_TIMER0] = {.handler = isr_timer0},
    [CORTEXM_EXCEPTIONS + MPS2_IRQ_TIMER1] = {.handler = isr_timer1},
};
