/* A cart that lives in the host's real time and costs next to nothing: a motor that obeys at once,
 * a head that sends prepared packets at any rate. For tests and benchmarks of capture's threads. */
#ifndef SC_TESTS_FAST_CART_H
#define SC_TESTS_FAST_CART_H

#include "device/cart_devices.h"

#include <stdint.h>

struct fast_cart; /* on the heap */

/* sample_hz: 34 samples a packet, 32 packets a transfer (fewer at low rates: one each 10 ms). */
struct fast_cart *fast_cart_open(double sample_hz); /* NULL: out of memory */
void fast_cart_close(struct fast_cart *cart);
struct cart_devices fast_cart_devices(struct fast_cart *cart);

/* Handed over so far. Any thread. */
uint64_t fast_cart_packets(struct fast_cart *cart);
/* Transfers that came more than 2 s late: the machine was too slow for the rate. */
uint64_t fast_cart_late(struct fast_cart *cart);

/* Called around each hand-over to the sink, on the head's and the lines' thread; NULL: nobody. */
void fast_cart_watch(struct fast_cart *cart, void (*watch)(void *ctx, int inside), void *ctx);

#endif
