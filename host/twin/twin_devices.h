/* The simulated cart as the devices that capture is given (device/cart_devices.h): motor (the
 * controller's own firmware behind its register map), rangefinder head (packets in transfers of
 * several), lines (index, strobe, e-stop, interlock) and camera (frames as JPEG).
 *
 * Virtual time: one thread drives everything; time passes only in the hosttime's wait_until() and,
 * a few ms an operation, in the motor's operations (the Modbus transaction) and in the camera's
 * frame(). pump() hands over what has come and waits at most its time-out, in virtual time. The
 * same calls give the same bytes.
 *
 * Real time: a thread of the twin follows the host's monotonic clock; each device may be used by a
 * thread of its own, one at a time each. The host clock is CLOCK_MONOTONIC itself, so the twin's
 * host drift and offset are left out; jumps of the host clock are not simulated. */
#ifndef SC_TWIN_TWIN_DEVICES_H
#define SC_TWIN_TWIN_DEVICES_H

#include "base/pose.h"
#include "device/cart_devices.h"
#include "twin/cart.h"
#include "twin/faults.h"
#include "twin/scene.h"
#include "twin/twin_config.h"

#include <stdint.h>

struct twin_devices; /* on the heap */

struct twin_devices_spec {
    const struct scene *scene;        /* outlives the devices */
    const struct twin_config *config; /* copied */
    const struct faults *faults;      /* copied; NULL: none. Seconds since opening */
    struct pose world_from_station;   /* true */
    uint64_t seed;
    bool real_time;
    /* Told of each sample as it really was, in order; may be NULL. In real time from the twin's
     * own thread. */
    void (*shot)(void *ctx, const struct cart_shot *shot);
    void *shot_ctx;
};

/* Opens all devices; the controller has just been switched on (idle, not homed), time 0. ST_NOMEM;
 * ST_IO if a thread cannot be started; ST_INVALID for a configuration that makes no cart. */
ST_MUST_CHECK enum st twin_devices_open(const struct twin_devices_spec *spec,
                                        struct twin_devices **out_twin, struct errctx *err);

/* The devices, valid until twin_devices_close(). Their close ops may be called or not: the devices
 * end with the twin. After a power loss (a fault) each returns ST_CANCELLED. */
struct cart_devices twin_devices_cart(struct twin_devices *twin);

/* True pose of the head's optics is world_from_station; the state of the cart now, for truth. Not
 * while another thread uses the devices. */
const struct cart *twin_devices_truth(const struct twin_devices *twin);

void twin_devices_close(struct twin_devices *twin); /* takes NULL */

#endif
