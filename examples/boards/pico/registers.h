/* The registers that this board uses, from the RP2040 datasheet and ARM's ARMv6-M manual. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

typedef volatile uint32_t reg;

/* Datasheet 2.1.2: the same register again, where a write sets or clears the bits that are 1. */
#define SET(register) (*(reg *)((uintptr_t)&(register) + 0x2000u))
#define CLEAR(register) (*(reg *)((uintptr_t)&(register) + 0x3000u))

/* 2.14 */
typedef struct {
    reg RESET, WDSEL, DONE;
} resets_registers;
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

/* 2.13 */
#define PSM_WDSEL (*(reg *)0x40010008u)

/* 2.16 and 2.18 */
typedef struct {
    reg CTRL, STATUS, DORMANT, STARTUP;
} xosc_registers;
#define XOSC ((xosc_registers *)0x40024000u)
typedef struct {
    reg CS, PWR, FBDIV, PRIM;
} pll_registers;
#define PLL_SYS ((pll_registers *)0x40028000u)
#define PLL_USB ((pll_registers *)0x4002c000u)

/* 2.15.7 */
typedef struct {
    reg CTRL, DIV, SELECTED;
} clock_registers;
#define CLK_REF ((clock_registers *)0x40008030u)
#define CLK_SYS ((clock_registers *)0x4000803cu)
#define CLK_PERI ((clock_registers *)0x40008048u)
#define CLK_USB ((clock_registers *)0x40008054u)
#define CLK_ADC ((clock_registers *)0x40008060u)

/* 2.19.6 */
#define GPIO_CTRL(pin) (*(reg *)(0x40014004u + 8u * (pin)))
#define PAD(pin) (*(reg *)(0x4001c004u + 4u * (pin)))
enum { FUNCTION_SPI = 1, FUNCTION_SIO = 5, FUNCTION_NONE = 31, OUTPUT_LOW = 2 << 8, OUTPUT_HIGH = 3 << 8 };

/* 2.3.1.7 */
#define SIO_OUT_SET (*(reg *)0xd0000014u)
#define SIO_OUT_CLEAR (*(reg *)0xd0000018u)
#define SIO_OE_SET (*(reg *)0xd0000024u)

/* 4.4.4 */
typedef struct {
    reg CR0, CR1, DR, SR, CPSR, IMSC, RIS, MIS, ICR, DMACR;
} spi_registers;
#define SPI0 ((spi_registers *)0x4003c000u)

/* 4.9.6 */
typedef struct {
    reg CS, RESULT, FCS, FIFO, DIV;
} adc_registers;
#define ADC ((adc_registers *)0x4004c000u)

/* 4.7.6 */
typedef struct {
    reg CTRL, LOAD, REASON, SCRATCH[8], TICK;
} watchdog_registers;
#define WATCHDOG ((watchdog_registers *)0x40058000u)

/* 2.5.7 */
typedef struct {
    reg READ, WRITE, COUNT, TRIGGER, CTRL, more[11];
} dma_registers;
#define DMA ((dma_registers *)0x50000000u)
#define DMA_INTE0 (*(reg *)0x50000404u)
#define DMA_INTS0 (*(reg *)0x5000040cu)
#define DMA_TIMER0 (*(reg *)0x50000420u)
#define DMA_START (*(reg *)0x50000430u)
#define DMA_ABORT (*(reg *)0x50000444u)
enum { PACED_BY_ADC = 36, PACED_BY_TIMER0 = 59 };

/* 4.1.4; offsets of the controller's memory are those of 4.1.2.5 */
typedef struct {
    reg ADDRESS, more0[15], MAIN, SOF_WRITE, SOF, SIE, STATUS, INT_EP, BUFFERS, more1[2], ABORTED;
    reg STALL_ARM, NAK_POLL, STALL_NAK, MUXING, POWER, PHY[3], more2, INTR, INTE, INTF, INTS;
} usb_registers;
#define USB ((usb_registers *)0x50110000u)
#define USB_MEMORY 0x50100000u

/* ARMv6-M, B3.4 */
#define NVIC_ISER (*(reg *)0xe000e100u)
#define NVIC_ICER (*(reg *)0xe000e180u)
enum { IRQ_USB = 5, IRQ_DMA0 = 11, IRQ_COUNT = 26 };

#endif
