/* The rangefinder head over USB, by libusb's asynchronous bulk transfers (docs/head-protocol.md).
 * Several transfers are always under way, so that the head never waits for the program.
 *
 * libusb itself allocates a small block when a transfer is sent again; this file does not. */
#ifndef SC_CAPTURE_HEAD_USB_H
#define SC_CAPTURE_HEAD_USB_H

#include "device/head.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { HEAD_USB_TRANSFERS_MAX = 64, HEAD_USB_TRANSFER_BYTES_MAX = 1 << 20 };

struct head_usb_config {
    uint16_t vendor, product;
    const char *serial;      /* NULL: any, if there is only one */
    unsigned transfers;      /* under way at once */
    unsigned transfer_bytes; /* largest; grows to it with the head's rate, so that at low rates a
                                transfer never lasts long */
};

/* 1209:5c41, any serial number, 8 transfers of 16 KiB. */
struct head_usb_config head_usb_default(void);

/* Opens the head and takes its interface. ST_NOT_FOUND none is plugged in; ST_PERMISSION (the text
 * names the udev rule); ST_BUSY another program has it; ST_UNSUPPORTED its protocol version or its
 * descriptors are not known; ST_INVALID the configuration, or there are two and no serial number
 * was given. */
ST_MUST_CHECK enum st head_usb_open(const struct head_usb_config *config, struct head **out_head,
                                    struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
