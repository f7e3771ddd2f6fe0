/* Inside of the simulated port. */
#ifndef SC_SIMSTATE_H
#define SC_SIMSTATE_H

#include "firmware/core/firmware.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_flash.h"
#include "firmware/hal/hal_time.h"
#include "firmware/port/sim/sim.h"

#define SIMSTATE_RX     4096u
#define SIMSTATE_TX     4096u
#define SIMSTATE_FAULTS 64u
#define SIMSTATE_NEVER  UINT64_MAX

/* The mirror between two plant steps: rev0 + rps0 s + acceleration / 2 s^2, s in seconds since
 * t0_us. */
struct simplant_segment {
    double t0_us, rev0, rps0, acceleration;
};

struct simplant_axis {
    double motor, head; /* steps, mechanical zero */
    int64_t pulses;
    bool positive;
    uint64_t last_pulse_us;
    bool blocked;
    uint32_t lose; /* steps still to lose */
};

struct simline_byte {
    uint64_t t_us;
    uint8_t byte;
};

struct simfault_entry {
    uint64_t t_us, order;
    enum sim_fault fault;
    double value;
    bool waiting;
};

struct sim {
    struct sim_config config;
    struct firmware firmware;
    struct hal_board board;
    uint64_t now_us, boot_us;
    uint64_t random;
    const struct sim_observer *observer;
    void *observer_ctx;
    /* schedule */
    uint64_t next_tick, next_poll, next_plant, alarm_us, alarm_slip_us;
    bool in_poll, in_interrupt;
    unsigned locked;
    /* line */
    struct simline_byte rx[SIMSTATE_RX], tx[SIMSTATE_TX];
    uint32_t rx_head, rx_tail, tx_head, tx_tail;
    uint64_t rx_free_us, tx_end_us;
    bool line_cut;
    double line_noise;
    /* plant */
    struct simplant_segment mirror;
    double mirror_gain; /* surge factor */
    bool mirror_blocked;
    uint16_t drive;
    double index_us; /* next index edge within the segment, INFINITY none */
    uint32_t index_skip;
    bool index_extra;
    bool encoder_dead;
    uint16_t encoder_frozen;
    int32_t encoder_slip;
    struct simplant_axis axis[HAL_AXES];
    uint32_t chains, forced; /* chain bits closed; switch bits forced closed */
    bool home_dead, laser_stuck, laser, motors, temp_broken, clock_bad, flash_bad;
    double temperature_c;
    uint16_t stack_free;
    uint64_t trigger_end_us;
    double strobe_us; /* INFINITY none */
    uint32_t strobe_skip;
    uint8_t flash[HAL_FLASH_SIZE];
    struct simfault_entry faults[SIMSTATE_FAULTS];
    uint64_t fault_order, fault_next_us; /* number of the next one queued; time of the earliest */
};

/* The instance whose firmware runs in this thread. */
extern _Thread_local struct sim *simstate_current;

/* sim.c: interrupts (not the main loop) until `t_us`. */
void simstate_interrupts_until(struct sim *sim, uint64_t t_us);
/* Uniform in [0, 1), and normal with unit sigma (sum of twelve). */
double simstate_uniform(struct sim *sim);
double simstate_normal(struct sim *sim);

/* simplant.c */
void simplant_init(struct sim *sim);
void simplant_step(struct sim *sim); /* at next_plant: a new mirror segment */
void simplant_cut(struct sim *sim);  /* a new mirror segment from now on, after a change */
double simplant_rev(const struct sim *sim, double t_us);
double simplant_rps(const struct sim *sim, double t_us);
uint16_t simplant_encoder(const struct sim *sim, double t_us);
void simplant_pulse(struct sim *sim, enum hal_axis axis);
uint32_t simplant_inputs(const struct sim *sim);

/* simfault.c */
void simfault_run(struct sim *sim); /* at fault_next_us: the earliest */

#endif
