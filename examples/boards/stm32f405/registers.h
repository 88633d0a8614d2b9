/* The registers that this board uses, from ST's reference manual RM0090 and ARM's ARMv7-M manual. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

typedef volatile uint32_t reg;

/* RM0090, 7.3 */
typedef struct {
    reg CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, r0, APB1RSTR, APB2RSTR, r1, r2;
    reg AHB1ENR, AHB2ENR, AHB3ENR, r3, APB1ENR, APB2ENR;
} rcc_registers;
#define RCC ((rcc_registers *)0x40023800u)

/* RM0090, 7.3.21 */
#define RCC_CSR (*(reg *)0x40023874u)

/* RM0090, 13.13 */
typedef struct {
    reg SR, CR1, CR2, SMPR1, SMPR2, JOFR1, JOFR2, JOFR3, JOFR4, HTR, LTR, SQR1, SQR2, SQR3;
    reg JSQR, JDR1, JDR2, JDR3, JDR4, DR;
} adc_registers;
#define ADC1 ((adc_registers *)0x40012000u)
#define ADC_CCR (*(reg *)0x40012304u)

/* RM0090, 3.9 and 5.4 */
#define FLASH_ACR (*(reg *)0x40023c00u)
#define PWR_CR (*(reg *)0x40007000u)
#define PWR_CSR (*(reg *)0x40007004u)
#define EXTI_IMR (*(reg *)0x40013c00u)
#define EXTI_RTSR (*(reg *)0x40013c08u)
#define EXTI_PR (*(reg *)0x40013c14u)

/* RM0090, 8.4 */
typedef struct {
    reg MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH;
} gpio_registers;
#define GPIOA ((gpio_registers *)0x40020000u)
#define GPIOB ((gpio_registers *)0x40020400u)

/* RM0090, 18.4 and 17.4 */
typedef struct {
    reg CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR;
} timer_registers;
#define TIM2 ((timer_registers *)0x40000000u)
#define TIM8 ((timer_registers *)0x40010400u)

/* RM0090, 14.5 */
typedef struct {
    reg CR, SWTRIGR, DHR12R1, DHR12L1, DHR8R1, DHR12R2, DHR12L2, DHR8R2, DHR12RD;
} dac_registers;
#define DAC ((dac_registers *)0x40007400u)

/* RM0090, 10.5: DMA1, stream 5, and DMA2, streams 0 and 1 */
#define DMA1_HISR (*(reg *)0x40026004u)
#define DMA1_HIFCR (*(reg *)0x4002600cu)
typedef struct {
    reg CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_registers;
#define DMA1_STREAM5 ((dma_stream_registers *)0x40026088u)
#define DMA2_STREAM0 ((dma_stream_registers *)0x40026410u)
#define DMA2_STREAM1 ((dma_stream_registers *)0x40026428u)

/* RM0090, 30.6 */
typedef struct {
    reg SR, DR, BRR, CR1, CR2, CR3;
} usart_registers;
#define USART1 ((usart_registers *)0x40011000u)
#define USART2 ((usart_registers *)0x40004400u)
#define USART3 ((usart_registers *)0x40004800u)

/* RM0090, 21.4 */
#define IWDG_KR (*(reg *)0x40003000u)
#define IWDG_PR (*(reg *)0x40003004u)
#define IWDG_RLR (*(reg *)0x40003008u)

/* ARMv7-M, B3.4 */
#define NVIC_ISER ((reg *)0xe000e100u)
#define NVIC_ICER ((reg *)0xe000e180u)
#define NVIC_ISPR ((reg *)0xe000e200u)
#define NVIC_IPR ((volatile uint8_t *)0xe000e400u)
enum { IRQ_PVD = 1, IRQ_DMA1_STREAM5 = 16, IRQ_TIM2 = 28, IRQ_USART1 = 37, IRQ_COUNT = 82 };

static inline void enable_interrupt(uint32_t irq, uint32_t priority) {
    NVIC_IPR[irq] = (uint8_t)(priority << 4); /* this chip has 4 bits of priority, the upper ones */
    NVIC_ISER[irq / 32u] = 1u << (irq % 32u);
}

static inline void disable_interrupt(uint32_t irq) { NVIC_ICER[irq / 32u] = 1u << (irq % 32u); }

/* Enabled again, and called once although nothing may have happened. */
static inline void pend_interrupt(uint32_t irq) {
    NVIC_ISPR[irq / 32u] = 1u << (irq % 32u);
    NVIC_ISER[irq / 32u] = 1u << (irq % 32u);
}

#endif
