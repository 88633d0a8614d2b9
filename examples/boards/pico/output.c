/* From the core to the amplifier: a converter on SPI whose middle is 0 V.
 *
 * The DMA writes its samples, from a ring of two halves, at the pace of a timer of its own, so that no
 * program decides when a sample leaves. Two channels take turns: each plays a half, and starts the other
 * at its end. Whenever one has ended, its interrupt fills its half again.
 *
 * The digital line of marks takes its levels in the same way and at the same pace, from a second ring,
 * by the override of its pin (RP2040 datasheet, 2.19.6.1). The ADC measures the amplifier's monitor at
 * the same rate, by the same crystal, into a third.
 *
 * If that interrupt stays away, the DMA would play the ring over and over: then nothing feeds the
 * watchdog, and the chip is reset within 8 ms. In reset all pins float, and the resistor at the
 * amplifier's enable switches it off. The watchdog counts the crystal's clock, which the samples count as well.
 */
#include "board.h"
#include "registers.h"

/* Of the read-back, in codes: the ADC's error, and what the amplifier lags behind a carrier. */
#define READ_BACK_TOLERANCE 3000
#define WATCHDOG_LOAD (8000u * WATCHDOG_COUNTS_PER_US)
#define LINE_LOW (FUNCTION_SIO | OUTPUT_LOW)
#define LINE_HIGH (FUNCTION_SIO | OUTPUT_HIGH)
/* Channels: two for each ring. */
enum { PLAYS = 0, MARKS = 2, MEASURES = 4 };
#define HALF_WORDS 1u
#define WORDS 2u

hx_device board_device;

/* A ring of the DMA begins at a multiple of its size. */
#define RING __attribute__((section(".ring"), aligned(256)))
RING static uint32_t line_ring[2][BOARD_HALF_SAMPLES];
RING static uint16_t ring[2][BOARD_HALF_SAMPLES];
RING static uint16_t adc_ring[2][BOARD_HALF_SAMPLES];
static int16_t codes_sent[2][BOARD_HALF_SAMPLES];
static volatile uint32_t patience;

static uint16_t as_frame(int16_t code) {
    uint32_t moved = (uint32_t)((int32_t)code + 32768);
#if BOARD_CONVERTER_BITS == 12
    return (uint16_t)(0x3000u | moved >> 4); /* single gain, active */
#else
    return (uint16_t)moved;
#endif
}

/* What left in a half that has been played, against what was sent: the ADC is one sample behind. */
static void read_back(uint32_t half) {
    static int16_t found[BOARD_HALF_SAMPLES];
    for (uint32_t i = 0; i < BOARD_HALF_SAMPLES; i++)
        found[i] = (int16_t)(((int32_t)(adc_ring[half][i] & 0xfffu) - 2048) * 16);
    hx_device_read_back(&board_device, codes_sent[half], found + 1, BOARD_HALF_SAMPLES - 1u,
                        READ_BACK_TOLERANCE);
}

static void fill(uint32_t half) {
    static uint8_t what[BOARD_HALF_SAMPLES];
    hx_device_play(&board_device, codes_sent[half], what, BOARD_HALF_SAMPLES);
    for (uint32_t i = 0; i < BOARD_HALF_SAMPLES; i++) {
        ring[half][i] = as_frame(codes_sent[half][i]);
        line_ring[half][i] = what[i] & HX_OUT_LINE ? LINE_HIGH : LINE_LOW;
    }
}

void board_output_interrupt(void) {
    static uint32_t halves;
    uint32_t ended = DMA_INTS0 & 3u;
    DMA_INTS0 = ended;
    /* Both have ended: the interrupt is a half late, and what left was played twice. */
    if (ended == 3u) {
        board_output_off();
        for (;;) {
        }
    }
    uint32_t half = ended >> 1;
    read_back(half);
    fill(half);
    /* A core that is not whole is at 0 V within 2 halves; then its enable falls, and it is reset. */
    if (!hx_device_is_whole(&board_device)) {
        if (hx_device_pending(&board_device) == 0) SIO_OUT_CLEAR = 1u << PIN_ENABLE;
    } else if (patience > 0) {
        patience--;
        WATCHDOG->LOAD = WATCHDOG_LOAD;
    }
    if (++halves % 256u == 0) SIO_OUT_SET = 1u << PIN_LED;
    if (halves % 256u == 128u) SIO_OUT_CLEAR = 1u << PIN_LED;
}

void board_output_loop_ran(void) { patience = BOARD_PATIENCE_HALVES; }

void board_output_mask(void) { __asm__ volatile("cpsid i" ::: "memory"); }

void board_output_unmask(void) { __asm__ volatile("cpsie i" ::: "memory"); }

void board_output_off(void) {
    SIO_OUT_CLEAR = 1u << PIN_ENABLE;
    /* A channel that is aborted could be started again by the one before it (erratum RP2350-E5). */
    for (uint32_t i = 0; i < 6u; i++) CLEAR(DMA[i].CTRL) = 1u;
    DMA_ABORT = 0x3fu;
    GPIO_CTRL(PIN_MARK) = LINE_LOW;
    if (SPI0->CR1 & 1u << 1) SPI0->DR = as_frame(0); /* before it is set up, it would wait in the queue */
}

static void begin_watchdog(void) {
    CLEAR(WATCHDOG->CTRL) = 1u << 30;
    PSM_WDSEL = PSM_BUT_OSCILLATORS; /* which it resets */
    WATCHDOG->LOAD = WATCHDOG_LOAD;
    WATCHDOG->CTRL = 1u << 30; /* and does not pause for a debugger */
}

void board_output_prove_watchdog(void) {
    board_output_off();
    begin_watchdog();
    for (;;) {
    }
}

/* Two channels that take turns at the halves of a ring: from it, or into it. */
static void begin_channels(uint32_t first, const volatile void *halves, uint32_t half_bits, uint32_t size,
                           volatile void *port, uint32_t pace, int is_read) {
    for (uint32_t i = 0; i < 2u; i++) {
        uint32_t half = (uint32_t)(uintptr_t)halves + (i << half_bits);
        dma_registers *channel = &DMA[first + i];
        channel->READ = is_read ? (uint32_t)(uintptr_t)port : half;
        channel->WRITE = is_read ? half : (uint32_t)(uintptr_t)port;
        channel->COUNT = BOARD_HALF_SAMPLES;
        channel->CTRL = pace << DMA_PACE | (first + (i ^ 1u)) << DMA_NEXT |
                        (is_read ? (uint32_t)(DMA_RING_IS_WRITTEN | DMA_WRITES_ON) : 1u << 4) |
                        half_bits << DMA_RING_BITS | size << 2 | 1u << 1 | 1u;
    }
}

static void begin_pins(void) {
    SIO_OUT_CLEAR = 1u << PIN_ENABLE | 1u << PIN_MARK | 1u << PIN_LED;
    SIO_OE_SET = 1u << PIN_ENABLE | 1u << PIN_MARK | 1u << PIN_LED;
    GPIO_CTRL(PIN_ENABLE) = GPIO_CTRL(PIN_LED) = FUNCTION_SIO;
    GPIO_CTRL(PIN_MARK) = LINE_LOW;
    GPIO_CTRL(PIN_CLOCK) = GPIO_CTRL(PIN_DATA) = GPIO_CTRL(PIN_SELECT) = FUNCTION_SPI;
    GPIO_CTRL(PIN_MONITOR) = FUNCTION_NONE;
    PAD(PIN_MONITOR) = 1u << 7; /* neither output nor input buffer nor pull: analog */
    const uint32_t pins = 1u << PIN_CLOCK | 1u << PIN_DATA | 1u << PIN_SELECT | 1u << PIN_ENABLE | 1u << PIN_MARK |
                          1u << PIN_LED;
    for (uint32_t pin = 0; pins >> pin; pin++)
        if (pins >> pin & 1u) CLEAR(PAD(pin)) = PAD_ISOLATED;
}

void board_output_begin(void) {
    board_output_loop_ran();
    begin_pins();
    SPI0->CPSR = 2u;
    SPI0->CR0 = 2u << 8 | 15u; /* 20.8 MHz, frames of 16 bits, the select rises behind each */
    SPI0->CR1 = 1u << 1;
    SPI0->DR = as_frame(0);
    for (uint32_t i = 0; i < BOARD_HALF_SAMPLES; i++) {
        ring[0][i] = ring[1][i] = as_frame(0);
        line_ring[0][i] = line_ring[1][i] = LINE_LOW;
    }
    DMA_TIMER0 = BOARD_TIMER_X << 16 | BOARD_TIMER_Y;
    begin_channels(PLAYS, ring, 7u, HALF_WORDS, &SPI0->DR, PACED_BY_TIMER0, 0);
    begin_channels(MARKS, line_ring, 8u, WORDS, &GPIO_CTRL(PIN_MARK), PACED_BY_TIMER0, 0);
    begin_channels(MEASURES, adc_ring, 7u, HALF_WORDS, &ADC->FIFO, PACED_BY_ADC, 1);
    DMA_INTS0 = 0x3fu;
    DMA_INTE0 = 1u << PLAYS | 1u << (PLAYS + 1u);
    NVIC_ISER = 1u << IRQ_DMA0;
    ADC->CS = 1u; /* on, channel 0 */
    while (!(ADC->CS & 1u << 8)) {
    }
    ADC->FCS = 1u << 24 | 1u << 3 | 1u;      /* by DMA, from the first sample on */
    ADC->DIV = (48000000u / BOARD_OUTPUT_HZ - 1u) << 8;
    begin_watchdog();
    DMA_START = 1u << PLAYS | 1u << MARKS | 1u << MEASURES;
    ADC->CS = 1u << 3 | 1u; /* for ever */
    SIO_OUT_SET = 1u << PIN_ENABLE;
}
