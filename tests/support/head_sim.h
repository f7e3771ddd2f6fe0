/* A rangefinder head on a USB bus that umockdev simulates, below the real libusb: it answers the
 * kernel's usbfs calls. It sends what the test has put in, in order. */
#ifndef SC_TESTS_HEAD_SIM_H
#define SC_TESTS_HEAD_SIM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct head_sim_device {
    uint16_t vendor, product, version; /* version: bcdDevice */
    const char *serial;
};

/* Plugs one to four heads in; bytes come from the first. false: it cannot be simulated here. */
bool head_sim_plug(const struct head_sim_device *devices, unsigned count);
void head_sim_remove(void); /* ends the simulation */

/* What is sent next; transfers end where a piece ends (a short packet). The bytes are the test's.
 * NULL: asks `more` for each transfer. */
void head_sim_send(const uint8_t *bytes, size_t size);
/* Fills a transfer of `capacity` bytes; 0: nothing yet. */
void head_sim_source(size_t (*more)(void *ctx, uint8_t *out_bytes, size_t capacity), void *ctx);

/* The next `count` transfers fail with this errno (EPIPE: a stall, which holds until it is
 * cleared). */
void head_sim_fail(int error, unsigned count);
void head_sim_deny(bool deny);
void head_sim_busy(void);   /* another program has the interface */
void head_sim_unplug(void); /* after what was sent so far */

unsigned head_sim_halts_cleared(void);
unsigned head_sim_most_in_flight(void);

#endif
