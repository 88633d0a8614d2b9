/* A player, a driver, a process that reports fingers, and an owner that reads the counters, each in
 * a thread of its own, under ThreadSanitizer.
 *
 * The owner also changes the intensity, and the engine.
 * Usage: shared_state FILE SECONDS. Prints samples, revisions, looks at the counters, engines. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "../../../firmware_io/firmware/haptix_wire.h"
#include "../../../firmware_io/player/haptix_player.h"
#include "../../../haptix/base/native/haptix_native.h"

enum { RATE = 48000 };

static int link_ends[2], report_ends[2];
static hx_player *player;
static hx_live *live;
static double seconds;

static double now_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void *play(void *unused) {
    (void)unused;
    hx_player_run(player);
    close(link_ends[0]);
    return NULL;
}

/* Takes whole frames and reports as a driver does. */
static void *drive(void *unused) {
    (void)unused;
    static uint8_t bytes[1 << 16];
    size_t have = 0;
    double began = 0.0;
    uint32_t queued_to = 0, revisions = 0;
    for (;;) {
        struct pollfd came = {link_ends[1], POLLIN, 0};
        poll(&came, 1, 2);
        if (came.revents) {
            ssize_t n = read(link_ends[1], bytes + have, sizeof bytes - have);
            if (n <= 0) return NULL;
            have += (size_t)n;
        }
        while (have >= HX_FRAME_OVERHEAD_BYTES) {
            uint32_t length = hx_get_u16(bytes + 6), whole = HX_FRAME_OVERHEAD_BYTES + length;
            if (have < whole) break;
            if (bytes[3] == HX_STREAM) {
                if (queued_to == 0) began = now_s();
                queued_to += (length - HX_INDEX_BYTES) / 2;
            }
            revisions += bytes[3] == HX_REVISE;
            memmove(bytes, bytes + whole, have - whole);
            have -= whole;
        }
        uint8_t f[HX_FRAME_OVERHEAD_BYTES + HX_STATUS_BYTES] = {'H', 'X', 4, HX_STATUS};
        uint8_t *p = f + HX_HEADER_BYTES;
        double played = queued_to ? (now_s() - began) * RATE : 0.0;
        uint32_t now = (uint32_t)(played < queued_to ? played : queued_to);
        p[0] = HX_PLAYING;
        hx_put_u32(p + 8, queued_to - now), hx_put_u32(p + 12, 12288 - (queued_to - now));
        hx_put_u32(p + 16, now), hx_put_u16(p + 36, (uint16_t)revisions), hx_put_u32(p + 40, 100);
        hx_put_u16(f + 6, HX_STATUS_BYTES);
        hx_put_u16(f + 10, hx_crc16(f, 10));
        hx_put_u32(p + HX_STATUS_BYTES, hx_crc32(f, HX_HEADER_BYTES + HX_STATUS_BYTES));
        if (send(link_ends[1], f, sizeof f, MSG_NOSIGNAL) < 0) return NULL;
    }
}

static void *touch(void *unused) {
    (void)unused;
    double began = now_s();
    for (double now = began; now < began + seconds; now = now_s()) {
        hx_report finger = {HX_FINGER, 0, 1, 0, now, now - 0.005, 20.0 + 15.0 * sin(6.0 * now), 20.0, 0.5};
        hx_report alive = {HX_ALIVE, 0, 0, 0, now, 0, 0, 0, 0};
        if (write(report_ends[1], &finger, sizeof finger) < 0) break;
        if (write(report_ends[1], &alive, sizeof alive) < 0) break;
        usleep(5000);
    }
    hx_report quit = {HX_QUIT, 0, 0, 0, 0, 0, 0, 0, 0};
    return write(report_ends[1], &quit, sizeof quit) < 0 ? NULL : NULL;
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    FILE *in = fopen(argv[1], "rb");
    if (!in || fseek(in, 0, SEEK_END) != 0) return 2;
    int64_t size = ftell(in);
    uint8_t *program = malloc((size_t)size);
    rewind(in);
    if (!program || fread(program, 1, (size_t)size, in) != (size_t)size) return 2;
    fclose(in);
    seconds = strtod(argv[2], NULL);
    void *memory = malloc((size_t)hx_engine_size(program, size));
    live = malloc((size_t)hx_live_bytes());
    hx_host_window *window = malloc(hx_host_window_bytes(RATE));
    player = malloc((size_t)hx_player_bytes());
    if (!memory || !live || !window || !player) return 2;
    hx_live_init(live, hx_engine_open(program, size, memory), 0.003);
    hx_host_window_init(window, RATE);
    hx_host_limits limits = {979295999.0, 231481481.0, 480000.0, 120.0, 0.05, 0.05};
    hx_source source = {live, hx_live_window, hx_live_settle, hx_live_played, hx_live_report,
                        hx_live_is_live};
    int told_ends[2];
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, link_ends) != 0 || pipe(report_ends) != 0 ||
        pipe(told_ends) != 0)
        return 2;
    fcntl(told_ends[1], F_SETFL, O_NONBLOCK);
    fcntl(link_ends[0], F_SETFL, O_NONBLOCK);
    fcntl(report_ends[0], F_SETFL, O_NONBLOCK);
    hx_player_setup setup = {link_ends[0], report_ends[0], told_ends[1], 0, {NULL, NULL, 0, 0}, 4, 1024, 960, 1920, 96,
                             10320, 9000, RATE, RATE, 0.0, 0.003, 3.3e-4, 2.5e-3, 2.0, 2.0, 200.0,
                             97.2, 250.0, 26213, 4, 7, 0, 12288, 0, &limits, window};
    if (!hx_player_init(player, &setup, &source)) return 3;
    pthread_t threads[3];
    void *(*runs[])(void *) = {play, drive, touch};
    for (int i = 0; i < 3; i++)
        if (pthread_create(&threads[i], NULL, runs[i], NULL) != 0) return 2;
    static hx_player_counts counts;
    int64_t looks = 0, adopted = 0;
    hx_live_counts rendered;
    static uint8_t felt[100]; /* read only when it is not played any more */
    void *effect_memory = malloc((size_t)hx_engine_size(program, size));
    if (!effect_memory) return 2;
    hx_effect effect = {hx_engine_open(program, size, effect_memory), 0.1, 0.2, INFINITY, INFINITY,
                        felt, sizeof felt};
    hx_mix mix = {0.5, 1.0, 0.1, 0.2, 0.0, NAN, &effect, 0};
    hx_engine *engines[3] = {NULL, NULL, NULL};
    for (double end = now_s() + seconds; now_s() < end; looks++) {
        hx_player_count(player, &counts);
        hx_live_count(live, &rendered);
        mix.effects = looks % 2;
        hx_live_mix(live, &mix);
        for (int i = 0; i < 3; i++)
            if (!engines[i] || !hx_live_needs(live, engines[i])) {
                free(engines[i]);
                engines[i] = malloc((size_t)hx_engine_size(program, size));
                if (!engines[i]) return 2;
                hx_live_adopt(live, hx_engine_open(program, size, engines[i]), &mix);
                adopted++;
                break;
            }
        usleep(1000);
    }
    for (int i = 0; i < 3; i++) pthread_join(threads[i], NULL);
    hx_player_count(player, &counts);
    printf("%ld samples, %ld revisions, %ld looks, %ld engines, ends by %d\n", (long)counts.sent,
           (long)counts.revisions, (long)looks, (long)adopted, (int)counts.outcome);
    for (int i = 0; i < 3; i++) free(engines[i]);
    free(effect_memory);
    free(program), free(memory), free(live), free(window), free(player);
    return 0;
}
