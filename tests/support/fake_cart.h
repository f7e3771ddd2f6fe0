/* A small cart for tests of capture, in virtual time: the controller's own firmware on its
 * simulated port; a head whose samples are numbered patterns at the encoder positions of the
 * simulated mirror; index edges; a camera of some pixels. The same calls give the same bytes; an
 * hour of it takes seconds. */
#ifndef SC_TESTS_FAKE_CART_H
#define SC_TESTS_FAKE_CART_H

#include "device/cart_devices.h"
#include "firmware/port/sim/sim.h"

#include <stdbool.h>
#include <stdint.h>

struct fake_cart; /* on the heap */

struct fake_cart_spec {
    double sample_hz;       /* 0: 2000 */
    int64_t host_offset_ns; /* host time when the world begins */
    int64_t power_ns;       /* the power goes then, from the beginning; 0: never */
    bool head_goes_on;      /* not the first session of this head: no RESET */
    uint32_t first_packet, first_sample;
    int64_t head_t_ns;
    unsigned head_version; /* that it claims; 0: the known one */
    bool no_lines, no_camera;
    _Atomic uint64_t *handed_over; /* told how many packets the sink has got; NULL: nobody */
};

struct fake_cart *fake_cart_open(const struct fake_cart_spec *spec); /* NULL: out of memory */
void fake_cart_close(struct fake_cart *cart);

struct cart_devices fake_cart_devices(struct fake_cart *cart);
struct sim *fake_cart_sim(struct fake_cart *cart);

/* From now on, for the packet with this number (counted from the first): leaves it out, spoils a
 * bit, sends it twice. One of each at a time; UINT64_MAX: none. */
void fake_cart_lose(struct fake_cart *cart, uint64_t packet, uint64_t count);
void fake_cart_spoil(struct fake_cart *cart, uint64_t packet);
void fake_cart_repeat(struct fake_cart *cart, uint64_t packet);
void fake_cart_reset_head(struct fake_cart *cart, uint64_t packet);
/* The disk is full, or has room again. */
void fake_cart_disk_full(struct fake_cart *cart, bool full);
/* The camera gives no frame for its n-th (from 0) photograph. */
void fake_cart_no_frame(struct fake_cart *cart, unsigned photograph);

/* Sent so far, lost ones included. */
uint64_t fake_cart_packets(const struct fake_cart *cart);
uint64_t fake_cart_samples(const struct fake_cart *cart); /* numbered */

#endif
