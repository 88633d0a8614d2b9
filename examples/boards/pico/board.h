/* A driver board with a Raspberry Pi Pico or Pico 2: what its parts say to each other, and the numbers to choose. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

#include "haptix_device.h"

/* Output samples a second: 125 MHz 6 / 15625, by the DMA's pacing timer. */
#define BOARD_OUTPUT_HZ 48000u
#define BOARD_TIMER_X 6u
#define BOARD_TIMER_Y 15625u
/* Samples in a half of the converter's ring, a power of two as the DMA's rings are: 1.3 ms. */
#define BOARD_HALF_SAMPLES 64u
/* The main loop must come round once in this many halves, or nothing feeds the watchdog. */
#define BOARD_PATIENCE_HALVES 75u

/* Pins. The converter is on SPI0. */
#define PIN_CLOCK 2u
#define PIN_DATA 3u
#define PIN_SELECT 5u
#define PIN_ENABLE 6u
#define PIN_MARK 7u
#define PIN_LED 25u
#define PIN_MONITOR 26u

/* Bits of the converter: 16 (the whole frame), or 12 behind four bits of settings. */
#ifndef BOARD_CONVERTER_BITS
#define BOARD_CONVERTER_BITS 16
#endif

extern hx_device board_device;

/* startup.c: clocks, and what every fault ends in. */
void board_clocks_begin(void);

/* output.c: the converter, its amplifier, and the interrupt that fills its ring. */
void board_output_begin(void);
void board_output_off(void);
void board_output_interrupt(void);
/* Ends in a reset by the watchdog, which shows that it works. */
void board_output_prove_watchdog(void);
/* The main loop is alive. */
void board_output_loop_ran(void);
/* Around every call of the core but hx_device_play: keeps the output's interrupt out. */
void board_output_mask(void);
void board_output_unmask(void);

/* usb.c: the controller, up to hx_usb.h's calls. */
void board_usb_begin(void);
void board_usb_interrupt(void);
/* Sleep until the bus or the output has something to do: memory that goes bad then is noticed. */
void board_usb_wait(void);

#endif
