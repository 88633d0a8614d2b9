/* Instructions for each output sample, counted by qemu (-icount shift=0: one is 1 ns). */
#include "haptix_device.h"
#include "startup.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xe000e010)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xe000e014)
#define SYSTICK (*(volatile uint32_t *)0xe000e018)
#define PIECE_BYTES 32u
#define NS_PER_TICK 40u /* the board's 25 MHz, counted down in 24 bits */

static hx_device device;
static uint8_t frame[1024];
static int16_t out[1024];

static const hx_config config = {
    48000, 250000, 200000, 4666666, 1000, 500, 160, 64, 0, 2, {{48000, 3}, {16000, 3}}, "m0", "1", "", 16, 0, 0, 0};

/* Make a frame of what stands in the payload. */
static void seal(uint8_t kind, uint16_t mode, uint32_t length) {
    frame[0] = 'H';
    frame[1] = 'X';
    frame[2] = HX_VERSION;
    frame[3] = kind;
    hx_put_u16(frame + 4, device.next_sequence);
    hx_put_u16(frame + 6, (uint16_t)length);
    hx_put_u16(frame + 8, mode);
    hx_put_u16(frame + 10, hx_crc16(frame, 10));
    hx_put_u32(frame + 12 + length, hx_crc32(frame, 12 + length));
}

static void arm(uint16_t mode) {
    uint8_t *payload = frame + HX_HEADER_BYTES;
    for (uint32_t i = 0; i < sizeof frame; i++) frame[i] = 0;
    hx_put_u16(payload, mode);
    hx_put_u16(payload + 2, 160);
    hx_put_u32(payload + 4, mode ? 16000 : 48000);
    hx_put_u32(payload + 8, 250000);
    hx_put_u32(payload + 12, 200000);
    hx_put_u32(payload + 16, 4666666);
    hx_put_u32(payload + 20, mode ? 4000000 : 0);
    seal(HX_SETUP, 0, HX_SETUP_BYTES);
    hx_device_receive(&device, frame, HX_SETUP_BYTES + HX_FRAME_OVERHEAD_BYTES);
    seal(HX_ARM, 0, 0);
    hx_device_receive(&device, frame, HX_FRAME_OVERHEAD_BYTES);
}

static void say(const char *words, uint32_t number) {
    char text[12];
    uint32_t at = sizeof text - 1;
    text[at] = 0;
    text[--at] = '\n';
    do text[--at] = (char)('0' + number % 10);
    while ((number /= 10) > 0);
    call_host(0x04, words);
    call_host(0x04, text + at);
}

/* A revision of n samples, in pieces as a board hands them over with the output's interrupt kept
 * out: instructions of the longest piece, which completes the frame. */
static uint32_t revise(uint16_t mode, uint32_t n) {
    uint32_t length = HX_REVISE_HEAD_BYTES + 2 * n + HX_FRAME_OVERHEAD_BYTES, longest = 0;
    hx_put_u32(frame + HX_HEADER_BYTES, 20);
    hx_put_u16(frame + HX_HEADER_BYTES + 4, device.revisions);
    for (uint32_t i = 0; i < n; i++)
        hx_put_u16(frame + HX_HEADER_BYTES + 6 + 2 * i, (uint16_t)((i + 20) * 37 % 9000));
    seal(HX_REVISE, mode, HX_REVISE_HEAD_BYTES + 2 * n);
    for (uint32_t start = 0; start < length; start += PIECE_BYTES) {
        uint32_t begin = SYSTICK, piece = length - start;
        if (piece > PIECE_BYTES) piece = PIECE_BYTES;
        hx_device_receive(&device, frame + start, piece);
        uint32_t took = (begin - SYSTICK) & 0xffffff;
        if (took > longest) longest = took;
    }
    return longest * NS_PER_TICK;
}

void board_main(void) {
    static const char *const words[2][2] = {{"waveform receive ", "waveform play "},
                                            {"envelope receive ", "envelope play "}};
    SYSTICK_RELOAD = 0xffffff;
    SYSTICK = 0;
    SYSTICK_CONTROL = 5;
    for (uint16_t mode = 0; mode < 2; mode++) {
        uint32_t n = mode ? 83 : 240, outputs = mode ? 3 * n : n; /* some 5 ms */
        hx_device_init(&device, &config);
        arm(mode);
        hx_put_u32(frame + HX_HEADER_BYTES, 0);
        for (uint32_t i = 0; i < n; i++)
            hx_put_u16(frame + HX_HEADER_BYTES + 4 + 2 * i, (uint16_t)(i * 37 % 9000));
        seal(HX_STREAM, mode, 4 + 2 * n);
        uint32_t begin = SYSTICK;
        hx_device_receive(&device, frame, 4 + 2 * n + HX_FRAME_OVERHEAD_BYTES);
        uint32_t received = (begin - SYSTICK) & 0xffffff;
        uint32_t revised = revise(mode, 32), revised_longer = revise(mode, 62);
        if (device.revisions != 2) leave("a revision was refused\n", 0);
        begin = SYSTICK;
        hx_device_play(&device, out, 0, outputs);
        uint32_t played = (begin - SYSTICK) & 0xffffff;
        if (device.samples_played != n) leave("the stream was refused\n", 0);
        hx_device_play(&device, out, 0, 400); /* the end of a block of the window, for make size */
        say(words[mode][0], received * NS_PER_TICK / outputs);
        say(words[mode][1], played * NS_PER_TICK / outputs);
        uint32_t each = (revised_longer - revised) / 30u;
        say(mode ? "envelope revise each " : "waveform revise each ", each);
        say(mode ? "envelope revise besides " : "waveform revise besides ", revised - 32u * each);
    }
    /* The converter's samples of 5 ms of a carrier, block by block as a board hands them over. */
    hx_config sensing = config;
    sensing.sense_rate_hz = 250;
    sensing.sense_full_scale_na = 20000000;
    sensing.panel_pf = 2000;
    hx_device_init(&device, &sensing);
    arm(1);
    hx_put_u32(frame + HX_HEADER_BYTES, 0);
    for (uint32_t i = 0; i < 160; i++) hx_put_u16(frame + HX_HEADER_BYTES + 4 + 2 * i, (uint16_t)(i * 80));
    seal(HX_STREAM, 1, 4 + 2 * 160);
    hx_device_receive(&device, frame, 4 + 2 * 160 + HX_FRAME_OVERHEAD_BYTES);
    uint32_t sensed = 0;
    int16_t raw[24], before = 0;
    for (uint32_t block = 0; block < 20; block++) {
        hx_device_play(&device, out, 0, 24);
        for (uint32_t i = 0; i < 24; i++) { /* 0.628 of the drive, a quarter period ahead */
            int32_t code = (out[i] * 1783 - before * 2059) * 5 / 8192;
            raw[i] = (int16_t)(code + (int16_t)(i % 3) * 16);
            before = out[i];
        }
        uint32_t begin = SYSTICK;
        hx_device_sense(&device, out, raw, 24, 0);
        sensed += (begin - SYSTICK) & 0xffffff;
    }
    if (device.sensor.doubt || device.fault.code) leave("the converter is not believed\n", 0);
    say("envelope sense ", sensed * NS_PER_TICK / 480);
    leave("", 1);
}
