/* An emulated RP2040 or RP2350, started by the Pico's boot.S; a breakpoint ends it. */
#define FAR

extern uint32_t stack_top, bss_begin, bss_end;
void board_main(void);
void board_reset(void);
void stuck(void);

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &stack_top, (void *)board_reset, (void *)stuck, (void *)stuck};

void *memset(void *to, int value, unsigned n) {
    volatile uint8_t *bytes = to;
    while (n--) *bytes++ = (uint8_t)value;
    return to;
}

void *memcpy(void *to, const void *from, unsigned n) {
    volatile uint8_t *bytes = to;
    const uint8_t *source = from;
    while (n--) *bytes++ = *source++;
    return to;
}

static void leave(const char *words, uint32_t is_well) {
    register const char *r0 __asm__("r0") = words;
    (void)is_well;
    __asm__ volatile("bkpt 0" ::"r"(r0));
    for (;;) {
    }
}

void stuck(void) { leave("a hard fault\n", 0); }

void board_reset(void) {
    for (uint32_t *to = &bss_begin; to < &bss_end;) *to++ = 0;
    board_main();
}
