/* Timers. TIM5 is the time base: 32 bits at 1 MHz, with the captures of index, strobe and encoder
 * edge and the step alarm on its channels, so that all times are on one scale. TIM3 counts the
 * encoder and captures its count at the index edge. TIM12 and TIM9 give step pulses, TIM4 the
 * camera's, TIM1 drives the mirror. */
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_capture.h"
#include "firmware/hal/hal_time.h"
#include "firmware/port/stm32f4/stm32f4.h"

enum {
    STEP_TICK_HZ = 2000000, /* of the pulse timers */
    STEP_TICKS = 5,         /* 2.5 us; drivers want 1.0 to 2.0 */
    MIRROR_PWM_HZ = 20000   /* above hearing */
};

static void time_base_init(uint32_t timer_hz) {
    TIM5->CR1 = TIM_CR1_URS;
    TIM5->PSC = timer_hz / HAL_TIME_HZ - 1;
    TIM5->ARR = 0xffffffffu;
    TIM5->EGR = TIM_EGR_UG;
    TIM5->CCMR1 = TIM_CCMR_CAPTURE_LOW | TIM_CCMR_FILTER_LOW | TIM_CCMR_CAPTURE_HIGH |
                  TIM_CCMR_FILTER_HIGH;  /* index, strobe: rising edges */
    TIM5->CCMR2 = TIM_CCMR_CAPTURE_HIGH; /* channel 3 compares, channel 4 captures */
    TIM5->CCER = TIM_CCER_CC1E | TIM_CCER_CC2E | TIM_CCER_CC4E | TIM_CCER_CC4_BOTH;
    TIM5->SR = 0;
    TIM5->DIER = TIM_DIER_CC1 | TIM_DIER_CC2;
    TIM5->CR1 = TIM_CR1_URS | TIM_CR1_CEN;
}

/* Counts both edges of A only, up or down by the level of B: each count has its edge on TIM5
 * channel 4, which B's edges would not. An encoder of 2048 lines gives 4096 counts. */
static void encoder_init(void) {
    TIM3->CCMR1 = TIM_CCMR_CAPTURE_LOW | TIM_CCMR_CAPTURE_HIGH;
    TIM3->CCMR2 =
        TIM_CCMR_CAPTURE_LOW | TIM_CCMR_FILTER_LOW; /* channel 3: the index edge, as filtered */
    TIM3->CCER = TIM_CCER_CC3E;
    TIM3->SMCR = TIM_SMCR_ENCODER_A;
    TIM3->ARR = 0xffffu;
    TIM3->CR1 = TIM_CR1_CEN;
}

/* One pulse of `ticks` timer ticks each time the timer is started, beginning one tick later. */
static void one_shot_init(struct stm32_tim *tim, uint32_t timer_hz, uint32_t tick_hz,
                          uint32_t ticks) {
    tim->CR1 = TIM_CR1_OPM | TIM_CR1_URS;
    tim->PSC = timer_hz / tick_hz - 1;
    tim->ARR = ticks;
    tim->CCR1 = 1;
    tim->CCMR1 = TIM_CCMR_PWM2_LOW;
    tim->EGR = TIM_EGR_UG;
    tim->CCER = TIM_CCER_CC1E;
}

static void mirror_init(uint32_t timer_hz) {
    TIM1->PSC = 0;
    TIM1->ARR = timer_hz / MIRROR_PWM_HZ - 1;
    TIM1->CCR1 = 0;
    TIM1->CCMR1 = TIM_CCMR_PWM1_LOW;
    TIM1->CCER = TIM_CCER_CC1E;
    TIM1->EGR = TIM_EGR_UG;
    /* The emergency chain is the break input, low when open: it stops the drive without the
     * processor. Outputs come back only by hal_safety_motors. */
    TIM1->BDTR = TIM_BDTR_BKE;
    TIM1->CR1 = TIM_CR1_ARPE | TIM_CR1_CEN;
}

void timers_stm32f4_init(void) {
    const struct stm32f4_clocks *clocks = clock_stm32f4();
    RCC->APB1ENR |= RCC_APB1_TIM3 | RCC_APB1_TIM4 | RCC_APB1_TIM5 | RCC_APB1_TIM7 | RCC_APB1_TIM12;
    RCC->APB2ENR |= RCC_APB2_TIM1 | RCC_APB2_TIM9;
    cortexm_barrier();
    time_base_init(clocks->apb1_timer_hz);
    encoder_init();
    one_shot_init(TIM12, clocks->apb1_timer_hz, STEP_TICK_HZ, STEP_TICKS);
    one_shot_init(TIM9, clocks->apb2_timer_hz, STEP_TICK_HZ, STEP_TICKS);
    one_shot_init(TIM4, clocks->apb1_timer_hz, 1000000u, 1000);
    mirror_init(clocks->apb2_timer_hz);
}

uint32_t hal_time_now(void) {
    return TIM5->CNT;
}

void hal_time_alarm(uint32_t at_us) {
    TIM5->CCR3 = at_us;
    TIM5->SR = ~TIM_SR_CC3IF;
    TIM5->DIER |= TIM_DIER_CC3;
    /* The compare fires on equality only: if the time has passed meanwhile, force it. */
    if ((int32_t)(at_us - TIM5->CNT) <= 0)
        TIM5->EGR = TIM_EGR_CC3G;
}

void hal_time_alarm_off(void) {
    TIM5->DIER &= ~TIM_DIER_CC3;
    TIM5->SR = ~TIM_SR_CC3IF;
}

/* Index, strobe and step alarm share one interrupt. Flags are cleared before the captured value is
 * read: an edge after that raises the interrupt again. Budget: those of the three core functions
 * and 1 us. */
void timers_stm32f4_isr_tim5(void) {
    uint32_t flags = TIM5->SR & TIM5->DIER;
    TIM5->SR = ~(flags & (TIM_SR_CC1IF | TIM_SR_CC2IF | TIM_SR_CC3IF));
    if (flags & TIM_SR_CC1IF)
        firmware_isr_index(TIM5->CCR1, (uint16_t)TIM3->CCR3);
    if (flags & TIM_SR_CC2IF)
        firmware_isr_strobe(TIM5->CCR2);
    if (flags & TIM_SR_CC3IF) {
        TIM5->DIER &= ~TIM_DIER_CC3;
        firmware_isr_alarm();
    }
}

struct hal_encoder hal_capture_encoder(void) {
    struct hal_encoder encoder;
    /* If an edge fell in between, once more: edges are at least 4 us apart. */
    for (unsigned tries = 0; tries < 3; tries++) {
        uint16_t before = (uint16_t)TIM3->CNT;
        encoder.edge_us = TIM5->CCR4;
        encoder.count = (uint16_t)TIM3->CNT;
        encoder.now_us = TIM5->CNT;
        if (before == encoder.count)
            break;
    }
    return encoder;
}

void hal_capture_trigger(uint16_t length_us) {
    TIM4->ARR = length_us;
    if (TIM4->CR1 & TIM_CR1_CEN)
        TIM4->CNT = 1; /* the line is high: begin the length anew */
    else
        TIM4->CR1 |= TIM_CR1_CEN;
}

void hal_axis_step(enum hal_axis axis) {
    struct stm32_tim *tim = axis == HAL_PAN ? TIM12 : TIM9;
    tim->CR1 |= TIM_CR1_CEN;
}

void hal_axis_direction(enum hal_axis axis, bool positive) {
    if (axis == HAL_PAN) {
        if (positive)
            STM32F4_SET(PAN_DIR);
        else
            STM32F4_CLEAR(PAN_DIR);
    } else if (positive) {
        STM32F4_SET(TILT_DIR);
    } else {
        STM32F4_CLEAR(TILT_DIR);
    }
}

void hal_axis_mirror_drive(uint16_t drive) {
    TIM1->CCR1 = (TIM1->ARR + 1) * drive / 10000u;
}

void timers_stm32f4_mirror_output(bool on) {
    if (on)
        TIM1->BDTR |= TIM_BDTR_MOE;
    else
        TIM1->BDTR &= ~TIM_BDTR_MOE;
}
