/* Where the RP2040 has its registers, and what it has alone: its datasheet's sections. */
#ifndef RP2040_H
#define RP2040_H

#define BOARD_NAME "pico"

/* 2.14 */
#define RESETS ((resets_registers *)0x4000c000u)
enum {
    RESET_ADC = 1 << 0,
    RESET_DMA = 1 << 2,
    RESET_IO_BANK0 = 1 << 5,
    RESET_PADS_BANK0 = 1 << 8,
    RESET_PLL_SYS = 1 << 12,
    RESET_PLL_USB = 1 << 13,
    RESET_SPI0 = 1 << 16,
    RESET_USB = 1 << 24
};

/* 2.13: all but the oscillators */
#define PSM_WDSEL (*(reg *)0x40010008u)
#define PSM_BUT_OSCILLATORS 0x1fffcu

/* 2.16 and 2.18 */
#define XOSC ((xosc_registers *)0x40024000u)
#define PLL_SYS ((pll_registers *)0x40028000u)
#define PLL_USB ((pll_registers *)0x4002c000u)

/* 2.15.7 */
#define CLK_REF ((clock_registers *)0x40008030u)
#define CLK_SYS ((clock_registers *)0x4000803cu)
#define CLK_PERI ((clock_registers *)0x40008048u)
#define CLK_USB ((clock_registers *)0x40008054u)
#define CLK_ADC ((clock_registers *)0x40008060u)

/* 2.19.6 */
#define GPIO_CTRL(pin) (*(reg *)(0x40014004u + 8u * (pin)))
#define PAD(pin) (*(reg *)(0x4001c004u + 4u * (pin)))
#define PAD_ISOLATED 0u
enum { OUTPUT_LOW = 2 << 8, OUTPUT_HIGH = 3 << 8 };

/* 2.3.1.7 */
#define SIO_OUT_SET (*(reg *)0xd0000014u)
#define SIO_OUT_CLEAR (*(reg *)0xd0000018u)
#define SIO_OE_SET (*(reg *)0xd0000024u)

/* 4.4.4 and 4.9.6 */
#define SPI0 ((spi_registers *)0x4003c000u)
#define ADC ((adc_registers *)0x4004c000u)

/* 4.7.6; it counts twice in a microsecond (erratum RP2040-E1) */
#define WATCHDOG ((watchdog_registers *)0x40058000u)
#define WATCHDOG_COUNTS_PER_US 2u
static inline void begin_microseconds(void) { WATCHDOG->TICK = 1u << 9 | 12u; }

/* 2.5.7 */
#define DMA_TIMER0 (*(reg *)0x50000420u)
#define DMA_START (*(reg *)0x50000430u)
#define DMA_ABORT (*(reg *)0x50000444u)
enum { PACED_BY_ADC = 36, PACED_BY_TIMER0 = 59 };
enum { DMA_WRITES_ON = 1 << 5, DMA_RING_BITS = 6, DMA_RING_IS_WRITTEN = 1 << 10, DMA_NEXT = 11, DMA_PACE = 15 };

/* 2.3.2 */
enum { IRQ_USB = 5, IRQ_DMA0 = 11, IRQ_COUNT = 26 };

#endif
