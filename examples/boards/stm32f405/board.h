/* A driver board with an STM32F405: what its parts say to each other, and the numbers to choose. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

#include "haptix_device.h"

/* Output samples a second. The DAC's timer runs at 168 MHz, which this divides: 168e6 / 48e3 = 3500.
 * Samples in a half of the DAC's buffer: 1 ms, and README.md derives the smallest. The emulator's
 * serial port takes some 3000 bytes a second, so the emulated board is slower. */
#ifdef BOARD_EMULATED
#define BOARD_OUTPUT_HZ 2000u
#define BOARD_HALF_SAMPLES 4u
#else
#define BOARD_OUTPUT_HZ 48000u
#define BOARD_HALF_SAMPLES 48u
#endif
#define BOARD_TIMER_HZ 168000000u

/* 84 MHz / 16 / 2.625. Samples of 16 bits at 48 kHz need 1.1 Mbit/s of it. */
#define BOARD_BAUD 2000000u

/* Lower number: more urgent. A byte of the host waits for nobody: the next comes after 5 us. */
#define BOARD_PRIORITY_SERIAL 1u
#define BOARD_PRIORITY_OUTPUT 2u

/* The main loop must come round once in this many halves, or nothing feeds the watchdog. */
#define BOARD_PATIENCE_HALVES 100u

extern hx_device board_device;

/* output.c: the DAC, its amplifier, and the interrupt that fills its buffer. */
void board_output_begin(void);
void board_output_off(void);
/* Ends in a reset by the independent watchdog, which shows that it works. */
void board_output_prove_watchdog(void);
void board_output_interrupt(void);
/* The main loop is alive. */
void board_output_loop_ran(void);
/* Around every call of the core but hx_device_play: keeps the output's interrupt out. */
void board_output_mask(void);
void board_output_unmask(void);

/* serial.c: bytes from and to the host. */
void board_serial_begin(void);
void board_serial_interrupt(void);
/* Bytes that have come, at most `capacity`; their count. */
uint32_t board_serial_read(uint8_t *bytes, uint32_t capacity);
/* Sleep until a byte or an interrupt of the output has come. */
void board_serial_wait(void);
/* 1 if the byte was taken. */
int board_serial_write(uint8_t byte);

#endif
