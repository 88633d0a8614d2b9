/* Instructions of an engine's block of 1 ms, counted by qemu (-icount shift=0: one is 1 ns). */
#include "haptix_native.h"
#include "startup.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xe000e010)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xe000e014)
#define SYSTICK (*(volatile uint32_t *)0xe000e018)
#define CPACR (*(volatile uint32_t *)0xe000ed88)
enum { NS_PER_TICK = 40, BLOCKS = 120, SETTLED = 60, RAM = 3 << 20 };

/* Where qemu loads the program of a touch, which has its size at 16. */
static const uint8_t *const program = (const uint8_t *)0x200000;
static double memory[RAM / 8];

static void say(uint32_t number)
{
    char text[12];
    uint32_t at = sizeof text - 1;
    text[at] = 0;
    text[--at] = '\n';
    do
        text[--at] = (char)('0' + number % 10);
    while ((number /= 10) > 0);
    call_host(0x04, text + at);
}

static __attribute__((noinline)) void play(void)
{
    int64_t size = *(const uint32_t *)(const void *)(program + 16), room = hx_engine_size(program, size);
    uint32_t sum = 0, fingers = 0;
    if (room < 0 || room > RAM)
        leave("refused\n", 0);
    hx_engine *engine = hx_engine_open(program, size, memory);
    for (int32_t i = 0; i < BLOCKS; i++) {
        double t_s = 1e-3 * i;
        if (i % 8 == 0) /* 125 reports a second */
            hx_engine_touch(engine, 0, t_s, 5 + 80 * t_s, 6 + 10 * t_s, 0.5, 1);
        uint32_t begin = SYSTICK;
        fingers += (uint32_t)hx_engine_block(engine, HX_POINTS)->fingers;
        sum += i < SETTLED ? 0 : (begin - SYSTICK) & 0xffffff;
    }
    say((uint32_t)room);
    say(fingers);
    say(sum * NS_PER_TICK / (BLOCKS - SETTLED));
    leave("", 1);
}

void board_main(void)
{
    CPACR |= 0xf << 20; /* the floating-point unit */
    __asm__ volatile("dsb\n isb");
    SYSTICK_RELOAD = 0xffffff;
    SYSTICK = 0;
    SYSTICK_CONTROL = 5;
    play();
}

int main(void) { return 0; } /* the linker asks for one; the board begins at reset */
