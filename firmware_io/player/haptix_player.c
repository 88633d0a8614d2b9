/* The driver's queue, kept full and revised; see haptix_player.h and firmware_io/reviser.py. */
#define _GNU_SOURCE /* ppoll */
#include "haptix_player.h"

#include <math.h>
#include <string.h>

#include "../firmware/haptix_wire.h"

#ifdef _WIN32

int64_t hx_player_bytes(void) { return 8; }
int64_t hx_player_init(hx_player *p, const hx_player_setup *setup, const hx_source *source) {
    (void)p, (void)setup, (void)source;
    return 0;
}
int64_t hx_player_run(hx_player *p) {
    (void)p;
    return HX_LOST;
}
void hx_player_count(hx_player *p, hx_player_counts *to) { (void)p, (void)to; }
int64_t hx_bulk_read(const hx_bulk *bulk, int64_t to, const volatile int32_t *is_over) {
    (void)bulk, (void)to, (void)is_over;
    return 0;
}

#else

#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <time.h>
#include <unistd.h>

enum { QUEUE = 1 << 16, MOST_REVISED = 4096, UNDER_WAY = 32, ORIGINS = 128, NEEDS = 32 };
enum { STATUS_CLOCK = 28, DRIVER_MARKS = 8 }; /* place in a STATUS; marks that a driver keeps */
enum { REPORT = 64, PIECE = 1 << 14, FRAME = HX_FRAME_OVERHEAD_BYTES + HX_REVISE_HEAD_BYTES + 2 * PIECE };

/* As in firmware_io/reviser.py, which gives the reasons. */
static const double kept_s = 1.0, appended_within_s = 0.007, status_s = 0.02;
static const double first_need_s = 1e-3, refused_s = 0.01, refused_needs = 3.0, spare_s = 1e-4;
static const double longest_need_s = 0.05, renewed_share = 0.75, burst = 0.5, slowest = 0.98;
static const double told_within_s = 0.1;
static const double send_s = 1.0; /* longest time for which a link takes nothing */

typedef struct {
    double host_s, origin;
} seen;

typedef struct {
    int64_t first, count;
    double touched_s, at_s, lead_s; /* touched_s is NaN without a report */
    double before[MOST_REVISED];
} revision;

typedef struct {
    double reported_s;
    uint32_t state, queued, free, played, underruns, revisions, refused;
    int32_t margin;
} status;

struct hx_player {
    hx_player_setup set;
    hx_source source;
    hx_player_counts counts, shown;
    char is_shown_held; /* by the thread that copies it */
    status last;
    int has_reported;

    /* The output by the driver's reports: of the last second, the one that shows it furthest ahead. */
    seen origins[ORIGINS];
    int first_origin, origin_count;
    double origin;

    /* Samples from `begin` on, which the driver may not have played; the next is counts.sent. */
    double queue[QUEUE];
    int64_t begin, at; /* index of the oldest, and its place */
    double before_v;   /* the sample before it */
    int16_t codes[PIECE + 1];

    revision under_way[UNDER_WAY];
    int first_under_way, under_way_count;
    uint32_t obeyed, refused, revised, known_underruns;

    double need_s, needs[NEEDS];
    int need_count;
    double touched_s; /* the earliest report that no revision knows of; NaN: none */
    double revised_s, carried_s, free_s, append_due_s, due_s, owner_s;
    int64_t forgotten;

    int64_t marks_asked, marks_sent, marks_reported;
    uint16_t mark[HX_MARKS_KEPT];

    /* The STATUS that the owner has not been told of, that which shows the driver furthest ahead:
     * it needs no others for the driver's clock. */
    uint8_t status[sizeof(hx_told) + HX_FRAME_OVERHEAD_BYTES + HX_STATUS_BYTES];
    uint32_t status_bytes;
    double status_origin, told_s;

    uint8_t received[2048];
    uint32_t received_bytes;
    uint8_t frame[FRAME];
};

static double now_s(void) {
    struct timespec now;
#ifdef __APPLE__
    clock_gettime(CLOCK_UPTIME_RAW, &now); /* as Python's time.monotonic */
#else
    clock_gettime(CLOCK_MONOTONIC, &now);
#endif
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double least(double a, double b) { return a < b ? a : b; }
static double most(double a, double b) { return a > b ? a : b; }
static int64_t least_of(int64_t a, int64_t b) { return a < b ? a : b; }
static int64_t most_of(int64_t a, int64_t b) { return a > b ? a : b; }

static void wait_for(struct pollfd *fds, unsigned n, double seconds) {
    seconds = most(seconds, 0.0);
#ifdef __linux__
    struct timespec time = {(time_t)seconds, 0};
    time.tv_nsec = (long)(1e9 * (seconds - (double)time.tv_sec));
    ppoll(fds, n, &time, NULL);
#else
    poll(fds, n, (int)ceil(1e3 * seconds));
#endif
}

static void end(hx_player *p, int outcome) {
    if (p->counts.outcome == HX_PLAYS) p->counts.outcome = outcome;
}

static int is_over(const hx_player *p) { return p->counts.outcome != HX_PLAYS; }

/* Let other threads see the counters, unless one is looking; then the next step does. */
static int show(hx_player *p) {
    if (__atomic_test_and_set(&p->is_shown_held, __ATOMIC_ACQUIRE)) return 0;
    p->shown = p->counts;
    __atomic_clear(&p->is_shown_held, __ATOMIC_RELEASE);
    return 1;
}

static void lose(hx_player *p, int error) {
    p->counts.error = error;
    end(p, HX_LOST);
}

/* Errors of libusb: no device, a stalled endpoint, no transfer in time, another one. */
enum { NO_DEVICE = -4, TIMED_OUT = -7, STALLED = -9, BULK_BYTES = 16384, BULK_WAIT_MS = 20 };

static int error_of(int code) {
    return code == NO_DEVICE ? ENODEV : code == TIMED_OUT ? ETIMEDOUT : code == STALLED ? EPIPE : EIO;
}

int64_t hx_bulk_read(const hx_bulk *b, int64_t to, const volatile int32_t *is_over) {
    uint8_t bytes[BULK_BYTES];
    while (!*is_over) {
        int n = 0, code = b->transfer(b->handle, (uint8_t)b->inward, bytes, BULK_BYTES, &n, BULK_WAIT_MS);
        if (code != 0 && code != TIMED_OUT) return error_of(code);
        for (ssize_t at = 0, taken; at < n; at += taken)
            if ((taken = write((int)to, bytes + at, (size_t)(n - at))) <= 0) return EPIPE;
    }
    return 0;
}

/* Frames. */

static void send_bulk(hx_player *p, const uint8_t *bytes, int64_t n) {
    const hx_bulk *b = &p->set.bulk;
    int moved = 0, code = b->transfer(b->handle, (uint8_t)b->outward, (uint8_t *)bytes, (int)n, &moved,
                                      (unsigned)(1e3 * send_s));
    if (code != 0 || moved != n) lose(p, code != 0 ? error_of(code) : EIO);
}

static void send_reports(hx_player *p, const uint8_t *bytes, int64_t n) {
    int64_t size = p->set.report_bytes, most_bytes = size - (int64_t)HX_REPORT_PREFIX_BYTES;
    for (int64_t at = 0; at < n; at += most_bytes) {
        int64_t length = least_of(most_bytes, n - at);
        uint8_t report[REPORT] = {HX_REPORT_ID, (uint8_t)length};
        if (at == 0) report[1] |= HX_REPORT_BEGINS;
        memcpy(report + HX_REPORT_PREFIX_BYTES, bytes + at, (size_t)length);
        ssize_t sent = write(p->set.link, report, (size_t)size);
        if (sent != size) {
            lose(p, sent < 0 ? errno : EIO);
            return;
        }
    }
}

static void send_bytes(hx_player *p, const uint8_t *bytes, int64_t n) {
    double began_s = now_s();
    p->counts.bytes_sent += n;
    if (p->set.bulk.transfer) {
        send_bulk(p, bytes, n);
        return;
    }
    if (p->set.report_bytes) {
        send_reports(p, bytes, n);
        return;
    }
    while (n > 0) {
        ssize_t sent = write(p->set.link, bytes, (size_t)n);
        if (sent >= 0) {
            bytes += sent, n -= sent;
            continue;
        }
        if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) {
            lose(p, errno);
            return;
        }
        double left_s = began_s + send_s - now_s();
        if (left_s <= 0.0) {
            lose(p, ETIMEDOUT);
            return;
        }
        struct pollfd writable = {p->set.link, POLLOUT, 0};
        wait_for(&writable, 1, left_s);
    }
}

/* Send the payload of `length` bytes that stands in the frame behind its header. */
static void send_frame(hx_player *p, uint8_t kind, uint32_t length) {
    uint8_t *f = p->frame;
    f[0] = 'H', f[1] = 'X';
    f[2] = (uint8_t)p->set.version;
    f[3] = kind;
    hx_put_u16(f + 4, (uint16_t)p->counts.sequence);
    hx_put_u16(f + 6, (uint16_t)length);
    hx_put_u16(f + 8, HX_WAVEFORM); /* 0, as in frames without a mode */
    hx_put_u16(f + 10, hx_crc16(f, 10));
    hx_put_u32(f + HX_HEADER_BYTES + length, hx_crc32(f, HX_HEADER_BYTES + length));
    send_bytes(p, f, HX_FRAME_OVERHEAD_BYTES + length);
    p->counts.sequence = (p->counts.sequence + 1u) & 0xffffu;
    p->counts.frames_sent++;
}

static void put_codes(uint8_t *bytes, const int16_t *codes, int64_t n) {
    for (int64_t i = 0; i < n; i++) hx_put_u16(bytes + 2 * i, (uint16_t)codes[i]);
}

/* The output's clock. */

static void observe_clock(hx_player *p, double host_s, double played) {
    double origin = played - host_s * p->set.rate_hz;
    while (p->origin_count > 0) {
        int last = (p->first_origin + p->origin_count - 1) % ORIGINS;
        if (p->origins[last].origin <= origin)
            p->origin_count--;
        else if (p->origins[p->first_origin].host_s < host_s - kept_s || p->origin_count == ORIGINS)
            p->first_origin = (p->first_origin + 1) % ORIGINS, p->origin_count--;
        else
            break;
    }
    p->origins[(p->first_origin + p->origin_count++) % ORIGINS] = (seen){host_s, origin};
    p->origin = p->origins[p->first_origin].origin;
}

static void restart_clock(hx_player *p, double host_s, double played) {
    p->origin_count = 0;
    observe_clock(p, host_s, played);
}

static double played_at(const hx_player *p, double host_s) {
    return p->origin + host_s * p->set.rate_hz;
}

static double time_of(const hx_player *p, int64_t index) {
    return ((double)index - p->origin) / p->set.rate_hz;
}

/* The queue. */

static double *queued_at(hx_player *p, int64_t index) { return p->queue + p->at + (index - p->begin); }

static revision *under_way(hx_player *p, int place) {
    return &p->under_way[(p->first_under_way + place) % UNDER_WAY];
}

/* Put back what stood before the revisions under way, the newest first, up to an index. */
static void put_back(hx_player *p, int64_t end_index) {
    for (int place = p->under_way_count - 1; place >= 0; place--) {
        const revision *r = under_way(p, place);
        int64_t count = least_of(r->count, end_index - r->first);
        for (int64_t i = most_of(p->begin - r->first, 0); i < count; i++)
            *queued_at(p, r->first + i) = r->before[i];
    }
}

/* Samples before an index are played, and cannot be replaced any more. A revision that was still
 * under way then came too late for them. */
static void take_played(hx_player *p, int64_t index) {
    int64_t count = least_of(most_of(index - p->begin, 0), p->counts.sent - p->begin);
    if (count == 0) return;
    put_back(p, p->begin + count);
    double *volts = queued_at(p, p->begin);
    hx_host_take(p->set.window, volts, (uint32_t)count);
    p->before_v = volts[count - 1];
    p->begin += count;
    p->at += count;
    if (p->at > QUEUE / 2) {
        memmove(p->queue, p->queue + p->at, sizeof(double) * (size_t)(p->counts.sent - p->begin));
        p->at = 0;
    }
}

static int is_kept(hx_player *p, const double *volts, int64_t n, double before_v) {
    const hx_player_setup *s = &p->set;
    if (hx_host_codes(volts, (uint32_t)n, before_v, s->most_v, s->most_step_v, s->full_scale_v,
                      s->top_code, p->codes))
        return 1;
    end(p, HX_OVER_SAMPLE);
    return 0;
}

/* Whether the window keeps its limits with all that waits, of which the last `n` are new. */
static int is_window_kept(hx_player *p, int64_t end_index) {
    uint32_t sample = 0;
    p->counts.verdict = hx_host_check(p->set.window, p->set.limits, queued_at(p, p->begin),
                                      (uint32_t)(end_index - p->begin), &sample, &p->counts.found);
    if (p->counts.verdict == HX_HOST_KEPT) return 1;
    p->counts.sample = sample;
    end(p, HX_OVER_WINDOW);
    return 0;
}

/* The driver has refused all revisions that it has not obeyed: what stood there before stays. */
static void undo(hx_player *p) {
    put_back(p, p->counts.sent);
    p->under_way_count = 0;
}

/* Reports of the driver. */

/* Choose the time that revisions need, so that a reaction is short on average. */
static void learn(hx_player *p, double needed_s) {
    if (p->need_count == NEEDS)
        memmove(p->needs, p->needs + 1, sizeof(double) * (NEEDS - 1));
    else
        p->need_count++;
    p->needs[p->need_count - 1] = needed_s;
    double best_s = INFINITY;
    for (int i = 0; i < p->need_count; i++) {
        /* Revisions that need longer than this one are refused, and repeated. */
        double need_s = p->needs[i], cost_s = need_s;
        for (int k = 0; k < p->need_count; k++)
            if (p->needs[k] > need_s)
                cost_s += 0.1 * pow(0.9, p->need_count - 1 - k) *
                          (refused_s + refused_needs * p->needs[k]);
        if (cost_s < best_s) best_s = cost_s, p->need_s = need_s + spare_s;
    }
}

static void take_status(hx_player *p, const status *now) {
    const double rate_hz = p->set.rate_hz;
    p->last = *now;
    uint32_t obeyed = (now->revisions - p->obeyed) & 0xffffu;
    uint32_t undone = (now->refused - p->refused) & 0xffffu;
    double lead_s = 0.0;
    if (obeyed > (uint32_t)p->under_way_count) obeyed = (uint32_t)p->under_way_count;
    p->obeyed = (p->obeyed + obeyed) & 0xffffu;
    for (uint32_t i = 0; i < obeyed; i++) {
        revision *r = under_way(p, 0);
        lead_s = r->lead_s;
        if (!isnan(r->touched_s))
            p->counts.reaction_s[p->counts.reactions++ % HX_REACTIONS] = r->at_s - r->touched_s;
        p->first_under_way = (p->first_under_way + 1) % UNDER_WAY;
        p->under_way_count--;
    }
    /* The driver also refuses revisions that were sent after a refused one: they were counted. */
    int is_undone = undone > 0 && undone < 0x8000u;
    if (is_undone) {
        undone = (uint32_t)p->under_way_count;
        double touched_s = isnan(p->touched_s) ? now_s() : p->touched_s;
        for (int i = 0; i < p->under_way_count; i++) {
            lead_s = under_way(p, i)->lead_s;
            if (!isnan(under_way(p, i)->touched_s))
                touched_s = least(touched_s, under_way(p, i)->touched_s);
        }
        p->touched_s = touched_s; /* revise again, for the report that has waited longest */
        undo(p);
        p->refused = (p->refused + undone) & 0xffffu;
        p->revised = p->obeyed;
        p->counts.refused += undone;
    }
    p->counts.revisions += obeyed;
    int64_t played = p->counts.sent - (uint32_t)((uint32_t)p->counts.sent - now->played);
    take_played(p, played);
    if (now->state == HX_PLAYING) {
        uint32_t missed = now->underruns - p->known_underruns;
        if (missed || !p->has_reported) {
            restart_clock(p, now->reported_s, (double)played);
            p->has_reported = 1;
        } else
            observe_clock(p, now->reported_s, (double)played);
        p->counts.underruns += missed;
        p->known_underruns = now->underruns;
    }
    if (obeyed || is_undone) {
        p->source.settle(p->source.of, obeyed, is_undone);
        double needed_s = most(lead_s - now->margin / rate_hz, 0.0) + p->set.guard_s;
        learn(p, least(needed_s, longest_need_s));
    }
}

static void take_frame(hx_player *p, uint8_t kind, const uint8_t *payload, uint32_t length,
                       double at_s) {
    if (kind == HX_FAULT && length == HX_FAULT_BYTES) {
        memcpy(p->counts.fault, payload, HX_FAULT_BYTES);
        end(p, HX_IN_FAULT);
    } else if (kind == HX_STATUS && length == HX_STATUS_BYTES) {
        status now = {at_s, payload[0], hx_get_u32(payload + 8), hx_get_u32(payload + 12),
                      hx_get_u32(payload + 16), hx_get_u32(payload + 20), hx_get_u16(payload + 36),
                      hx_get_u16(payload + 38), (int32_t)hx_get_u32(payload + 40)};
        take_status(p, &now);
    } else if (kind == HX_MARKED && p->marks_reported < p->marks_sent)
        p->marks_reported++;
}

/* Give the owner frames of the driver, which has room unless it stands still. */

static void tell_status(hx_player *p) {
    if (p->status_bytes > 0 && write(p->set.told, p->status, p->status_bytes) < 0) return;
    p->status_bytes = 0;
}

static void tell(hx_player *p, const uint8_t *frame, uint32_t length, double at_s) {
    uint8_t told[sizeof(hx_told) + sizeof p->received]; /* less than a pipe takes whole */
    hx_told head = {at_s, length};
    uint32_t bytes = (uint32_t)sizeof head + length;
    memcpy(told, &head, sizeof head);
    memcpy(told + sizeof head, frame, length);
    if (frame[3] != HX_STATUS) {
        tell_status(p); /* by which the owner knows the clock */
        if (write(p->set.told, told, bytes) < 0) return;
    } else if (bytes <= sizeof p->status) {
        const uint8_t *clock = frame + HX_HEADER_BYTES + STATUS_CLOCK;
        double ticks = hx_get_u32(clock) + 4294967296.0 * hx_get_u32(clock + 4);
        double origin = ticks - at_s * p->set.output_rate_hz;
        if (p->status_bytes == 0 || origin >= p->status_origin) {
            memcpy(p->status, told, bytes);
            p->status_bytes = bytes;
            p->status_origin = origin;
        }
        if (at_s - p->told_s < told_within_s) return;
        tell_status(p);
        p->told_s = at_s;
    }
}

/* Take the whole frames of what came; what is none is left out, byte by byte. */
static void take_received(hx_player *p, double at_s) {
    uint32_t from = 0, have = p->received_bytes;
    while (have - from >= HX_FRAME_OVERHEAD_BYTES && !is_over(p)) {
        const uint8_t *f = p->received + from;
        uint32_t length = hx_get_u16(f + 6), whole = HX_FRAME_OVERHEAD_BYTES + length;
        if (f[0] != 'H' || f[1] != 'X' || hx_get_u16(f + 10) != hx_crc16(f, 10) ||
            whole > sizeof p->received) {
            from++;
            continue;
        }
        if (have - from < whole) break;
        if (hx_get_u32(f + whole - HX_CRC_BYTES) != hx_crc32(f, whole - HX_CRC_BYTES)) {
            from++;
            continue;
        }
        take_frame(p, f[3], f + HX_HEADER_BYTES, length, at_s);
        if (f[3] != HX_FAULT) tell(p, f, whole, at_s); /* which ends it, and is in the counts */
        from += whole;
    }
    memmove(p->received, p->received + from, have - from);
    p->received_bytes = have - from;
}

/* Read what came behind what was received; return how much the driver sent. */
static ssize_t receive(hx_player *p) {
    size_t room = sizeof p->received - p->received_bytes;
    uint8_t *to = p->received + p->received_bytes, report[REPORT];
    ssize_t came = read(p->set.link, p->set.report_bytes ? report : to,
                        p->set.report_bytes ? (size_t)p->set.report_bytes : room);
    if (came <= 0) return came;
    size_t length = (size_t)came;
    if (p->set.report_bytes) {
        length = came < 2 ? 0 : report[1] & (HX_REPORT_BEGINS - 1u);
        int is_ours = report[0] == HX_REPORT_ID && length + HX_REPORT_PREFIX_BYTES <= (size_t)came;
        if (!is_ours || length > room) length = 0; /* the frame that lacks it is left out */
        memcpy(to, report + HX_REPORT_PREFIX_BYTES, length);
    }
    p->received_bytes += (uint32_t)length;
    return came;
}

static void read_link(hx_player *p) {
    int was_empty = 0;
    int most_reads = p->set.report_bytes ? 128 : 4;
    for (int reads = 0; reads < most_reads && !is_over(p); reads++) {
        size_t room = sizeof p->received - p->received_bytes;
        ssize_t came = receive(p);
        if (came < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return;
        if (came <= 0) {
            struct pollfd closed = {p->set.link, POLLIN, 0};
            /* A serial port without bytes gives none, and stays open; some may just have come. */
            if (came == 0 && poll(&closed, 1, 0) == 0) return;
            if (came == 0 && !was_empty) {
                was_empty = 1;
                continue;
            }
            lose(p, came < 0 ? errno : 0);
            return;
        }
        take_received(p, now_s());
        if (!p->set.report_bytes && (size_t)came < room) return;
    }
}

/* What the owner and the fingers say. */
static void read_reports(hx_player *p) {
    hx_report reports[64];
    for (int reads = 0; reads < 4; reads++) {
        ssize_t came = read(p->set.reports, reports, sizeof reports);
        if (came == 0) end(p, HX_STOPPED);
        if (came <= 0) return;
        for (size_t i = 0; i < (size_t)came / sizeof *reports; i++) {
            const hx_report *report = &reports[i];
            if (report->kind == HX_ALIVE) p->owner_s = now_s();
            if (report->kind == HX_QUIT) end(p, HX_STOPPED);
            if (report->kind == HX_MARK_NEXT && p->marks_asked - p->marks_sent < HX_MARKS_KEPT)
                p->mark[p->marks_asked++ % HX_MARKS_KEPT] = (uint16_t)report->touch_id;
            double sum = report->arrival_s + report->t_s + report->x_mm + report->y_mm;
            if (!isfinite(sum + report->force_n)) continue;
            double now = now_s(), arrival_s = least(most(report->arrival_s, now - kept_s), now);
            if (report->kind == HX_FINGER)
                p->source.report(p->source.of, report->touch_id, report->is_down, arrival_s,
                                 report->t_s, report->x_mm, report->y_mm, report->force_n);
            if (report->kind == HX_FINGER || report->kind == HX_CHANGED)
                p->touched_s = isnan(p->touched_s) ? arrival_s : least(p->touched_s, arrival_s);
        }
    }
}

/* The work. */

static void make_window(hx_player *p, int64_t first, int64_t count, int64_t is_revision, double *volts) {
    double began_s = now_s();
    p->source.window(p->source.of, first, count, time_of(p, first), is_revision, volts);
    p->counts.window_s[p->counts.windows++ % HX_REACTIONS] = now_s() - began_s;
}

static double next_revision_s(hx_player *p) {
    if (!isnan(p->touched_s)) return p->carried_s - burst * p->set.least_interval_s;
    if (!p->source.is_live(p->source.of)) return INFINITY;
    double most_s = renewed_share * (double)p->set.revised / p->set.rate_hz;
    return p->revised_s + most(most_s, p->set.least_interval_s);
}

/* Time for which a line of so many bytes a second is still busy. */
static void note_sent(hx_player *p, double began_s, int64_t before) {
    if (p->set.bytes_per_s > 0.0)
        p->free_s = most(p->free_s, began_s) +
                    (double)(p->counts.bytes_sent - before) / p->set.bytes_per_s;
}

static void revise(hx_player *p) {
    const hx_player_setup *s = &p->set;
    double touched_s = p->touched_s, now = now_s(), waits_s = most(0.0, p->free_s - now);
    double grid = (double)s->grid;
    p->touched_s = NAN;
    p->revised_s = now;
    p->carried_s = most(p->carried_s, now) + s->least_interval_s;
    double reached = ceil((played_at(p, now) + (p->need_s + waits_s) * s->rate_hz) / grid);
    if (!isnan(touched_s)) {
        double wanted = played_at(p, touched_s + s->reaction_s);
        p->counts.late_samples += (int64_t)most(0.0, reached * grid - ceil(wanted));
        reached = most(reached, floor(wanted / grid));
    }
    int64_t first = most_of((int64_t)reached * s->grid, p->forgotten + s->grid);
    first = most_of(first, (p->begin / s->grid + 1) * s->grid);
    /* The last queued point stays, since appended samples follow it. */
    int64_t count = least_of(s->revised, (p->counts.sent - s->grid - first) / s->grid * s->grid);
    if (count < s->least || p->under_way_count == UNDER_WAY) return;
    double at_s = time_of(p, first), *volts = queued_at(p, first);
    revision *r = under_way(p, p->under_way_count);
    r->first = first, r->count = count;
    r->touched_s = touched_s, r->at_s = at_s, r->lead_s = at_s - now - waits_s;
    memcpy(r->before, volts, sizeof(double) * (size_t)count);
    make_window(p, first, count, 1, volts);
    p->under_way_count++;
    if (!is_kept(p, volts, count + 1, volts[-1]) || !is_window_kept(p, p->counts.sent)) return;
    int64_t before = p->counts.bytes_sent;
    uint8_t *payload = p->frame + HX_HEADER_BYTES;
    hx_put_u32(payload, (uint32_t)first);
    hx_put_u16(payload + HX_INDEX_BYTES, (uint16_t)p->revised);
    put_codes(payload + HX_REVISE_HEAD_BYTES, p->codes, count);
    send_frame(p, HX_REVISE, HX_REVISE_HEAD_BYTES + 2u * (uint32_t)count);
    p->revised = (p->revised + 1u) & 0xffffu;
    note_sent(p, now, before);
}

/* Samples that the driver can accept now. */
static int64_t room(const hx_player *p, double now) {
    const status *last = &p->last;
    int64_t ahead = (uint32_t)((uint32_t)p->counts.sent - last->played);
    if (last->state == HX_PLAYING) {
        int64_t since = (int64_t)(slowest * (now - last->reported_s) * p->set.rate_hz);
        ahead -= least_of(most_of(since, 0), last->queued);
    }
    int64_t free = (int64_t)last->queued + last->free - ahead;
    return most_of(0, least_of(free, p->set.most_ahead - ahead));
}

/* Mark a sample that the driver does not have yet, as often as it has been asked for and there is
 * room in the driver. */
static void place_marks(hx_player *p, int64_t index) {
    while (p->marks_sent < p->marks_asked && !is_over(p) &&
           p->marks_sent - p->marks_reported < DRIVER_MARKS) {
        uint8_t *payload = p->frame + HX_HEADER_BYTES;
        hx_put_u32(payload, (uint32_t)index);
        hx_put_u16(payload + HX_INDEX_BYTES, p->mark[p->marks_sent % HX_MARKS_KEPT]);
        send_frame(p, HX_MARK, HX_MARK_BYTES);
        p->marks_sent++;
    }
}

/* Send a piece if the horizon lacks one, and find out when it will. */
static void append(hx_player *p) {
    const hx_player_setup *s = &p->set;
    double now = now_s();
    int64_t sent = p->counts.sent;
    if (sent == 0) restart_clock(p, now, 0.0);
    double played = least(played_at(p, now), (double)sent);
    p->forgotten = most_of(p->forgotten, ((int64_t)played - s->revised) / s->grid * s->grid);
    p->source.played(p->source.of, p->forgotten);
    int64_t missing = (int64_t)least((double)s->horizon - ((double)sent - played), (double)room(p, now));
    if (least_of(missing, s->piece) < s->piece) {
        double later_s = (double)(s->piece - missing) / s->rate_hz;
        p->append_due_s = now + later_s + least(appended_within_s, (double)s->piece / s->rate_hz / 2);
        return;
    }
    p->append_due_s = now;
    p->counts.began_s = time_of(p, 0);
    if (p->at + (sent - p->begin) + s->piece > QUEUE) return; /* init has made sure that it fits */
    double *volts = queued_at(p, sent), *last_v = &p->counts.last_v;
    make_window(p, sent, s->piece, 0, volts);
    if (!is_kept(p, volts, s->piece, *last_v) || !is_window_kept(p, sent + s->piece)) return;
    int64_t before = p->counts.bytes_sent;
    place_marks(p, sent);
    for (int64_t at = 0; at < s->piece && !is_over(p); at += s->frame) {
        int64_t count = least_of(s->frame, s->piece - at);
        uint8_t *payload = p->frame + HX_HEADER_BYTES;
        hx_put_u32(payload, (uint32_t)(sent + at));
        put_codes(payload + HX_INDEX_BYTES, p->codes + at, count);
        send_frame(p, HX_STREAM, HX_INDEX_BYTES + 2u * (uint32_t)count);
        p->counts.sent += count;
        *last_v = volts[at + count - 1];
    }
    note_sent(p, now, before);
}

static int is_low(const hx_player *p, double now) {
    return (double)p->counts.sent - played_at(p, now) < (double)p->set.horizon / 4;
}

/* Do what is due; return when to go on at the latest. */
static double step(hx_player *p) {
    const hx_player_setup *s = &p->set;
    double now = now_s(), asked_s = now; /* who stalls after a read knows no silence */
    p->counts.longest_stall_s = most(p->counts.longest_stall_s, now - p->due_s);
    read_reports(p);
    int low = is_low(p, now);
    if (!low && !is_over(p) && !isnan(p->touched_s) && now >= next_revision_s(p)) revise(p);
    read_link(p);
    if (!is_over(p) && !low && now >= next_revision_s(p)) revise(p);
    if (!is_over(p) && (low || now >= p->append_due_s)) append(p);
    if (asked_s - p->last.reported_s > s->watchdog_s) end(p, HX_SILENT);
    if (asked_s - p->owner_s > s->quiet_s) end(p, HX_QUIET);
    now = now_s();
    /* Nothing is revised while too little waits, which only the driver's next report may end. */
    double revision_s = is_low(p, now) ? INFINITY : next_revision_s(p);
    p->due_s = most(now, least(p->append_due_s, revision_s));
    return p->due_s - now;
}

int64_t hx_player_bytes(void) { return (int64_t)sizeof(hx_player); }

int64_t hx_player_init(hx_player *p, const hx_player_setup *setup, const hx_source *source) {
    const hx_player_setup *s = setup;
    int64_t rate = (int64_t)s->rate_hz;
    if (s->grid < 1 || s->frame < 1 || s->revised < s->grid || s->revised > MOST_REVISED ||
        s->piece < s->grid || s->piece > PIECE || s->horizon < s->piece ||
        s->horizon + s->piece + rate / 10 > QUEUE / 2 || s->least < 1 ||
        (s->report_bytes != 0 && s->report_bytes != REPORT))
        return 0;
    memset(p, 0, sizeof *p);
    p->set = *setup;
    p->source = *source;
    p->counts.sequence = s->sequence;
    double now = now_s();
    p->last = (status){now, HX_ARMED, s->queued, s->free, 0, s->underruns, 0, 0, 0};
    p->known_underruns = s->underruns;
    p->need_s = s->guard_s + first_need_s;
    if (s->bytes_per_s > 0.0) p->need_s += 2.0 * (double)s->revised / s->bytes_per_s;
    p->needs[p->need_count++] = p->need_s;
    p->touched_s = NAN;
    p->revised_s = p->carried_s = p->free_s = p->append_due_s = p->told_s = -INFINITY;
    p->due_s = INFINITY;
    p->owner_s = now;
    return 1;
}

int64_t hx_player_run(hx_player *p) {
    while (!is_over(p)) {
        double delay_s = least(step(p), status_s);
        show(p);
        if (is_over(p) || delay_s <= 0.0) continue;
        struct pollfd fds[2] = {{p->set.reports, POLLIN, 0}, {p->set.link, POLLIN, 0}};
        wait_for(fds, 2, delay_s);
    }
    int outcome = p->counts.outcome;
    if (outcome != HX_IN_FAULT && outcome != HX_LOST) send_frame(p, HX_STOP, 0);
    take_played(p, p->counts.sent); /* as if all had been played, so as not to count too little */
    while (!show(p)) sched_yield();
    return outcome;
}

void hx_player_count(hx_player *p, hx_player_counts *to) {
    while (__atomic_test_and_set(&p->is_shown_held, __ATOMIC_ACQUIRE)) sched_yield();
    *to = p->shown;
    __atomic_clear(&p->is_shown_held, __ATOMIC_RELEASE);
}

#endif
