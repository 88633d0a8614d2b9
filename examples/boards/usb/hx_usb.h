/* Between tinyusb.c and the board's program, which defines all of these but hx_usb_task.
 *
 * Each is a call of the core (haptix_device.h) with the output's interrupt held back around it.
 */
#ifndef HX_USB_H
#define HX_USB_H

#include <stdint.h>

/* Once in every round of the main loop. */
void hx_usb_task(void);

void hx_usb_receive(const uint8_t *bytes, uint32_t n);
void hx_usb_receive_report(const uint8_t *report, uint32_t n);
/* At most `capacity` bytes of what the core has to say; frames may be cut anywhere. */
uint32_t hx_usb_transmit(uint8_t *bytes, uint32_t capacity);
uint32_t hx_usb_transmit_report(uint8_t *report, uint32_t capacity);
void hx_usb_release(void);
const char *hx_usb_serial_number(void);

#endif
