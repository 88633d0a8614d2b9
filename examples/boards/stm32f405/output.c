/* From the core to the amplifier: two DAC channels whose difference is the drive voltage.
 *
 * Both channels are at the same voltage when nothing is driven, also in reset, when their pins
 * float and resistors pull both to ground; the amplifier's enable has a pull-down of its own. The
 * DAC takes its samples by DMA from a ring of two halves, clocked by TIM8, so that no program
 * decides when a sample leaves. Whenever a half has been played, its interrupt fills it again.
 *
 * The digital line of marks takes its levels in the same way and by the same clock: from a second
 * ring, by DMA2, into the register that sets and resets the pins of port B. At a clock the DAC
 * takes what was written to it at the clock before (RM0090, 14.3.4), a pin what is written now: so
 * the line's ring is one sample behind.
 *
 * If that interrupt stays away, the DMA would play the ring over and over: then nothing feeds the
 * independent watchdog, and the chip is reset within 5.4 to 15 ms (its oscillator has 17 to 47 kHz).
 */
#include "board.h"
#include "registers.h"

#define MIDDLE 2048u
/* Of the read-back, in codes: the ADC's error, and what the amplifier lags behind a carrier. */
#define READ_BACK_TOLERANCE 3000
#define ENABLE_PIN 0u /* PB0 */
#define LINE_PIN 1u   /* PB1 */
#define LINE_HIGH (1u << LINE_PIN)
#define LINE_LOW (1u << (16u + LINE_PIN))

hx_device board_device;

static uint32_t ring[2u * BOARD_HALF_SAMPLES];
static uint32_t line_ring[2u * BOARD_HALF_SAMPLES];
static int16_t codes_sent[2u * BOARD_HALF_SAMPLES];
static uint16_t adc_ring[2u * BOARD_HALF_SAMPLES];
static uint32_t half_to_fill;
static volatile uint32_t patience;

static uint32_t as_dac(int16_t code) {
    /* 16 bits to 12: channel 2 stays in the middle, channel 1 moves around it. */
    uint32_t moved = (uint32_t)((int32_t)MIDDLE * 16 + code) >> 4;
    return MIDDLE << 16 | moved;
}

/* What left in a half that has been played, against what was sent: the ADC is one sample behind. */
static void read_back(uint32_t half) {
#ifndef BOARD_EMULATED
    static int16_t found[BOARD_HALF_SAMPLES];
    const uint16_t *measured = adc_ring + half * BOARD_HALF_SAMPLES;
    for (uint32_t i = 0; i < BOARD_HALF_SAMPLES; i++)
        found[i] = (int16_t)(((int32_t)measured[i] - (int32_t)MIDDLE) * 16);
    hx_device_read_back(&board_device, codes_sent + half * BOARD_HALF_SAMPLES, found + 1,
                        BOARD_HALF_SAMPLES - 1u, READ_BACK_TOLERANCE);
#else
    (void)adc_ring, (void)half;
#endif
}

static void fill(uint32_t *half, uint32_t *line_half, int16_t *codes) {
    static uint8_t what[BOARD_HALF_SAMPLES];
    static uint32_t line = LINE_LOW; /* of the sample before */
    hx_device_play(&board_device, codes, what, BOARD_HALF_SAMPLES);
    for (uint32_t i = 0; i < BOARD_HALF_SAMPLES; i++) {
        half[i] = as_dac(codes[i]);
        line_half[i] = line;
        line = what[i] & HX_OUT_LINE ? LINE_HIGH : LINE_LOW;
    }
#ifdef BOARD_EMULATED
    /* The emulator has no DAC: what would go to it goes out of the second port. Out of the third
     * goes where the line's ring changes, in output samples: 4 bytes each. */
    static uint32_t shown = LINE_LOW;
    static uint32_t played;
    for (uint32_t i = 0; i < BOARD_HALF_SAMPLES; i++) {
        USART2->DR = (uint16_t)codes[i] & 0xffu;
        USART2->DR = (uint16_t)codes[i] >> 8;
        if (line_half[i] != shown)
            for (uint32_t shift = 0; shift < 32u; shift += 8u) USART3->DR = (played + i) >> shift & 0xffu;
        shown = line_half[i];
    }
    played += BOARD_HALF_SAMPLES;
#endif
}

void board_output_interrupt(void) {
#ifdef BOARD_EMULATED
    TIM2->SR = 0;
    uint32_t half = half_to_fill;
#else
    uint32_t half = DMA1_HISR & 1u << 10 ? 0u : 1u; /* half transferred: the first one is free */
    DMA1_HIFCR = 0x3du << 6;
#endif
    read_back(half);
    fill(ring + half * BOARD_HALF_SAMPLES, line_ring + half * BOARD_HALF_SAMPLES,
         codes_sent + half * BOARD_HALF_SAMPLES);
    half_to_fill = half ^ 1u;
    /* A core that is not whole is at 0 V within 2 halves; then its enable falls, and it is reset. */
    if (!hx_device_is_whole(&board_device)) {
        if (hx_device_pending(&board_device) == 0) GPIOB->BSRR = 1u << (16u + ENABLE_PIN);
    } else if (patience > 0) {
        patience--;
        IWDG_KR = 0xaaaau;
    }
}

void board_output_loop_ran(void) { patience = BOARD_PATIENCE_HALVES; }

void board_output_mask(void) {
    __asm__ volatile("msr basepri, %0" ::"r"(BOARD_PRIORITY_OUTPUT << 4) : "memory");
}

void board_output_unmask(void) { __asm__ volatile("msr basepri, %0" ::"r"(0) : "memory"); }

void board_output_off(void) {
    GPIOB->BSRR = 1u << (16u + ENABLE_PIN);
    DMA1_STREAM5->CR = 0;
    DMA2_STREAM1->CR = 0;
    GPIOB->BSRR = LINE_LOW;
    DAC->CR = 1u << 16 | 1u; /* without a trigger: what follows stands at once */
    DAC->DHR12RD = MIDDLE << 16 | MIDDLE;
}

static void begin_watchdog(void) {
    IWDG_KR = 0x5555u;
    IWDG_PR = 0;       /* 32 kHz / 4 */
    IWDG_RLR = 64u;    /* 8 ms */
    IWDG_KR = 0xccccu; /* it cannot be stopped again */
}

void board_output_prove_watchdog(void) {
    board_output_off();
    begin_watchdog();
    for (;;) {
    }
}

/* PA1 measures the amplifier's monitor output around half the supply, at the DAC's clock. */
static void begin_adc(void) {
    GPIOA->MODER |= 3u << 2;
    RCC->APB2ENR |= 1u << 8;
    DMA2_STREAM0->PAR = (uint32_t)&ADC1->DR;
    DMA2_STREAM0->M0AR = (uint32_t)adc_ring;
    DMA2_STREAM0->NDTR = 2u * BOARD_HALF_SAMPLES;
    /* channel 0, half words, memory counts up, circular, from the ADC */
    DMA2_STREAM0->CR = 2u << 16 | 1u << 13 | 1u << 11 | 1u << 10 | 1u << 8 | 1u;
    ADC_CCR = 1u << 16; /* 84 MHz / 4 */
    ADC1->SQR3 = 1u;
    /* converts with TIM8's update, by DMA for ever */
    ADC1->CR2 = 1u << 28 | 14u << 24 | 1u << 9 | 1u << 8 | 1u;
}

static void begin_dac(void) {
    GPIOA->MODER |= 15u << 8; /* PA4, PA5 analog */
    for (uint32_t i = 0; i < 2u * BOARD_HALF_SAMPLES; i++) {
        ring[i] = MIDDLE << 16 | MIDDLE;
        line_ring[i] = LINE_LOW;
    }
    DMA1_STREAM5->PAR = (uint32_t)&DAC->DHR12RD;
    DMA1_STREAM5->M0AR = (uint32_t)ring;
    DMA1_STREAM5->NDTR = 2u * BOARD_HALF_SAMPLES;
    /* channel 7, high priority, words, memory counts up, circular, to the DAC, both interrupts */
    DMA1_STREAM5->CR = 7u << 25 | 2u << 16 | 2u << 13 | 2u << 11 | 1u << 10 | 1u << 8 | 1u << 6 |
                       1u << 4 | 1u << 3 | 1u;
    DMA2_STREAM1->PAR = (uint32_t)&GPIOB->BSRR;
    DMA2_STREAM1->M0AR = (uint32_t)line_ring;
    DMA2_STREAM1->NDTR = 2u * BOARD_HALF_SAMPLES;
    /* the same of channel 7 there, TIM8's update, without interrupts */
    DMA2_STREAM1->CR = 7u << 25 | 2u << 16 | 2u << 13 | 2u << 11 | 1u << 10 | 1u << 8 | 1u << 6 | 1u;
    /* both channels: enabled, triggered by TIM8; DMA requests by channel 1 */
    DAC->CR = 1u << 12 | 1u << 3 | 1u << 2 | 1u | 1u << 19 | 1u << 18 | 1u << 16;
    TIM8->PSC = 0;
    TIM8->ARR = BOARD_TIMER_HZ / BOARD_OUTPUT_HZ - 1u;
    TIM8->CR2 = 2u << 4;   /* its update triggers the DAC */
    TIM8->DIER = 1u << 8;  /* and asks for a level of the line */
    TIM8->CR1 = 1u;
}

void board_output_begin(void) {
    board_output_loop_ran();
    board_output_off();
    begin_adc();
    begin_dac();
    begin_watchdog();
#ifdef BOARD_EMULATED
    /* The emulator has neither the DAC's timer nor DMA; its TIM2 counts nanoseconds. The output is
     * BOARD_EMULATED times slower than it says, so that a busy computer keeps up with it. */
    USART2->CR1 = USART3->CR1 = 1u << 13 | 1u << 3;
    TIM2->PSC = 0;
    TIM2->ARR = (uint32_t)(1000000000ull * BOARD_EMULATED * BOARD_HALF_SAMPLES / BOARD_OUTPUT_HZ) - 1u;
    TIM2->DIER = 1u;
    enable_interrupt(IRQ_TIM2, BOARD_PRIORITY_OUTPUT);
    TIM2->CR1 = 1u;
#else
    enable_interrupt(IRQ_DMA1_STREAM5, BOARD_PRIORITY_OUTPUT);
#endif
    GPIOB->BSRR = 1u << ENABLE_PIN;
}
