/* USB by TinyUSB, which the builder of a board brings along: its callbacks, and one call for the loop.
 *
 * The board's program calls tusb_init() once and hx_usb_task() in its loop, and defines what
 * hx_usb.h asks for. Nothing here runs in an interrupt; TinyUSB queues what those bring.
 */
#include "descriptors.h"
#include "hx_usb.h"
#include "tusb.h"

static enum { NOBODY, HID, BULK, CDC } host;

/* The bytes of a frame come one way; what comes the other way begins a new conversation. */
static void listen_to(int way) {
    if ((int)host != way) {
        hx_usb_release();
        host = way;
    }
}

uint8_t const *tud_descriptor_device_cb(void) { return hx_usb_device; }

uint8_t const *tud_descriptor_configuration_cb(uint8_t index) {
    (void)index;
    return hx_usb_configuration;
}

uint8_t const *tud_hid_descriptor_report_cb(uint8_t instance) {
    (void)instance;
    return hx_usb_hid_report;
}

uint16_t const *tud_descriptor_string_cb(uint8_t index, uint16_t language) {
    static uint16_t text[32];
    static const char *const fixed[] = {"", "haptix", "haptix driver"};
    (void)language;
    if (index > HX_USB_STRING_SERIAL) return NULL;
    const char *ascii = index == HX_USB_STRING_SERIAL ? hx_usb_serial_number() : fixed[index];
    uint32_t n = 0;
    if (index == 0) {
        text[++n] = 0x0409;
    } else {
        while (ascii[n] && n < 31u) {
            text[n + 1u] = (uint8_t)ascii[n];
            n++;
        }
    }
    text[0] = (uint16_t)(0x0300u | (2u * n + 2u));
    return text;
}

uint16_t tud_hid_get_report_cb(uint8_t instance, uint8_t id, hid_report_type_t type,
                               uint8_t *report, uint16_t n) {
    (void)instance, (void)id, (void)type, (void)report, (void)n;
    return 0;
}

void tud_hid_set_report_cb(uint8_t instance, uint8_t id, hid_report_type_t type,
                           uint8_t const *report, uint16_t n) {
    (void)instance, (void)type;
    uint8_t whole[64] = {id};
    listen_to(HID);
    /* From the endpoint the id is the first byte, from the control pipe TinyUSB has taken it off. */
    if (id == 0) {
        hx_usb_receive_report(report, n);
        return;
    }
    for (uint16_t i = 0; i < n && i < 63u; i++) whole[i + 1u] = report[i];
    hx_usb_receive_report(whole, n + 1u);
}

/* A host that closes the port, unplugs, or sends the bus to sleep has gone away. */
void tud_cdc_line_state_cb(uint8_t itf, bool dtr, bool rts) {
    (void)itf, (void)rts;
    if (!dtr && host == CDC) listen_to(NOBODY);
}

void tud_umount_cb(void) { listen_to(NOBODY); }

void tud_suspend_cb(bool remote_wakeup) {
    (void)remote_wakeup;
    listen_to(NOBODY);
}

void hx_usb_task(void) {
    uint8_t bytes[64];
    uint32_t n;
    tud_task();
    if (tud_vendor_available()) {
        listen_to(BULK);
        hx_usb_receive(bytes, tud_vendor_read(bytes, sizeof bytes));
    }
    if (tud_cdc_available()) {
        listen_to(CDC);
        hx_usb_receive(bytes, tud_cdc_read(bytes, sizeof bytes));
    }
    if (host == HID && tud_hid_ready()) {
        n = hx_usb_transmit_report(bytes, sizeof bytes);
        if (n > 0) tud_hid_report(bytes[0], bytes + 1, (uint16_t)(n - 1u));
    } else if (host == BULK && tud_vendor_write_available() >= sizeof bytes) {
        n = hx_usb_transmit(bytes, sizeof bytes);
        if (n > 0) tud_vendor_write(bytes, n);
        tud_vendor_write_flush();
    } else if (host == CDC && tud_cdc_write_available() >= sizeof bytes) {
        n = hx_usb_transmit(bytes, sizeof bytes);
        if (n > 0) tud_cdc_write(bytes, n);
        tud_cdc_write_flush();
    }
}
