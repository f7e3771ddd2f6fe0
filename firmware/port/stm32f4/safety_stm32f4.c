/* Pins, safety outputs and inputs, temperature, watchdog, cause of the reset. */
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_safety.h"
#include "firmware/hal/hal_time.h"
#include "firmware/port/stm32f4/stm32f4.h"

enum pin_mode { MODE_IN = 0, MODE_OUT = 1, MODE_ALT = 2, MODE_ANALOG = 3 };
enum pin_pull { PULL_NONE = 0, PULL_UP = 1, PULL_DOWN = 2 };

struct pin {
    uint8_t port, number, mode, function, pull;
};
static const struct pin pins[] = {
#define X(signal, port, pin, mode, function, pull)                                                 \
    {PIN_PORT_##signal, (pin), MODE_##mode, (function), PULL_##pull},
    BOARD_PINS(X)
#undef X
};

void safety_stm32f4_pins(void) {
    RCC->AHB1ENR |= RCC_AHB1_GPIOABC;
    cortexm_barrier();
    for (unsigned i = 0; i < sizeof pins / sizeof pins[0]; i++) {
        struct stm32_gpio *gpio = stm32f4_port((enum stm32f4_pin_port)pins[i].port);
        unsigned n = pins[i].number;
        gpio->BSRR = 0x10000u << n; /* outputs start low */
        gpio->PUPDR = (gpio->PUPDR & ~(3u << 2 * n)) | (uint32_t)pins[i].pull << 2 * n;
        gpio->AFR[n / 8] = (gpio->AFR[n / 8] & ~(15u << 4 * (n % 8))) | (uint32_t)pins[i].function
                                                                            << 4 * (n % 8);
        gpio->MODER = (gpio->MODER & ~(3u << 2 * n)) | (uint32_t)pins[i].mode << 2 * n;
    }
}

void hal_safety_laser(bool on) {
    if (on)
        STM32F4_SET(LASER_ENABLE);
    else
        STM32F4_CLEAR(LASER_ENABLE);
}

void hal_safety_motors(bool on) {
    timers_stm32f4_mirror_output(on);
    if (on)
        STM32F4_SET(MOTOR_ENABLE);
    else
        STM32F4_CLEAR(MOTOR_ENABLE);
}

void port_make_safe(void) {
    STM32F4_CLEAR(LASER_ENABLE);
    STM32F4_CLEAR(MOTOR_ENABLE);
    timers_stm32f4_mirror_output(false);
}

uint32_t hal_safety_inputs(void) {
    uint32_t inputs = 0;
    inputs |= STM32F4_READ(ESTOP) ? HAL_IN_ESTOP_CLOSED : 0u;
    inputs |= STM32F4_READ(INTERLOCK) ? HAL_IN_INTERLOCK_CLOSED : 0u;
    inputs |= STM32F4_READ(DOOR) ? HAL_IN_DOOR_CLOSED : 0u;
    inputs |= STM32F4_READ(PAN_LIMIT_MIN) ? HAL_IN_PAN_LIMIT_MIN : 0u;
    inputs |= STM32F4_READ(PAN_LIMIT_MAX) ? HAL_IN_PAN_LIMIT_MAX : 0u;
    inputs |= STM32F4_READ(PAN_HOME) ? HAL_IN_PAN_HOME : 0u;
    inputs |= STM32F4_READ(TILT_LIMIT_MIN) ? HAL_IN_TILT_LIMIT_MIN : 0u;
    inputs |= STM32F4_READ(TILT_LIMIT_MAX) ? HAL_IN_TILT_LIMIT_MAX : 0u;
    inputs |= STM32F4_READ(TILT_HOME) ? HAL_IN_TILT_HOME : 0u;
    inputs |= STM32F4_READ(LASER_CURRENT) ? HAL_IN_LASER_CURRENT : 0u;
    return inputs;
}

/* --- the three chains also interrupt when they open, so that the laser does not wait for the tick
 * --- */

static void chain_interrupt(enum stm32f4_pin_port port, unsigned pin) {
    unsigned shift = 4 * (pin % 4);
    SYSCFG_EXTICR[pin / 4] = (SYSCFG_EXTICR[pin / 4] & ~(15u << shift)) | (uint32_t)port << shift;
    EXTI->FTSR |= 1u << pin;
    EXTI->IMR |= 1u << pin;
}

static void chain_interrupts_init(void) {
    RCC->APB2ENR |= RCC_APB2_SYSCFG;
    cortexm_barrier();
    chain_interrupt((enum stm32f4_pin_port)PIN_PORT_ESTOP, PIN_ESTOP);
    chain_interrupt((enum stm32f4_pin_port)PIN_PORT_INTERLOCK, PIN_INTERLOCK);
    chain_interrupt((enum stm32f4_pin_port)PIN_PORT_DOOR, PIN_DOOR);
}

/* Budget: that of firmware_isr_pins and 1 us. A chain that chatters faster than the bus can bounce
 * is bounded by the debouncing capacitor at each input (WIRING.md). */
void safety_stm32f4_isr_exti(void) {
    EXTI->PR = 1u << PIN_ESTOP | 1u << PIN_INTERLOCK | 1u << PIN_DOOR;
    firmware_isr_pins();
}

/* --- temperature: thermistor 10 kOhm, B 3950 K, to ground; 10 kOhm to the converter's reference
 * --- */

enum {
    TEMPERATURE_FIRST = -200,
    TEMPERATURE_STEP = 100,
    SENSOR_SILENT_TICKS = 1000000 / HAL_TICK_US
};

/* Converter's reading at -20, -10, ... 100 C: 4096 R / (R + 10 kOhm), R = 10 kOhm exp(B (1/T -
 * 1/298.15 K)). */
static const uint16_t thermistor[] = {3741, 3496, 3157, 2739, 2278, 1825, 1419,
                                      1082, 816,  613,  462,  350,  267};
enum { THERMISTOR_POINTS = sizeof thermistor / sizeof thermistor[0] };

static uint32_t reading_16; /* 16 times the smoothed reading */
static uint16_t silent_ticks = SENSOR_SILENT_TICKS;

static void converter_init(void) {
    RCC->APB2ENR |= RCC_APB2_ADC1;
    cortexm_barrier();
    ADC_CCR = ADC_CCR_BY4;
    ADC1->SMPR2 = ADC_SMPR_480 << 3 * PIN_TEMPERATURE;
    ADC1->SQR3 = PIN_TEMPERATURE; /* on port A the input has the pin's number */
    ADC1->CR2 = ADC_CR2_ADON | ADC_CR2_CONT;
    ADC1->CR2 |= ADC_CR2_SWSTART;
}

void safety_stm32f4_tick(void) {
    if (!(ADC1->SR & ADC_SR_EOC)) {
        if (silent_ticks < SENSOR_SILENT_TICKS)
            silent_ticks++;
        return;
    }
    uint32_t reading = ADC1->DR & 0xfffu;
    if (silent_ticks >= SENSOR_SILENT_TICKS)
        reading_16 = reading * 16;
    else
        reading_16 += reading - reading_16 / 16;
    silent_ticks = 0;
}

bool hal_safety_temperature(int16_t *out_decidegrees) {
    uint32_t reading = reading_16 / 16;
    if (silent_ticks >= SENSOR_SILENT_TICKS || reading > thermistor[0] ||
        reading < thermistor[THERMISTOR_POINTS - 1])
        return false; /* silent, open, shorted */
    unsigned i = 0;
    while (i + 2 < THERMISTOR_POINTS && reading < thermistor[i + 1])
        i++;
    int32_t above = thermistor[i] - (int32_t)reading, span = thermistor[i] - thermistor[i + 1];
    *out_decidegrees = (int16_t)(TEMPERATURE_FIRST + TEMPERATURE_STEP * (int32_t)i +
                                 TEMPERATURE_STEP * above / span);
    return true;
}

uint16_t hal_safety_stack_free(void) {
    return cortexm_stack_free();
}

/* --- watchdog and reset -------------------------------------------------------------------------
 */

static void watchdog_init(void) {
    IWDG->KR = IWDG_KEY_START;
    IWDG->KR = IWDG_KEY_ACCESS;
    IWDG->PR = IWDG_PR_64; /* 500 Hz nominal */
    IWDG->RLR = BOARD_WATCHDOG_MS / 2;
    for (unsigned i = 0; i < 20000 && IWDG->SR; i++)
        ; /* the new values reach the slow clock's side: a few of its periods */
    IWDG->KR = IWDG_KEY_KICK;
}

void safety_stm32f4_init(void) {
    DBGMCU_APB1_FZ |= DBGMCU_FZ_IWDG;
    chain_interrupts_init();
    converter_init();
    watchdog_init();
}

void hal_safety_watchdog_kick(void) {
    IWDG->KR = IWDG_KEY_KICK;
}

uint16_t safety_stm32f4_reset_cause(void) {
    uint32_t flags = RCC->CSR;
    RCC->CSR |= RCC_CSR_RMVF;
    /* Most telling first: a watchdog's reset also pulls the reset pin, power-up also sets
     * brown-out. */
    if (flags & (RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF))
        return RESETCAUSE_WATCHDOG;
    if (flags & RCC_CSR_SFTRSTF)
        return RESETCAUSE_SOFTWARE;
    if (flags & RCC_CSR_PORRSTF)
        return RESETCAUSE_POWER;
    if (flags & RCC_CSR_BORRSTF)
        return RESETCAUSE_BROWNOUT;
    if (flags & RCC_CSR_PINRSTF)
        return RESETCAUSE_PIN;
    return RESETCAUSE_UNKNOWN;
}
