/* What a full-speed driver says of itself on USB, as PROTOCOL.md states it: data, and no code.
 *
 * Interface 0: HID, reports of 64 bytes both ways. Interface 1: vendor class, a pair of bulk
 * endpoints. Interfaces 2 and 3: CDC, a serial port. The same frames go over each; the device
 * answers where it was last spoken to.
 */
#ifndef HAPTIX_USB_DESCRIPTORS_H
#define HAPTIX_USB_DESCRIPTORS_H

#include <stdint.h>

#define HX_USB_LOW(value) ((value) & 0xffu)
#define HX_USB_HIGH(value) ((value) >> 8 & 0xffu)
#define HX_USB_U16(value) HX_USB_LOW(value), HX_USB_HIGH(value)

/* pid.codes' number for testing: a board that is sold needs one of its own. */
#define HX_USB_VENDOR 0x1209u
#define HX_USB_PRODUCT 0x0001u

enum { HX_USB_HID = 0, HX_USB_BULK = 1, HX_USB_CDC = 2, HX_USB_CDC_DATA = 3, HX_USB_INTERFACES = 4 };
enum { HX_USB_STRING_MAKER = 1, HX_USB_STRING_PRODUCT = 2, HX_USB_STRING_SERIAL = 3 };

static const uint8_t hx_usb_device[18] = {
    18, 1, HX_USB_U16(0x0200u), 0xef, 2, 1, /* interface association: CDC is two interfaces */
    64, HX_USB_U16(HX_USB_VENDOR), HX_USB_U16(HX_USB_PRODUCT), HX_USB_U16(0x0100u),
    HX_USB_STRING_MAKER, HX_USB_STRING_PRODUCT, HX_USB_STRING_SERIAL, 1};

/* Vendor's page; report 1, 63 bytes behind its id, in and out. */
static const uint8_t hx_usb_hid_report[27] = {
    0x06, 0x00, 0xff, 0x09, 0x01, 0xa1, 0x01, 0x85, 0x01, 0x15, 0x00, 0x26, 0xff, 0x00,
    0x75, 0x08, 0x95, 0x3f, 0x09, 0x02, 0x81, 0x02, 0x09, 0x03, 0x91, 0x02, 0xc0};

#define HX_USB_INTERFACE(number, endpoints, class, subclass) \
    9, 4, number, 0, endpoints, class, subclass, 0, 0
#define HX_USB_ENDPOINT(address, kind, size, interval) 7, 5, address, kind, HX_USB_U16(size), interval
#define HX_USB_INTERRUPT 3
#define HX_USB_BULK_KIND 2
#define HX_USB_CONFIGURATION_BYTES (9u + (9u + 9u + 14u) + (9u + 14u) + (8u + 9u + 19u + 7u) + (9u + 14u))

static const uint8_t hx_usb_configuration[HX_USB_CONFIGURATION_BYTES] = {
    9, 2, HX_USB_U16(HX_USB_CONFIGURATION_BYTES), HX_USB_INTERFACES, 1, 0, 0x80, 50, /* 100 mA */

    HX_USB_INTERFACE(HX_USB_HID, 2, 3, 0),
    9, 0x21, HX_USB_U16(0x0111u), 0, 1, 0x22, HX_USB_U16(27u),
    HX_USB_ENDPOINT(0x81, HX_USB_INTERRUPT, 64u, 1),
    HX_USB_ENDPOINT(0x01, HX_USB_INTERRUPT, 64u, 1),

    HX_USB_INTERFACE(HX_USB_BULK, 2, 0xff, 0),
    HX_USB_ENDPOINT(0x82, HX_USB_BULK_KIND, 64u, 0),
    HX_USB_ENDPOINT(0x02, HX_USB_BULK_KIND, 64u, 0),

    8, 11, HX_USB_CDC, 2, 2, 2, 0, 0,
    HX_USB_INTERFACE(HX_USB_CDC, 1, 2, 2),
    5, 0x24, 0, HX_USB_U16(0x0110u),          /* CDC 1.10 */
    5, 0x24, 1, 0, HX_USB_CDC_DATA,           /* call management: none */
    4, 0x24, 2, 2,                            /* line coding and line state */
    5, 0x24, 6, HX_USB_CDC, HX_USB_CDC_DATA,  /* union */
    HX_USB_ENDPOINT(0x84, HX_USB_INTERRUPT, 8u, 16),
    HX_USB_INTERFACE(HX_USB_CDC_DATA, 2, 10, 0),
    HX_USB_ENDPOINT(0x83, HX_USB_BULK_KIND, 64u, 0),
    HX_USB_ENDPOINT(0x03, HX_USB_BULK_KIND, 64u, 0)};

#endif
