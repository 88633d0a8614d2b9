/* The engine for a web page: one engine in memory of its own, by numbers that JavaScript has.
 *
 * scripts/make-engine.py makes src/engine.wasm of it. */
#include <stddef.h>
#include <stdint.h>

#include "haptix_native.h"

enum { PAGE = 65536, ALIGNED = 16 };

extern unsigned char __heap_base; /* of the linker: what is behind is free */

static hx_engine *engine;
static uint8_t *program;

/* What a block was made of: numbers, and addresses of arrays. */
static struct {
    double sample_rate_hz, highest_v, first_sample;
    int32_t fingers, points, step;
    uint32_t x_mm, y_mm, force_n, wanted_mu, felt_mu, status, amplitude_v, drive_v;
} felt;

static uint32_t address(const void *at) { return (uint32_t)(uintptr_t)at; }

/* Grow the memory to hold so many bytes from an address on; whether there is as much. */
static int reserve(uint32_t from, int64_t bytes)
{
    int64_t pages = ((int64_t)from + bytes + PAGE - 1) / PAGE;
    int64_t more = pages - (int64_t)__builtin_wasm_memory_size(0);
    return more <= 0 || (more < PAGE && __builtin_wasm_memory_grow(0, (size_t)more) != (size_t)-1);
}

static uint32_t aligned(uint32_t at) { return (at + ALIGNED - 1) / ALIGNED * ALIGNED; }

/* Address to which a program of so many bytes is to be written; 0 if there is no memory. */
__attribute__((export_name("space"))) uint32_t space(uint32_t size)
{
    uint32_t at = aligned(address(&__heap_base));
    engine = NULL;
    if (size > 1u << 30 || !reserve(at, size))
        return 0;
    program = (uint8_t *)(uintptr_t)at;
    return at;
}

/* Open the program that was written there; 0, or why it is refused. */
__attribute__((export_name("open"))) int32_t open_program(uint32_t size)
{
    int64_t bytes = hx_engine_size(program, size);
    uint32_t at = aligned(address(program) + size);
    if (bytes < 0)
        return (int32_t)bytes;
    if (!reserve(at, bytes))
        return HX_TOO_LARGE;
    engine = hx_engine_open(program, size, (void *)(uintptr_t)at);
    return 0;
}

__attribute__((export_name("touch"))) int32_t touch(int32_t id, double t_s, double x_mm,
                                                    double y_mm, double force_n, int32_t is_down)
{
    return engine ? (int32_t)hx_engine_touch(engine, id, t_s, x_mm, y_mm, force_n, is_down) : 0;
}

/* Play the next points; the address of `felt`, 0 without a program or for a wrong number. */
__attribute__((export_name("block"))) uint32_t block(int32_t points)
{
    if (!engine || points < 1 || points > HX_POINTS)
        return 0;
    const hx_felt *f = hx_engine_block(engine, points);
    felt.sample_rate_hz = f->sample_rate_hz;
    felt.highest_v = f->highest_v;
    felt.first_sample = (double)f->first_sample;
    felt.fingers = (int32_t)f->fingers;
    felt.points = (int32_t)f->points;
    felt.step = (int32_t)f->step;
    felt.x_mm = address(f->x_mm);
    felt.y_mm = address(f->y_mm);
    felt.force_n = address(f->force_n);
    felt.wanted_mu = address(f->wanted_mu);
    felt.felt_mu = address(f->felt_mu);
    felt.status = address(f->status);
    felt.amplitude_v = address(f->amplitude_v);
    felt.drive_v = address(f->drive_v);
    return address(&felt);
}
