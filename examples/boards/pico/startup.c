/* From boot.S to main: memory, clocks; and what happens instead of every other interrupt. */
#include "board.h"
#include "registers.h"

extern uint32_t stack_top, bss_begin, bss_end;
int main(void);
void board_reset(void);

/* A fault, or an interrupt that nobody expects: output off, then the watchdog. */
static void give_up(void) {
    board_output_off();
    for (;;) {
    }
}

typedef void (*handler)(void);

static void interrupt(void) {
    uint32_t exception;
    __asm__("mrs %0, ipsr" : "=r"(exception));
    if (exception == 16u + IRQ_DMA0) board_output_interrupt();
    else if (exception == 16u + IRQ_USB) board_usb_interrupt();
    else give_up();
}

__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler exceptions[15];
    handler interrupts[IRQ_COUNT];
} vectors = {&stack_top, {board_reset, [1 ... 14] = give_up}, {[0 ... IRQ_COUNT - 1] = interrupt}};

/* The compiler may call these although there is no C library. */
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

static void begin_pll(pll_registers *pll, uint32_t multiple, uint32_t divide1, uint32_t divide2) {
    pll->CS = 1u; /* the crystal as it is */
    pll->FBDIV = multiple;
    CLEAR(pll->PWR) = 1u | 1u << 5; /* main power, oscillator */
    while (!(pll->CS & 1u << 31)) {
    }
    pll->PRIM = divide1 << 16 | divide2 << 12;
    CLEAR(pll->PWR) = 1u << 3; /* dividers */
}

/* 12 MHz crystal: 125 MHz for the processor, SPI and DMA, 48 MHz for USB and the ADC. */
void board_clocks_begin(void) {
    const uint32_t used = RESET_PLL_SYS | RESET_PLL_USB | RESET_IO_BANK0 | RESET_PADS_BANK0 | RESET_DMA |
                          RESET_SPI0 | RESET_ADC | RESET_USB;
    XOSC->STARTUP = 47u; /* 1 ms */
    XOSC->CTRL = 0xfabu << 12 | 0xaa0u;
    while (!(XOSC->STATUS & 1u << 31)) {
    }
    CLK_REF->CTRL = 2u; /* the crystal */
    while (!(CLK_REF->SELECTED & 1u << 2)) {
    }
    CLEAR(CLK_SYS->CTRL) = 1u; /* the processor too, while its PLL begins */
    while (!(CLK_SYS->SELECTED & 1u)) {
    }
    SET(RESETS->RESET) = used;
    CLEAR(RESETS->RESET) = used & ~(uint32_t)(RESET_ADC | RESET_USB);
    while (~RESETS->DONE & used & ~(uint32_t)(RESET_ADC | RESET_USB)) {
    }
    begin_pll(PLL_SYS, 125u, 6u, 2u);
    begin_pll(PLL_USB, 100u, 5u, 5u);
    CLK_SYS->CTRL = 1u; /* its PLL */
    while (!(CLK_SYS->SELECTED & 1u << 1)) {
    }
    CLK_PERI->CTRL = 1u << 11;
    CLK_USB->CTRL = 1u << 11;
    CLK_ADC->CTRL = 1u << 11;
    CLEAR(RESETS->RESET) = RESET_ADC | RESET_USB;
    while (~RESETS->DONE & (RESET_ADC | RESET_USB)) {
    }
    begin_microseconds(); /* for the watchdog */
}

void board_reset(void) {
    for (uint32_t *to = &bss_begin; to < &bss_end;) *to++ = 0;
    board_clocks_begin();
    main();
    give_up();
}
