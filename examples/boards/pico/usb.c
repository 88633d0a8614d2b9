/* USB without a stack: the controller of RP2040 and RP2350 as a full-speed device (4.1 and 12.7 in their
 * datasheets), served by the loop.
 *
 * Its interrupt only wakes the loop. Each endpoint has one buffer in each direction. What TinyUSB does on
 * other boards (../usb/tinyusb.c) is done here for one chip, so that a Pico needs nobody else's code.
 */
#include <stddef.h>

#include "../usb/descriptors.h"
#include "../usb/hx_usb.h"
#include "board.h"
#include "registers.h"

#define PACKET 64u
#define AVAILABLE (1u << 10)
#define STALL (1u << 11)
#define ODD (1u << 13) /* DATA1 */
#define FULL (1u << 15)
#define LENGTH 0x3ffu
#define EVENTS (1u << 16 | 1u << 12 | 1u << 4) /* a SETUP, a reset of the bus, a buffer */
enum { SIE_RESET = 1 << 19, SIE_SETUP = 1 << 17, SIE_SUSPENDED = 1 << 4 };
enum { HID = 1, BULK = 2, CDC = 3, NOTIFY = 4 }; /* endpoints, and the ways by which a host speaks */

#define CONTROL(endpoint, is_out) (*(reg *)(USB_MEMORY + 8u * (endpoint) + 4u * (is_out)))
#define BUFFER_CONTROL(endpoint, is_out) (*(reg *)(USB_MEMORY + 0x80u + 8u * (endpoint) + 4u * (is_out)))

static uint32_t host;          /* the endpoint that was spoken to last, 0: none */
static uint32_t address;       /* to take once its request has been answered */
static uint32_t is_configured, is_suspended;
static uint32_t parity[5][2];  /* of the next packet */
static uint32_t is_sending[5];
static const uint8_t *answer;  /* what is left of an answer of endpoint 0 */
static uint32_t answer_left, ends_short;
static uint8_t text[2u + 2u * 16u];

static volatile uint8_t *buffer_of(uint32_t endpoint, uint32_t is_out) {
    if (endpoint == 0) return (volatile uint8_t *)(USB_MEMORY + 0x100u);
    return (volatile uint8_t *)(USB_MEMORY + 0x180u + PACKET * (2u * endpoint + is_out));
}

/* The controller takes a buffer once it sees AVAILABLE, in a slower clock: the rest stands before. */
static void hand_over(uint32_t endpoint, uint32_t is_out, uint32_t bits) {
    uint32_t *odd = &parity[endpoint][is_out];
    reg *control = &BUFFER_CONTROL(endpoint, is_out);
    bits |= *odd ? ODD : 0u;
    *odd ^= 1u;
    *control = bits;
    for (int wait = 0; wait < 12; wait++) __asm__ volatile("nop");
    *control = bits | AVAILABLE;
}

static void listen(uint32_t endpoint) { hand_over(endpoint, 1, PACKET); }

static void send(uint32_t endpoint, const uint8_t *bytes, uint32_t n) {
    volatile uint8_t *to = buffer_of(endpoint, 0);
    for (uint32_t i = 0; i < n; i++) to[i] = bytes[i];
    is_sending[endpoint] = 1;
    hand_over(endpoint, 0, FULL | n);
}

/* The bytes of a frame come one way; what comes another way begins a new conversation. */
static void listen_to(uint32_t way) {
    if (host == way) return;
    hx_usb_release();
    host = way;
}

static void send_answer(void) {
    uint32_t n = answer_left < PACKET ? answer_left : PACKET;
    if (n < PACKET) ends_short = 0;
    send(0, answer, n);
    answer += n;
    answer_left -= n;
}

static void answer_with(const uint8_t *bytes, uint32_t n, uint32_t wanted) {
    answer = bytes;
    answer_left = n < wanted ? n : wanted;
    ends_short = n < wanted; /* a whole packet is then followed by an empty one */
    send_answer();
}

static void refuse(void) {
    USB->STALL_ARM = 3u;
    BUFFER_CONTROL(0, 0) = STALL;
    BUFFER_CONTROL(0, 1) = STALL;
}

static uint32_t string(uint32_t index) {
    static const char *const fixed[] = {"", "haptix", "haptix driver"};
    const char *ascii = index == HX_USB_STRING_SERIAL ? hx_usb_serial_number() : fixed[index];
    uint32_t n = 2;
    if (index == 0) {
        text[n++] = 0x09, text[n++] = 0x04; /* American English */
    } else {
        for (; *ascii && n < sizeof text; ascii++) text[n++] = (uint8_t)*ascii, text[n++] = 0;
    }
    text[0] = (uint8_t)n, text[1] = 3;
    return n;
}

static void describe(uint32_t kind, uint32_t index, uint32_t wanted) {
    if (kind == 1) answer_with(hx_usb_device, sizeof hx_usb_device, wanted);
    else if (kind == 2) answer_with(hx_usb_configuration, sizeof hx_usb_configuration, wanted);
    else if (kind == 3 && index <= HX_USB_STRING_SERIAL) answer_with(text, string(index), wanted);
    else if (kind == 0x22) answer_with(hx_usb_hid_report, sizeof hx_usb_hid_report, wanted);
    else if (kind == 0x21) answer_with(hx_usb_configuration + 18, 9, wanted);
    else refuse();
}

static void configure(uint32_t is_on) {
    static const struct { uint8_t endpoint, is_out, kind; } used[] = {
        {HID, 0, HX_USB_INTERRUPT}, {HID, 1, HX_USB_INTERRUPT}, {BULK, 0, HX_USB_BULK_KIND},
        {BULK, 1, HX_USB_BULK_KIND}, {CDC, 0, HX_USB_BULK_KIND}, {CDC, 1, HX_USB_BULK_KIND},
        {NOTIFY, 0, HX_USB_INTERRUPT}};
    is_configured = is_on;
    for (uint32_t i = 0; i < sizeof used / sizeof used[0]; i++) {
        uint32_t endpoint = used[i].endpoint, is_out = used[i].is_out;
        uint32_t at = (uint32_t)(uintptr_t)buffer_of(endpoint, is_out) - USB_MEMORY;
        parity[endpoint][is_out] = is_sending[endpoint] = 0;
        BUFFER_CONTROL(endpoint, is_out) = 0;
        CONTROL(endpoint, is_out) = is_on ? 1u << 31 | 1u << 29 | (uint32_t)used[i].kind << 26 | at : 0u;
        if (is_on && is_out) listen(endpoint);
    }
}

static void take_setup(void) {
    const volatile uint8_t *p = (const volatile uint8_t *)USB_MEMORY;
    static uint8_t line_coding[7] = {0x00, 0xc2, 0x01, 0x00, 0, 0, 8}; /* 115200 baud, 8N1: means nothing */
    static uint8_t state[2];
    uint32_t kind = p[0], request = p[1], value = p[2] | (uint32_t)p[3] << 8;
    uint32_t wanted = p[6] | (uint32_t)p[7] << 8;
    BUFFER_CONTROL(0, 0) = BUFFER_CONTROL(0, 1) = 0;
    parity[0][0] = parity[0][1] = 1; /* behind a SETUP comes DATA1 */
    answer = NULL;
    answer_left = ends_short = 0;
    state[0] = state[1] = 0;
    switch (kind << 8 | request) {
    case 0x8006: case 0x8106: describe(value >> 8, value & 0xffu, wanted); return;
    case 0x8000: case 0x8100: case 0x8200: answer_with(state, 2, wanted); return;
    case 0x8008: state[0] = (uint8_t)is_configured; answer_with(state, 1, wanted); return;
    case 0x810a: answer_with(state, 1, wanted); return;
    case 0xa121: answer_with(line_coding, sizeof line_coding, wanted); return;
    case 0x2120: listen(0); return; /* line coding: its data are taken, and mean nothing */
    case 0x0005: address = value & 0x7fu; break;
    case 0x0009: listen_to(0); configure(value & 0xffu); break;
    case 0x0201: break; /* clear halt: no endpoint halts */
    case 0x010b: case 0x210a: break; /* the only alternate setting; HID's idle rate */
    case 0x2122:
        if (!(value & 1u) && host == CDC) listen_to(0); /* the port was closed */
        break;
    default: refuse(); return;
    }
    send(0, NULL, 0);
}

static void received(uint32_t endpoint) {
    uint8_t bytes[PACKET];
    uint32_t n = BUFFER_CONTROL(endpoint, 1) & LENGTH;
    volatile uint8_t *from = buffer_of(endpoint, 1);
    if (n > PACKET) n = PACKET;
    for (uint32_t i = 0; i < n; i++) bytes[i] = from[i];
    if (endpoint == 0) { /* data of a request are acknowledged; an empty packet ends an answer */
        if (n > 0) parity[0][0] = 1, send(0, NULL, 0);
        return;
    }
    listen(endpoint);
    if (n == 0) return;
    listen_to(endpoint);
    if (endpoint == HID) hx_usb_receive_report(bytes, n);
    else hx_usb_receive(bytes, n);
}

static void sent(uint32_t endpoint) {
    is_sending[endpoint] = 0;
    if (endpoint != 0) return;
    if (address != 0) {
        USB->ADDRESS = address;
        address = 0;
    }
    if (answer_left > 0) {
        send_answer();
    } else if (ends_short) {
        ends_short = 0;
        send(0, NULL, 0);
    } else if (answer != NULL) {
        answer = NULL;
        parity[0][1] = 1;
        hand_over(0, 1, PACKET); /* the host's empty packet */
    }
}

static void transmit(void) {
    uint8_t bytes[PACKET];
    if (host == 0 || is_sending[host]) return;
    uint32_t n = host == HID ? hx_usb_transmit_report(bytes, PACKET) : hx_usb_transmit(bytes, PACKET);
    if (n > 0) send(host, bytes, n);
}

void hx_usb_task(void) {
    uint32_t status = USB->STATUS;
    if (status & SIE_RESET) {
        USB->STATUS = SIE_RESET;
        USB->ADDRESS = 0;
        listen_to(0);
        configure(0);
    }
    if (!!(status & SIE_SUSPENDED) != is_suspended) { /* a bus that sleeps, or an unplugged cable */
        is_suspended = !is_suspended;
        if (is_suspended) listen_to(0);
    }
    if (status & SIE_SETUP) {
        USB->STATUS = SIE_SETUP;
        take_setup();
    }
    uint32_t done = USB->BUFFERS;
    for (uint32_t bit = 0; bit < 10u; bit++) {
        if (!(done >> bit & 1u)) continue;
        USB->BUFFERS = 1u << bit;
        if (bit % 2u) received(bit / 2u);
        else sent(bit / 2u);
    }
    if (is_configured) transmit();
}

void board_usb_interrupt(void) { NVIC_ICER = 1u << IRQ_USB; }

void board_usb_wait(void) {
    NVIC_ISER = 1u << IRQ_USB;
    /* With interrupts held back none slips in between the question and the sleep, which it ends. */
    __asm__ volatile("cpsid i" ::: "memory");
    if (!USB->INTS) __asm__ volatile("wfi");
    __asm__ volatile("cpsie i" ::: "memory");
}

void board_usb_begin(void) {
    for (reg *word = (reg *)USB_MEMORY; word < (reg *)(USB_MEMORY + 0x180u); word++) *word = 0;
    USB->MUXING = 1u | 1u << 3;      /* the chip's own pins, by the controller */
    USB->POWER = 1u << 3 | 1u << 2;  /* the cable counts as plugged in */
    USB->MAIN = 1u; /* and, on an RP2350, its pins let go */
    USB->INTE = EVENTS;
    USB->SIE = 1u << 29;             /* endpoint 0 tells of each packet */
    SET(USB->SIE) = 1u << 16;        /* pull-up: the host sees a device */
}
