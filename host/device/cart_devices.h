/* All devices of one cart with the time they live in: what capture is given. */
#ifndef SC_DEVICE_CART_DEVICES_H
#define SC_DEVICE_CART_DEVICES_H

#include "device/camera_device.h"
#include "device/head.h"
#include "device/hosttime.h"
#include "device/lines.h"
#include "device/motor.h"

#ifdef __cplusplus
extern "C" {
#endif

struct cart_devices {
    const struct hosttime *hosttime;
    struct motor *motor;
    struct head *head;
    struct lines *lines;          /* NULL: none wired */
    struct camera_device *camera; /* NULL: none */
    /* True while the site's disk should be taken as full: a fault of simulated carts. NULL: never.
     */
    bool (*disk_full)(void *ctx);
    void *ctx;
};

#ifdef __cplusplus
}
#endif
#endif
