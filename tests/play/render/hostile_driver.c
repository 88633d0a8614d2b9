/* Plays a program to drivers and from reports that say anything, under the compiler's sanitizers.
 *
 * Usage: hostile_driver FILE COUNT SEED [CASE]. The player's calls of the system are those of this
 * file: time passes, and drivers and fingers say something, whenever it waits. It must end, as it
 * says, with STOP; send whole frames in their order, and no code above the ceiling; never spin; and
 * keep what may still be played within the window that is checked. Prints how many playbacks ended
 * by what. With CASE, that one is played alone. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static int fake_gettime(clockid_t clock, struct timespec *now);
static int fake_poll(struct pollfd *fds, nfds_t n, int ms);
static int fake_ppoll(struct pollfd *fds, nfds_t n, const struct timespec *time, const void *mask);
static ssize_t fake_read(int fd, void *bytes, size_t n);
static ssize_t fake_write(int fd, const void *bytes, size_t n);
#define clock_gettime fake_gettime
#define poll(fds, n, ms) fake_poll(fds, n, ms)
#define ppoll(fds, n, time, mask) fake_ppoll(fds, n, time, mask)
#define read(fd, bytes, n) fake_read(fd, bytes, n)
#define write(fd, bytes, n) fake_write(fd, bytes, n)
#include "../../../firmware_io/player/haptix_player.c"
#undef clock_gettime
#undef poll
#undef ppoll
#undef read
#undef write

#include "../../../haptix/base/native/haptix_native.h"

enum { LINK = 3, PIPE = 4, TOLD = 5, RATE = 48000, TOP = 26213, PLACES = 1 << 14 };

static uint64_t state;

static uint64_t random_bits(void) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}

static int64_t below(int64_t n) { return (int64_t)(random_bits() % (uint64_t)n); }

static double share(void) { return (double)below(1 << 20) / (1 << 20); }

static double any_double(void) {
    static const double odd[] = {0.0, -0.0, 1e-320, 1e300, -1e300, 1e19, -1e19, 1e-9, 1e9, -1e9};
    int64_t which = below(12);
    if (which < 10) return odd[which];
    uint64_t bits = random_bits();
    double value;
    memcpy(&value, &bits, 8);
    return which == 10 ? 100.0 * share() : value;
}

static long playback;

static void fail(const char *why) {
    fprintf(stderr, "case %ld: %s\n", playback, why);
    abort();
}

static hx_player *player;
static double clock_s, began_s;
static int reads_of_time, hostility, is_closed, is_deaf;
static int is_hid;  /* whose reads and writes are reports */
static int is_port; /* whose reads give no bytes where others fail */
static uint8_t to_host[PLACES], reports[PLACES];
static size_t to_host_bytes, report_bytes;
static uint8_t sent[1 << 17]; /* a frame that is not whole yet */
static size_t sent_bytes;
static uint32_t stream_at, last_kind, revisions;
static int frames, marks; /* that the driver keeps */
static long statuses_told, marked;

static int fake_gettime(clockid_t clock, struct timespec *now) {
    (void)clock;
    if (++reads_of_time > 100000) fail("it spins");
    clock_s += 1e-7;
    now->tv_sec = (time_t)clock_s;
    now->tv_nsec = (long)(1e9 * (clock_s - (double)now->tv_sec));
    return 0;
}

static ssize_t taken(uint8_t *from, size_t *have, void *bytes, size_t n) {
    n = n < *have ? n : *have;
    memcpy(bytes, from, n);
    memmove(from, from + n, *have - n);
    *have -= n;
    return (ssize_t)n;
}

static ssize_t fake_read(int fd, void *bytes, size_t n) {
    if (fd == LINK && is_closed) {
        errno = EIO;
        return is_closed == 2 ? 0 : -1;
    }
    size_t *have = fd == LINK ? &to_host_bytes : &report_bytes;
    errno = below(9) ? EAGAIN : EINTR;
    if (*have && fd == LINK && is_hid) {
        uint8_t *report = bytes;
        if (n != 64) fail("it reads another size than a report's");
        memset(report, 0, n);
        size_t length = 1 + (size_t)below(62);
        length = length < *have ? length : *have;
        report[0] = HX_REPORT_ID, report[1] = (uint8_t)length;
        taken(to_host, have, report + 2, length);
        if (hostility && below(50) == 0) report[below(2)] = (uint8_t)random_bits();
        return hostility && below(50) == 0 ? below(65) : 64;
    }
    if (*have) return taken(fd == LINK ? to_host : reports, have, bytes, n);
    return fd == LINK && is_port && !is_hid ? 0 : -1;
}

static void continue_after(uint32_t whole) {
    memmove(sent, sent + whole, sent_bytes - whole);
    sent_bytes -= whole;
}

/* What the owner is told: a whole frame behind a time that has been. It has no room at times. */
static void hear(const uint8_t *told, size_t size) {
    hx_told head;
    memcpy(&head, told, sizeof head);
    if (!(head.at_s <= clock_s)) fail("a frame comes before its time");
    const uint8_t *f = told + sizeof head;
    uint32_t length = HX_FRAME_OVERHEAD_BYTES + hx_get_u16(f + 6);
    if (head.bytes != length || size != sizeof head + length || size > 4096 ||
        hx_get_u32(f + length - HX_CRC_BYTES) != hx_crc32(f, length - HX_CRC_BYTES))
        fail("the owner is told no whole frame");
    statuses_told += f[3] == HX_STATUS;
}

/* The driver's side of the link: every frame must be whole. */
static ssize_t fake_write(int fd, const void *data, size_t size) {
    const uint8_t *bytes = data;
    if (fd == TOLD) {
        if (below(10) == 0) {
            errno = EAGAIN;
            return -1;
        }
        hear(data, size);
        return (ssize_t)size;
    }
    size_t n = size;
    int begins = 0;
    if (is_closed) {
        errno = EPIPE;
        return -1;
    }
    if (is_deaf && below(2)) {
        errno = is_hid ? ENODEV : EAGAIN;
        return -1;
    }
    if (is_hid) {
        if (n != 64 || bytes[0] != HX_REPORT_ID) fail("it writes no report");
        begins = bytes[1] & HX_REPORT_BEGINS;
        n = bytes[1] & 0x7f;
        if (n == 0 || n > 62) fail("a report is empty, or says that it has too much");
        if (begins != (sent_bytes == 0 ? (int)HX_REPORT_BEGINS : 0)) fail("a frame begins elsewhere");
        bytes += HX_REPORT_PREFIX_BYTES;
    } else
        n = size = below(20) ? n : 1 + (size_t)below((int64_t)n);
    if (sent_bytes + n > sizeof sent) fail("no frame ends");
    memcpy(sent + sent_bytes, bytes, n);
    sent_bytes += n;
    while (sent_bytes >= HX_FRAME_OVERHEAD_BYTES) {
        uint32_t length = hx_get_u16(sent + 6), whole = HX_FRAME_OVERHEAD_BYTES + length;
        if (sent[0] != 'H' || sent[1] != 'X' || hx_get_u16(sent + 10) != hx_crc16(sent, 10))
            fail("a header is damaged");
        if (sent_bytes < whole) break;
        if (hx_get_u32(sent + whole - 4) != hx_crc32(sent, whole - 4)) fail("a frame is damaged");
        if (hx_get_u16(sent + 4) != (uint16_t)(7 + frames++)) fail("a frame is missing");
        last_kind = sent[3];
        uint32_t head = last_kind == HX_STREAM ? HX_INDEX_BYTES : HX_REVISE_HEAD_BYTES;
        const uint8_t *payload = sent + HX_HEADER_BYTES;
        if (last_kind == HX_STREAM) {
            if (hx_get_u32(payload) != stream_at) fail("samples are missing");
            if (stream_at == 0) began_s = clock_s;
            stream_at += (length - head) / 2;
        }
        revisions += last_kind == HX_REVISE;
        if (last_kind == HX_MARK) {
            if (length != HX_MARK_BYTES || hx_get_u32(payload) != stream_at) fail("a mark is late");
            if (++marks > DRIVER_MARKS && !hostility) fail("the driver has no room for a mark");
            continue_after(whole);
            continue;
        }
        for (uint32_t at = head; last_kind != HX_STOP && at < length; at += 2)
            if (abs((int16_t)hx_get_u16(payload + at)) > TOP) fail("a code is above the ceiling");
        continue_after(whole);
    }
    return (ssize_t)size;
}

static void say(const uint8_t *bytes, size_t n) {
    if (to_host_bytes + n > sizeof to_host) return;
    memcpy(to_host + to_host_bytes, bytes, n);
    to_host_bytes += n;
}

static void say_frame(uint8_t kind, const uint8_t *payload, uint32_t length) {
    static uint8_t f[PLACES];
    f[0] = 'H', f[1] = 'X', f[2] = 4, f[3] = kind;
    hx_put_u16(f + 4, 0), hx_put_u16(f + 6, (uint16_t)length), hx_put_u16(f + 8, 0);
    hx_put_u16(f + 10, hx_crc16(f, 10));
    memcpy(f + HX_HEADER_BYTES, payload, length);
    hx_put_u32(f + HX_HEADER_BYTES + length, hx_crc32(f, HX_HEADER_BYTES + length));
    say(f, HX_FRAME_OVERHEAD_BYTES + length);
}

/* A report as a driver makes it; a hostile one replaces some of its numbers. */
static void say_status(void) {
    uint8_t p[HX_STATUS_BYTES] = {HX_PLAYING};
    double played = stream_at ? (clock_s - began_s) * RATE : 0.0;
    uint32_t now = (uint32_t)(played < stream_at ? played : stream_at);
    hx_put_u32(p + 8, stream_at - now), hx_put_u32(p + 12, 12288 - (stream_at - now));
    hx_put_u32(p + 16, now), hx_put_u32(p + 20, 0);
    uint32_t refused = below(10) ? 0 : (uint32_t)below(3);
    hx_put_u16(p + 36, (uint16_t)(revisions - refused)), hx_put_u16(p + 38, (uint16_t)refused);
    hx_put_u32(p + 40, 100);
    while (below(100) < hostility) {
        uint32_t value = (uint32_t)(random_bits() >> below(64));
        uint8_t *number = p + 8 + 4 * below(9);
        if (below(2)) value += hx_get_u32(number) - 8;
        hx_put_u32(number, value);
    }
    say_frame(HX_STATUS, p, sizeof p);
}

static void report(int is_odd) {
    hx_report r = {HX_FINGER, (int32_t)below(3), below(8) != 0, 0, clock_s, clock_s - 0.005 * share(),
                   40.0 * share(), 20.0, share()};
    double *numbers[] = {&r.arrival_s, &r.t_s, &r.x_mm, &r.y_mm, &r.force_n};
    while (is_odd && below(3)) *numbers[below(5)] = any_double();
    if (below(10) == 0) r.kind = HX_MARK_NEXT;
    if (is_odd && below(4) == 0) r.kind = below(20) ? HX_CHANGED : (int32_t)random_bits();
    if (is_odd && below(4) == 0) r.touch_id = (int32_t)random_bits();
    if (report_bytes + sizeof r > sizeof reports) return;
    memcpy(reports + report_bytes, &r, sizeof r);
    report_bytes += sizeof r;
}

static void happen(void) {
    static uint8_t bytes[PLACES];
    int64_t what = below(100);
    if (what < 40) say_status();
    else if (what < 70) report(below(100) < hostility);
    else if (what < 72 && hostility) {
        int64_t n = below(1 + below(PLACES / 4));
        for (int64_t i = 0; i < n; i++) bytes[i] = (uint8_t)random_bits();
        if (below(2)) say(bytes, (size_t)n);
        else say_frame((uint8_t)(below(2) ? HX_STATUS : random_bits()), bytes, (uint32_t)n);
    } else if (what == 72 && hostility) is_deaf = !is_deaf;
    else if (what == 73 && hostility && below(20) == 0) is_closed = 1 + (int)below(2);
    else if (what == 74 && hostility && below(20) == 0) say_frame(HX_FAULT, bytes, HX_FAULT_BYTES);
    else if (what < 85 && marks > 0) {
        say_frame(HX_MARKED, bytes, HX_MARKED_BYTES);
        marks--, marked++;
    }
    if (below(100) < 20) {
        hx_report alive = {HX_ALIVE, 0, 0, 0, clock_s, 0, 0, 0, 0};
        memcpy(reports + report_bytes, &alive, sizeof alive * (report_bytes + sizeof alive <= PLACES));
        report_bytes += sizeof alive * (report_bytes + sizeof alive <= PLACES);
    }
}

static int waits;

static int fake_ppoll(struct pollfd *fds, nfds_t n, const struct timespec *time, const void *mask) {
    (void)mask;
    reads_of_time = 0;
    double longest_s = (double)time->tv_sec + 1e-9 * (double)time->tv_nsec;
    if (!(longest_s >= 0.0 && longest_s <= 1.0)) fail("it waits for a time that cannot be");
    clock_s += below(200) ? longest_s * share() : 0.3 * share(); /* the processor is busy */
    if (player->counts.sent - player->begin > RATE) fail("more waits than is checked");
    if (player->at + player->counts.sent - player->begin > QUEUE) fail("the queue is full");
    if (++waits > 400) { /* the owner ends it */
        hx_report quit = {HX_QUIT, 0, 0, 0, 0, 0, 0, 0, 0};
        is_deaf = 0;
        report_bytes = 0;
        memcpy(reports, &quit, sizeof quit);
        report_bytes = sizeof quit;
    } else
        happen();
    for (nfds_t i = 0; i < n; i++) fds[i].revents = fds[i].events;
    return 1;
}

/* Whether the link can be read now, after something may have come. */
static int fake_poll(struct pollfd *fds, nfds_t n, int ms) {
    (void)fds, (void)n, (void)ms;
    if (below(4) == 0) happen();
    return to_host_bytes > 0 || is_closed;
}

int main(int argc, char **argv) {
    if (argc < 4) return 2;
    FILE *in = fopen(argv[1], "rb");
    if (!in || fseek(in, 0, SEEK_END) != 0) return 2;
    int64_t size = ftell(in);
    uint8_t *program = malloc((size_t)size);
    rewind(in);
    if (!program || fread(program, 1, (size_t)size, in) != (size_t)size) return 2;
    fclose(in);
    void *memory = malloc((size_t)hx_engine_size(program, size));
    hx_live *live = malloc((size_t)hx_live_bytes());
    hx_host_window *window = malloc(hx_host_window_bytes(RATE));
    player = malloc((size_t)hx_player_bytes());
    if (!memory || !live || !window || !player) return 2;
    hx_host_limits limits = {979295999.0, 231481481.0, 480000.0, 120.0, 0.05, 0.05};
    hx_source source = {live, hx_live_window, hx_live_settle, hx_live_played, hx_live_report,
                        hx_live_is_live};
    long count = strtol(argv[2], NULL, 10), first = argc > 4 ? strtol(argv[4], NULL, 10) : 0;
    long ends[HX_QUIET + 1] = {0}, revised = 0, played = 0;
    for (playback = first; playback < (argc > 4 ? first + 1 : count); playback++) {
        state = 88172645463325252u + 1000003u * strtoull(argv[3], NULL, 10) + 7919u * (uint64_t)playback;
        for (int i = 0; i < 20; i++) random_bits();
        hx_live_init(live, hx_engine_open(program, size, memory), 0.003);
        hx_host_window_init(window, RATE);
        clock_s = 1000.0 + 1e4 * share(), began_s = clock_s;
        to_host_bytes = report_bytes = sent_bytes = 0;
        stream_at = last_kind = revisions = 0;
        reads_of_time = is_closed = is_deaf = waits = frames = marks = 0;
        hostility = below(4) ? (int)below(60) : 0;
        is_port = (int)below(2), is_hid = below(3) == 0;
        hx_player_setup setup = {LINK, PIPE, TOLD, is_hid ? 64 : 0, {NULL, NULL, 0, 0}, 4, 1024, 960, 1920, 96, 10320, 9000, RATE, RATE,
                                 below(3) ? 0.0 : 2e5, 0.003, 3.3e-4, 2.5e-3, 0.25, 1.0, 200.0,
                                 97.2, 250.0, TOP, 4, 7, 0, 12288, 0, &limits, window};
        if (!hx_player_init(player, &setup, &source)) return 3;
        int64_t outcome = hx_player_run(player);
        if (outcome < HX_STOPPED || outcome > HX_QUIET) fail("it ends without a reason");
        if (outcome != HX_IN_FAULT && outcome != HX_LOST && last_kind != HX_STOP && !player->counts.error)
            fail("it ends without STOP");
        if (!hostility && outcome != HX_STOPPED && outcome != HX_SILENT && outcome != HX_QUIET)
            fail("an honest driver is blamed");
        ends[outcome]++;
        revised += player->counts.revisions, played += player->counts.sent;
    }
    for (int i = HX_STOPPED; i <= HX_QUIET; i++) printf("%ld ", ends[i]);
    printf("%ld revisions, %ld samples, %ld told, %ld marked\n", revised, played, statuses_told, marked);
    free(program), free(memory), free(live), free(window), free(player);
    return 0;
}
