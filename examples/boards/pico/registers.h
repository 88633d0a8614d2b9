/* The registers that this board uses, from the datasheets of RP2040 and RP2350 and ARM's manuals of ARMv6-M
 * and ARMv8-M. What both chips have alike is here. */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stdint.h>

typedef volatile uint32_t reg;

/* The same register again, where a write sets or clears the bits that are 1. */
#define SET(register) (*(reg *)((uintptr_t)&(register) + 0x2000u))
#define CLEAR(register) (*(reg *)((uintptr_t)&(register) + 0x3000u))

typedef struct {
    reg RESET, WDSEL, DONE;
} resets_registers;
typedef struct {
    reg CTRL, STATUS, DORMANT, STARTUP;
} xosc_registers;
typedef struct {
    reg CS, PWR, FBDIV, PRIM;
} pll_registers;
typedef struct {
    reg CTRL, DIV, SELECTED;
} clock_registers;
typedef struct {
    reg CR0, CR1, DR, SR, CPSR, IMSC, RIS, MIS, ICR, DMACR;
} spi_registers;
typedef struct {
    reg CS, RESULT, FCS, FIFO, DIV;
} adc_registers;
typedef struct {
    reg CTRL, LOAD, REASON, SCRATCH[8], TICK;
} watchdog_registers;

#ifdef __ARM_ARCH_8M_MAIN__
#include "rp2350.h"
#else
#include "rp2040.h"
#endif

enum { FUNCTION_SPI = 1, FUNCTION_SIO = 5, FUNCTION_NONE = 31 };

typedef struct {
    reg READ, WRITE, COUNT, TRIGGER, CTRL, more[11];
} dma_registers;
#define DMA ((dma_registers *)0x50000000u)
#define DMA_INTE0 (*(reg *)0x50000404u)
#define DMA_INTS0 (*(reg *)0x5000040cu)

/* Offsets of the controller's memory: RP2040 datasheet, 4.1.2.5. */
typedef struct {
    reg ADDRESS, more0[15], MAIN, SOF_WRITE, SOF, SIE, STATUS, INT_EP, BUFFERS, more1[2], ABORTED;
    reg STALL_ARM, NAK_POLL, STALL_NAK, MUXING, POWER, PHY[3], more2, INTR, INTE, INTF, INTS;
} usb_registers;
#define USB ((usb_registers *)0x50110000u)
#define USB_MEMORY 0x50100000u

/* ARMv6-M, B3.4 */
#define NVIC_ISER (*(reg *)0xe000e100u)
#define NVIC_ICER (*(reg *)0xe000e180u)

#endif
