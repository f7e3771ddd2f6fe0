/* The cart controller's board: STM32F405RG (64 pins), pins and clocks. Port/stm32f4 turns these
 * tables into register values; WIRING.md says what is connected. */
#ifndef SC_BOARD_CART_F405_H
#define SC_BOARD_CART_F405_H

#define BOARD_NAME "cart_f405"
#define BOARD_ID   1u
#define BOARD_BAUD 115200u /* 8 bits, even parity, 1 stop bit */
/* Silence that ends a frame: what the serial line specification fixes above 19 200 baud. */
#define BOARD_FRAME_GAP_US 1750u
#define BOARD_STACK_MIN    128u /* bytes */
#define BOARD_WATCHDOG_MS                                                                          \
    1600u /* nominal; its oscillator allows 1.1 to 3 s; a sector erase takes 0.8 s */
#ifndef BOARD_BUILD_ID
#define BOARD_BUILD_ID 0u /* set by the build to the head of the source revision */
#endif

/* Crystal 8 MHz / M * N / P = 168 MHz; buses 42 MHz (timers 84) and 84 MHz (timers 168). */
#define BOARD_HSE_HZ 8000000u
#define BOARD_PLL_M  8u
#define BOARD_PLL_N  336u
#define BOARD_PLL_P  2u
#define BOARD_PLL_Q  7u

/* Flash sector 3, written in production: words of 32 bits, erased means not given.
 * 0 serial number (else 0, unknown); 1 end-of-frame gap in us, for converters between Linux and the
 * line that send a frame with pauses (else BOARD_FRAME_GAP_US).
 * Commissioning records: sectors 1 and 2, alternating. */
#define BOARD_DATA_ADDRESS     0x0800c000u
#define BOARD_RECORD_A_ADDRESS 0x08004000u
#define BOARD_RECORD_A_SECTOR  1u
#define BOARD_RECORD_B_ADDRESS 0x08008000u
#define BOARD_RECORD_B_SECTOR  2u

/* X(SIGNAL, port, pin, mode, function, pull)
 * mode: IN, OUT (starts low), ALT (of a timer or the serial line), ANALOG
 * function: number of the alternate function, 0 otherwise
 * pull: NONE, UP, DOWN: what a broken wire reads as, see hal_safety.h */
#define BOARD_PINS(X)                                                                              \
    X(MIRROR_INDEX, A, 0, ALT, 2, DOWN)       /* TIM5 channel 1: time of the index edge */         \
    X(CAMERA_STROBE, A, 1, ALT, 2, DOWN)      /* TIM5 channel 2: time of the strobe edge */        \
    X(TILT_STEP, A, 2, ALT, 3, DOWN)          /* TIM9 channel 1, one pulse */                      \
    X(ENCODER_A_TIME, A, 3, ALT, 2, DOWN)     /* TIM5 channel 4: time of the last edge of A */     \
    X(RS485_DE, A, 4, OUT, 0, DOWN)           /* driver enable */                                  \
    X(TEMPERATURE, A, 5, ANALOG, 0, NONE)     /* ADC1 input 5 */                                   \
    X(ENCODER_A, A, 6, ALT, 2, DOWN)          /* TIM3 channel 1 */                                 \
    X(ENCODER_B, A, 7, ALT, 2, DOWN)          /* TIM3 channel 2 */                                 \
    X(MIRROR_PWM, A, 8, ALT, 1, DOWN)         /* TIM1 channel 1 */                                 \
    X(UART_TX, A, 9, ALT, 7, UP)              /* USART1 */                                         \
    X(UART_RX, A, 10, ALT, 7, UP)             /* USART1 */                                         \
    X(MIRROR_INDEX_COUNT, B, 0, ALT, 2, DOWN) /* TIM3 channel 3: encoder count at the index */     \
    X(TILT_LIMIT_MAX, B, 1, IN, 0, UP)        /* opener to ground: open or broken reads 1 */       \
    X(CAMERA_TRIGGER, B, 6, ALT, 2, DOWN)     /* TIM4 channel 1, one pulse */                      \
    X(TILT_HOME, B, 10, IN, 0, UP)            /* */                                                \
    X(LASER_CURRENT, B, 11, IN, 0, DOWN)      /* comparator at the laser driver */                 \
    X(ESTOP, B, 12, ALT, 1, DOWN)             /* TIM1 break input, also read; chain closed is 1 */ \
    X(PAN_STEP, B, 14, ALT, 9, DOWN)          /* TIM12 channel 1, one pulse */                     \
    X(INTERLOCK, C, 0, IN, 0, DOWN)           /* chain closed is 1 */                              \
    X(DOOR, C, 1, IN, 0, DOWN)                /* chain closed is 1 */                              \
    X(PAN_LIMIT_MIN, C, 2, IN, 0, UP)         /* */                                                \
    X(PAN_LIMIT_MAX, C, 3, IN, 0, UP)         /* */                                                \
    X(PAN_HOME, C, 4, IN, 0, UP)              /* */                                                \
    X(TILT_LIMIT_MIN, C, 5, IN, 0, UP)        /* */                                                \
    X(PAN_DIR, C, 6, OUT, 0, DOWN)            /* */                                                \
    X(TILT_DIR, C, 7, OUT, 0, DOWN)           /* */                                                \
    X(LASER_ENABLE, C, 8, OUT, 0, DOWN)       /* pull-down on the board as well */                 \
    X(MOTOR_ENABLE, C, 9, OUT, 0, DOWN)       /* pull-down on the board as well */

#endif
