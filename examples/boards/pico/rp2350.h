/* Where the RP2350 has its registers, and what it has alone: its datasheet's sections. */
#ifndef RP2350_H
#define RP2350_H

#define BOARD_NAME "pico2"

/* 7.5 */
#define RESETS ((resets_registers *)0x40020000u)
enum {
    RESET_ADC = 1 << 0,
    RESET_DMA = 1 << 2,
    RESET_IO_BANK0 = 1 << 6,
    RESET_PADS_BANK0 = 1 << 9,
    RESET_PLL_SYS = 1 << 14,
    RESET_PLL_USB = 1 << 15,
    RESET_SPI0 = 1 << 18,
    RESET_USB = 1 << 28
};

/* 7.4: all but the oscillators */
#define PSM_WDSEL (*(reg *)0x40018008u)
#define PSM_BUT_OSCILLATORS 0x01fffff3u

/* 8.2 and 8.6 */
#define XOSC ((xosc_registers *)0x40048000u)
#define PLL_SYS ((pll_registers *)0x40050000u)
#define PLL_USB ((pll_registers *)0x40058000u)

/* 8.1 */
#define CLK_REF ((clock_registers *)0x40010030u)
#define CLK_SYS ((clock_registers *)0x4001003cu)
#define CLK_PERI ((clock_registers *)0x40010048u)
#define CLK_USB ((clock_registers *)0x40010060u)
#define CLK_ADC ((clock_registers *)0x4001006cu)

/* 9.11; a pad keeps its level until it is let go (9.7) */
#define GPIO_CTRL(pin) (*(reg *)(0x40028004u + 8u * (pin)))
#define PAD(pin) (*(reg *)(0x40038004u + 4u * (pin)))
#define PAD_ISOLATED (1u << 8)
enum { OUTPUT_LOW = 2 << 12, OUTPUT_HIGH = 3 << 12 };

/* 3.1.11 */
#define SIO_OUT_SET (*(reg *)0xd0000018u)
#define SIO_OUT_CLEAR (*(reg *)0xd0000020u)
#define SIO_OE_SET (*(reg *)0xd0000038u)

/* 12.3 and 12.4 */
#define SPI0 ((spi_registers *)0x40080000u)
#define ADC ((adc_registers *)0x400a0000u)

/* 12.9, and 8.5: the ticks are made apart from it */
#define WATCHDOG ((watchdog_registers *)0x400d8000u)
#define WATCHDOG_COUNTS_PER_US 1u
#define TICKS_WATCHDOG_CTRL (*(reg *)0x40108030u)
#define TICKS_WATCHDOG_CYCLES (*(reg *)0x40108034u)
static inline void begin_microseconds(void) {
    TICKS_WATCHDOG_CYCLES = 12u;
    TICKS_WATCHDOG_CTRL = 1u;
}

/* 12.6 */
#define DMA_TIMER0 (*(reg *)0x50000440u)
#define DMA_START (*(reg *)0x50000450u)
#define DMA_ABORT (*(reg *)0x50000464u)
enum { PACED_BY_ADC = 48, PACED_BY_TIMER0 = 59 };
enum { DMA_WRITES_ON = 1 << 6, DMA_RING_BITS = 8, DMA_RING_IS_WRITTEN = 1 << 12, DMA_NEXT = 13, DMA_PACE = 17 };

/* 3.2 */
enum { IRQ_USB = 14, IRQ_DMA0 = 10, IRQ_COUNT = 52 };

#endif
