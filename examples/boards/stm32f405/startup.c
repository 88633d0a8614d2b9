/* From reset to main: memory, clock, brown-out; and what happens instead of every other interrupt. */
#include "board.h"
#include "registers.h"

extern uint32_t stack_top, data_begin, data_end, data_in_flash, bss_begin, bss_end;
int main(void);
void board_reset(void);

/* A fault, a voltage that falls, an interrupt that nobody expects: output off, then the watchdog. */
static void give_up(void) {
    board_output_off();
    for (;;) {
    }
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler exceptions[15];
    handler interrupts[IRQ_COUNT];
} vectors = {
    &stack_top,
    {board_reset, give_up, give_up, give_up, give_up, give_up, give_up, give_up, give_up, give_up,
     give_up, give_up, give_up, give_up, give_up},
    {[0 ... IRQ_COUNT - 1] = give_up,
     [IRQ_DMA1_STREAM5] = board_output_interrupt,
     [IRQ_TIM2] = board_output_interrupt,
     [IRQ_USART1] = board_serial_interrupt},
};

/* The compiler may call these two although there is no C library. */
void *memset(void *to, int value, unsigned n) {
    volatile uint8_t *bytes = to;
    while (n--) *bytes++ = (uint8_t)value;
    return to;
}

void *memcpy(void *to, const void *from, unsigned n) {
    volatile uint8_t *bytes = to;
    const uint8_t *source = from;
    while (n--) *bytes++ = *source++;
    return to;
}

/* 8 MHz crystal to 168 MHz; APB1 and its timers 42 and 84 MHz, APB2 and its 84 and 168 (RM0090, 7.2). */
static void begin_clock(void) {
#ifndef BOARD_EMULATED
    RCC->CR |= 1u << 16;
    while (!(RCC->CR & 1u << 17)) {
    }
    FLASH_ACR = 1u << 9 | 1u << 10 | 1u << 8 | 5u;
    RCC->PLLCFGR = 8u | 336u << 6 | 0u << 16 | 1u << 22 | 7u << 24;
    RCC->CR |= 1u << 24;
    while (!(RCC->CR & 1u << 25)) {
    }
    RCC->CFGR = 5u << 10 | 4u << 13;
    RCC->CFGR |= 2u;
    while ((RCC->CFGR & 12u) != 8u) {
    }
#endif
    RCC->AHB1ENR |= 1u | 1u << 1 | 1u << 21 | 1u << 22;       /* GPIOA, GPIOB, DMA1, DMA2 */
    RCC->APB1ENR |= 1u | 1u << 17 | 1u << 28 | 1u << 29;      /* TIM2, USART2, PWR, DAC */
    RCC->APB2ENR |= 1u << 1 | 1u << 4 | 1u << 14;             /* TIM8, USART1, SYSCFG */
}

/* Below 2.9 V the output goes off before the core fails; the brown-out reset is an option byte. */
static void begin_brown_out(void) {
    PWR_CR |= 7u << 5 | 1u << 4;
    EXTI_IMR |= 1u << 16;
    EXTI_RTSR |= 1u << 16;
    enable_interrupt(IRQ_PVD, 0);
}

void board_reset(void) {
    for (uint32_t *to = &data_begin, *from = &data_in_flash; to < &data_end;) *to++ = *from++;
    for (uint32_t *to = &bss_begin; to < &bss_end;) *to++ = 0;
    begin_clock();
    GPIOB->MODER |= 1u | 1u << 2; /* PB0: the amplifier's enable; PB1: the line; still low */
    begin_brown_out();
    main();
    give_up();
}
