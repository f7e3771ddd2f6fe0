/* Registers and bits of the STM32F405 that this port uses, after its reference manual (RM0090):
 * what is not used is not here. */
#ifndef SC_PORT_STM32F405_H
#define SC_PORT_STM32F405_H

#include "firmware/port/cortexm/cortexm.h"

/* --- reset and clock control --- */
struct stm32_rcc {
    volatile uint32_t CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, reserved0;
    volatile uint32_t APB1RSTR, APB2RSTR, reserved1[2], AHB1ENR, AHB2ENR, AHB3ENR, reserved2;
    volatile uint32_t APB1ENR, APB2ENR, reserved3[2], AHB1LPENR, AHB2LPENR, AHB3LPENR, reserved4;
    volatile uint32_t APB1LPENR, APB2LPENR, reserved5[2], BDCR, CSR;
};
#define RCC               ((struct stm32_rcc *)0x40023800u)
#define RCC_CR_HSEON      (1u << 16)
#define RCC_CR_HSERDY     (1u << 17)
#define RCC_CR_CSSON      (1u << 19)
#define RCC_CR_PLLON      (1u << 24)
#define RCC_CR_PLLRDY     (1u << 25)
#define RCC_PLLCFGR_HSE   (1u << 22)
#define RCC_CFGR_SW_PLL   2u
#define RCC_CFGR_SWS      (3u << 2)
#define RCC_CFGR_SWS_PLL  (2u << 2)
#define RCC_CFGR_APB1_BY4 (5u << 10)
#define RCC_CFGR_APB2_BY2 (4u << 13)
#define RCC_CIR_CSSF      (1u << 7)
#define RCC_CIR_CSSC      (1u << 23)
#define RCC_AHB1_GPIOABC  7u
#define RCC_APB1_TIM3     (1u << 1)
#define RCC_APB1_TIM4     (1u << 2)
#define RCC_APB1_TIM5     (1u << 3)
#define RCC_APB1_TIM7     (1u << 5)
#define RCC_APB1_TIM12    (1u << 6)
#define RCC_APB1_PWR      (1u << 28)
#define RCC_APB2_TIM1     (1u << 0)
#define RCC_APB2_USART1   (1u << 4)
#define RCC_APB2_ADC1     (1u << 8)
#define RCC_APB2_SYSCFG   (1u << 14)
#define RCC_APB2_TIM9     (1u << 16)
#define RCC_CSR_RMVF      (1u << 24)
#define RCC_CSR_BORRSTF   (1u << 25)
#define RCC_CSR_PINRSTF   (1u << 26)
#define RCC_CSR_PORRSTF   (1u << 27)
#define RCC_CSR_SFTRSTF   (1u << 28)
#define RCC_CSR_IWDGRSTF  (1u << 29)
#define RCC_CSR_WWDGRSTF  (1u << 30)

/* --- flash interface --- */
struct stm32_flash {
    volatile uint32_t ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
};
#define FLASH              ((struct stm32_flash *)0x40023c00u)
#define FLASH_ACR_5WS      5u
#define FLASH_ACR_CACHES   (7u << 8) /* prefetch, instruction and data cache */
#define FLASH_ACR_DCRST    (1u << 12)
#define FLASH_ACR_DCEN     (1u << 10)
#define FLASH_SR_BSY       (1u << 16)
#define FLASH_SR_ERRORS    0xf2u
#define FLASH_CR_PG        (1u << 0)
#define FLASH_CR_SER       (1u << 1)
#define FLASH_CR_SNB_SHIFT 3
#define FLASH_CR_PSIZE_32  (2u << 8)
#define FLASH_CR_STRT      (1u << 16)
#define FLASH_CR_LOCK      (1u << 31)
#define FLASH_KEY1         0x45670123u
#define FLASH_KEY2         0xcdef89abu

/* --- pins --- */
struct stm32_gpio {
    volatile uint32_t MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
};
#define GPIOA ((struct stm32_gpio *)0x40020000u)
#define GPIOB ((struct stm32_gpio *)0x40020400u)
#define GPIOC ((struct stm32_gpio *)0x40020800u)

/* --- pin-change interrupts --- */
struct stm32_exti {
    volatile uint32_t IMR, EMR, RTSR, FTSR, SWIER, PR;
};
#define EXTI          ((struct stm32_exti *)0x40013c00u)
#define SYSCFG_EXTICR ((volatile uint32_t *)0x40013808u) /* four lines a word, four bits each */

/* --- timers: one layout for all --- */
struct stm32_tim {
    volatile uint32_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR;
    volatile uint32_t CCR1, CCR2, CCR3, CCR4, BDTR, DCR, DMAR;
};
#define TIM1                  ((struct stm32_tim *)0x40010000u)
#define TIM3                  ((struct stm32_tim *)0x40000400u)
#define TIM4                  ((struct stm32_tim *)0x40000800u)
#define TIM5                  ((struct stm32_tim *)0x40000c00u)
#define TIM7                  ((struct stm32_tim *)0x40001400u)
#define TIM9                  ((struct stm32_tim *)0x40014000u)
#define TIM12                 ((struct stm32_tim *)0x40001800u)
#define TIM_CR1_CEN           (1u << 0)
#define TIM_CR1_URS           (1u << 2) /* only an overflow sets UIF, not EGR */
#define TIM_CR1_OPM           (1u << 3)
#define TIM_CR1_ARPE          (1u << 7)
#define TIM_EGR_UG            (1u << 0)
#define TIM_EGR_CC3G          (1u << 3)
#define TIM_SR_UIF            (1u << 0)
#define TIM_SR_CC1IF          (1u << 1)
#define TIM_SR_CC2IF          (1u << 2)
#define TIM_SR_CC3IF          (1u << 3)
#define TIM_DIER_UIE          (1u << 0)
#define TIM_DIER_CC1          (1u << 1)
#define TIM_DIER_CC2          (1u << 2)
#define TIM_DIER_CC3          (1u << 3)
#define TIM_CCER_CC1E         (1u << 0)
#define TIM_CCER_CC2E         (1u << 4)
#define TIM_CCER_CC3E         (1u << 8)
#define TIM_CCER_CC4E         (1u << 12)
#define TIM_CCER_CC4_BOTH     (5u << 13) /* CC4P and CC4NP: both edges */
#define TIM_CCMR_CAPTURE_LOW  0x01u      /* channel 1 or 3 is an input from its own pin */
#define TIM_CCMR_CAPTURE_HIGH 0x0100u
#define TIM_CCMR_FILTER_LOW   0x30u /* 8 samples of the timer's clock */
#define TIM_CCMR_FILTER_HIGH  0x3000u
#define TIM_CCMR_PWM1_LOW     0x68u /* preload, high while CNT < CCR */
#define TIM_CCMR_PWM2_LOW     0x70u /* high while CNT >= CCR, no preload */
#define TIM_SMCR_ENCODER_A    2u    /* counts edges of input 1, direction by the level of input 2 */
#define TIM_BDTR_BKE          (1u << 12)
#define TIM_BDTR_AOE          (1u << 14)
#define TIM_BDTR_MOE          (1u << 15)

/* --- serial line --- */
struct stm32_usart {
    volatile uint32_t SR, DR, BRR, CR1, CR2, CR3, GTPR;
};
#define USART1           ((struct stm32_usart *)0x40011000u)
#define USART_SR_ERRORS  0x0fu /* parity, framing, noise, overrun */
#define USART_SR_IDLE    (1u << 4)
#define USART_SR_RXNE    (1u << 5)
#define USART_SR_TC      (1u << 6)
#define USART_SR_TXE     (1u << 7)
#define USART_CR1_RE     (1u << 2)
#define USART_CR1_TE     (1u << 3)
#define USART_CR1_IDLEIE (1u << 4)
#define USART_CR1_RXNEIE (1u << 5)
#define USART_CR1_TCIE   (1u << 6)
#define USART_CR1_TXEIE  (1u << 7)
#define USART_CR1_UE     (1u << 13)

/* --- converter --- */
struct stm32_adc {
    volatile uint32_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4];
    volatile uint32_t DR;
};
#define ADC1            ((struct stm32_adc *)0x40012000u)
#define ADC_CCR         CORTEXM_REG(0x40012304u)
#define ADC_CCR_BY4     (1u << 16) /* clock of the converters: APB2 / 4 */
#define ADC_SR_EOC      (1u << 1)
#define ADC_CR2_ADON    (1u << 0)
#define ADC_CR2_CONT    (1u << 1)
#define ADC_CR2_SWSTART (1u << 30)
#define ADC_SMPR_480    7u

/* --- independent watchdog: its own oscillator of 17 to 47 kHz, nominally 32 kHz --- */
struct stm32_iwdg {
    volatile uint32_t KR, PR, RLR, SR;
};
#define IWDG            ((struct stm32_iwdg *)0x40003000u)
#define IWDG_KEY_KICK   0xaaaau
#define IWDG_KEY_ACCESS 0x5555u
#define IWDG_KEY_START  0xccccu
#define IWDG_PR_64      4u

/* Freezes the watchdog while a debugger halts the core. */
#define DBGMCU_APB1_FZ CORTEXM_REG(0xe0042008u)
#define DBGMCU_FZ_IWDG (1u << 12)

enum stm32_irq {
    STM32_IRQ_EXTI0 = 6,
    STM32_IRQ_EXTI1 = 7,
    STM32_IRQ_USART1 = 37,
    STM32_IRQ_EXTI10_15 = 40,
    STM32_IRQ_TIM5 = 50,
    STM32_IRQ_TIM7 = 55,
    STM32_IRQ_COUNT = 82
};

#endif
