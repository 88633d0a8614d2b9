/* Bytes from and to the host on USART1 (PA9 out, PA10 in, PA12 RTS): a ring in, single bytes out. */
#include "board.h"
#include "registers.h"

/* What comes in 10 ms at full speed: the main loop is never that long away. */
#define RING_BYTES 2048u

static uint8_t ring[RING_BYTES];
static volatile uint32_t head, tail; /* the interrupt moves `head` alone, the loop `tail` alone */

void board_serial_interrupt(void) {
    while (USART1->SR & (1u << 5 | 1u << 3)) { /* a byte, or one that another pushed out */
        uint32_t next = (head + 1u) % RING_BYTES;
        if (next == tail) {
            /* Full: the byte stays where it is and RTS holds the host back, if the host heeds it.
             * If not, bytes are lost and the frame's CRC tells. */
            disable_interrupt(IRQ_USART1);
            return;
        }
        ring[head] = (uint8_t)USART1->DR;
        head = next;
    }
}

uint32_t board_serial_read(uint8_t *bytes, uint32_t capacity) {
    uint32_t n = 0;
    while (n < capacity && tail != head) {
        bytes[n++] = ring[tail];
        tail = (tail + 1u) % RING_BYTES;
    }
    if (n > 0) pend_interrupt(IRQ_USART1); /* for a byte that has waited */
    return n;
}

void board_serial_wait(void) {
    /* With interrupts held back none slips in between the question and the sleep, which it ends. */
    __asm__ volatile("cpsid i" ::: "memory");
    if (tail == head) __asm__ volatile("wfi");
    __asm__ volatile("cpsie i" ::: "memory");
}

int board_serial_write(uint8_t byte) {
    if (!(USART1->SR & 1u << 7)) return 0;
    USART1->DR = byte;
    return 1;
}

void board_serial_begin(void) {
    GPIOA->MODER |= 2u << 18 | 2u << 20 | 2u << 24; /* alternate function 7 */
    GPIOA->AFRH |= 7u << 4 | 7u << 8 | 7u << 16;
    USART1->BRR = BOARD_TIMER_HZ / BOARD_BAUD; /* APB2 runs as fast as the timers */
    USART1->CR3 = 1u << 8; /* RTS */
    USART1->CR1 = 1u << 13 | 1u << 5 | 1u << 3 | 1u << 2;
    enable_interrupt(IRQ_USART1, BOARD_PRIORITY_SERIAL);
}
