/* A GPIO chip that a test controls: gpiochip0, label "test-chip", 8 lines, of which 0 to 3 are
 * named GPIO17, GPIO27, GPIO22 and GPIO23. chip_sim_umockdev.c puts it below the real libgpiod 1.x,
 * gpiod2/gpiod_mock.c is a libgpiod 2.x on top of it. */
#ifndef SC_TESTS_CHIP_SIM_H
#define SC_TESTS_CHIP_SIM_H

#include <stdbool.h>
#include <stdint.h>

enum { CHIP_SIM_LINES = 8 };

#define CHIP_SIM_LABEL "test-chip"
extern const char *const chip_sim_name[CHIP_SIM_LINES]; /* "" without a name */

bool chip_sim_plug(void);   /* false: it cannot be simulated here */
void chip_sim_remove(void); /* ends the simulation */

void chip_sim_deny(bool deny); /* opening the chip gives EACCES */
void chip_sim_busy(unsigned offset);
void chip_sim_level(unsigned offset, bool high);
/* An edge, if the program asked for it. */
void chip_sim_edge(unsigned offset, bool rising, int64_t t_ns);
void chip_sim_unplug(void); /* in use: what is asked of the chip gives ENODEV */

/* Edges that the kernel drops; false: this interface cannot say. */
bool chip_sim_lose(unsigned offset, unsigned count);

#endif
