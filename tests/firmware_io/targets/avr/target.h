/* An ATmega1284 that simavr emulates: an int has 16 bits. Constants lie in flash (FAR). */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#define FAR __flash

void board_main(void);

/* Over the serial port, which simavr shows; it ends where the processor sleeps for good. */
static void leave(const char *words, uint32_t is_well) {
    (void)is_well;
    UCSR0B = 1 << TXEN0;
    for (; *words; words++) {
        while (!(UCSR0A & 1 << UDRE0)) {
        }
        UDR0 = (uint8_t)*words;
    }
    while (!(UCSR0A & 1 << UDRE0)) {
    }
    cli();
    sleep_enable();
    for (;;) sleep_cpu();
}

int main(void) {
    board_main();
    return 0;
}
