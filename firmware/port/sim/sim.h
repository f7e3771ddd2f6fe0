/* The simulated port: the real firmware core on a virtual clock, with a plant around it (pan and
 * tilt with switches and backlash, mirror with inertia, index and encoder, camera, laser,
 * temperature, serial line) and named faults.
 *
 * Deterministic: same configuration and same calls, same results to the bit. Virtual time advances
 * only in the functions that say so. Any number of instances; each belongs to one thread at a time
 * (the current instance is a thread-local pointer that each sim_ function sets).
 *
 * Time is the controller's own clock: it is exact here; a twin gives it offset and drift. Host
 * side: create allocates. */
#ifndef SC_SIM_H
#define SC_SIM_H

#include "firmware/hal/hal_axis.h"
#include "firmware/hal/hal_safety.h"
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct sim;

struct sim_axis_config {
    double travel_min, travel_max; /* mechanical stops, steps from the mechanical zero */
    double limit_min, limit_max;   /* limit switches close outside these */
    double home_edge;              /* home switch is closed below this */
    double start;                  /* where the axis stands at power-up */
    double backlash;               /* lost motion between motor and head, steps */
    double stall_velocity;         /* steps/s above which the motor loses steps */
};

struct sim_config {
    struct sim_axis_config axis[HAL_AXES];
    double mirror_gain_rps; /* speed at full drive */
    double mirror_tau_s;    /* time constant of the mirror with its motor */
    double
        mirror_jitter; /* sigma of random acceleration, rev/s per square root of a second; 0 none */
    double mirror_start_rev; /* angle at power-up, 0 to 1; the index lies at 0 */
    /* Unevenness within a turn: the speed is 1 + ripple cos(angle + phase) times the smooth one. */
    double mirror_ripple, mirror_ripple_phase_rad;
    double capture_jitter_us; /* sigma of the hardware's captures of index and strobe */
    uint16_t encoder_counts;
    double camera_delay_s;  /* trigger to strobe */
    double camera_jitter_s; /* uniform, added to it */
    double temperature_c;
    uint32_t baud;
    uint32_t frame_gap_us; /* 0: from the baud rate */
    uint32_t poll_us;      /* time between passes of the main loop; >= 1 */
    uint32_t poll_slip_us; /* time that passes, with its interrupts, at each end of an interrupt
                            * lock in the main loop: shows races between the two. 0 none */
    uint32_t clock_start;  /* hal_time_now at power-up: to test its wrap-around */
    uint32_t flash_us;     /* time that a flash write takes */
    bool pin_interrupts;   /* safety inputs raise firmware_isr_pins, the clock
                              firmware_isr_clock_failure */
    bool encoder;          /* HAL_CAP_ENCODER */
    bool lossless_line;    /* bytes take no time: requests are answered one frame gap later */
    uint64_t seed;         /* of jitter and noise */
    uint32_t serial;
};

/* A cart as nominally built: 28 000 steps a turn, mirror 4096 counts, 115 200 baud. */
struct sim_config sim_config_default(void);

/* Power-up with erased flash at time 0: firmware_init has run. NULL if out of memory or if the
 * configuration makes no sense. */
struct sim *sim_create(const struct sim_config *config);
void sim_destroy(struct sim *sim);

/* Resets the controller (all its RAM lost, flash and plant kept) with an enum resetcause. Time goes
 * on; uptime restarts. */
void sim_reset(struct sim *sim, uint16_t reset_cause);

/* Virtual time since creation. */
uint64_t sim_now_us(const struct sim *sim);

/* Runs until virtual time `t_us` (no effect if that has passed): interrupts in order of time, main
 * loop every poll_us. About 0.5 us of real time per virtual tick of 500 us at rest, more when
 * stepping. */
void sim_advance_to(struct sim *sim, uint64_t t_us);
void sim_advance(struct sim *sim, uint64_t us);

/* --- serial line
 * ---------------------------------------------------------------------------------------------------
 */

/* Queues bytes on the controller's receive line, after those queued before; they arrive at the baud
 * rate while time advances. Returns how many fitted (4096 at most are queued). */
size_t sim_send(struct sim *sim, const uint8_t *bytes, size_t count);
/* A silence of `us` on the line after the bytes queued so far. */
void sim_send_gap(struct sim *sim, uint32_t us);

/* Takes bytes that the controller has sent until now. */
size_t sim_collect(struct sim *sim, uint8_t *out_bytes, size_t capacity);

/* One request and its reply: seals `pdu_count` bytes (unit, function, data) with a CRC, sends,
 * advances until a whole reply with good CRC has come or `timeout_us` has passed. Returns the
 * reply's length without CRC (unit first), 0 for silence. `out_reply` holds 256 bytes. Advances
 * time. */
size_t sim_transact(struct sim *sim, const uint8_t *request, size_t count, uint8_t *out_reply,
                    uint64_t timeout_us);

/* The usual requests in one call, unit 1. They return 0, or the Modbus exception code, or -1 for
 * silence. */
int sim_read(struct sim *sim, uint16_t start, unsigned count, uint16_t *out_words);
int sim_write(struct sim *sim, uint16_t start, unsigned count, const uint16_t *words);
int sim_write1(struct sim *sim, uint16_t address, uint16_t word);
int sim_write32(struct sim *sim, uint16_t address, uint32_t value);
int sim_coil(struct sim *sim, uint16_t coil, bool on);

/* --- inputs and faults
 * --------------------------------------------------------------------------------------------- */

/* Chains, as the crew would press and close them: bits of enum hal_input among ESTOP, INTERLOCK,
 * DOOR. */
void sim_chain(struct sim *sim, uint32_t input, bool closed);
void sim_temperature(struct sim *sim, double celsius);

/* X(NAME, name, what happens; value) */
#define SIM_FAULT_LIST(X)                                                                          \
    X(ESTOP, "estop", "emergency stop pressed (value 0 releases it)")                              \
    X(INTERLOCK, "interlock", "laser interlock opened (0 closes it)")                              \
    X(DOOR, "door", "cover opened (0 closes it)")                                                  \
    X(OVER_TEMP, "over_temp", "temperature becomes value, C")                                      \
    X(TEMP_SENSOR, "temp_sensor", "temperature sensor breaks (0 repairs it)")                      \
    X(MIRROR_BRAKE, "mirror_brake", "mirror speed multiplied by value at once, drive acts on")     \
    X(MIRROR_STALL, "mirror_stall", "mirror blocked, stands at once (0 frees it)")                 \
    X(MIRROR_SURGE, "mirror_surge", "drive gain multiplied by value (1 is normal)")                \
    X(INDEX_MISSING, "index_missing", "the next value index pulses do not come")                   \
    X(INDEX_EXTRA, "index_extra", "one spurious index pulse")                                      \
    X(ENCODER_SLIP, "encoder_slip", "encoder counter jumps by value counts")                       \
    X(ENCODER_DEAD, "encoder_dead", "encoder stops counting (0 revives it)")                       \
    X(PAN_STALL, "pan_stall", "pan blocked, all steps are lost (0 frees it)")                      \
    X(PAN_MISSED, "pan_missed", "the next value pan steps are lost")                               \
    X(TILT_STALL, "tilt_stall", "tilt blocked (0 frees it)")                                       \
    X(PAN_LIMIT, "pan_limit", "pan's positive limit switch closes (0 opens it)")                   \
    X(TILT_LIMIT, "tilt_limit", "tilt's positive limit switch closes (0 opens it)")                \
    X(HOME_DEAD, "home_dead", "home switches never close (0 repairs them)")                        \
    X(STACK, "stack", "free stack reads value bytes")                                              \
    X(CLOCK, "clock", "clock source fails (0 repairs it)")                                         \
    X(TICK_LATE, "tick_late", "safety tick does not come for value us")                            \
    X(LOOP_HANG, "loop_hang", "main loop does not run for value us")                               \
    X(ALARM_LATE, "alarm_late", "the next step interrupt comes value us late")                     \
    X(LASER_STUCK, "laser_stuck", "laser driver shorted: current flows always (0 repairs it)")     \
    X(LINE_NOISE, "line_noise", "value: probability that a received byte is changed, 0 to 1")      \
    X(LINE_CUT, "line_cut", "nothing arrives or leaves (0 mends it)")                              \
    X(FLASH_BAD, "flash_bad", "flash writes fail (0 repairs it)")                                  \
    X(FLASH_FLIP, "flash_flip", "bit number value of the stored record flips")                     \
    X(STROBE_MISSING, "strobe_missing", "the next value strobes do not come")                      \
    X(POWER, "power", "controller loses power and restarts")

enum sim_fault {
#define X(NAME, name, text) SIM_FAULT_##NAME,
    SIM_FAULT_LIST(X)
#undef X
        SIM_FAULT_COUNT
};

const char *sim_fault_name(enum sim_fault fault); /* "estop" */
const char *sim_fault_text(enum sim_fault fault);
/* SIM_FAULT_COUNT if there is none of that name. */
enum sim_fault sim_fault_find(const char *name);

/* Makes a fault happen at virtual time `t_us` (now, if that has passed). At most 64 wait; false if
 * full or `value` makes no sense. */
bool sim_fault_at(struct sim *sim, enum sim_fault fault, uint64_t t_us, double value);

/* --- truth
 * ---------------------------------------------------------------------------------------------------------
 */

/* The plant at one instant. */
struct sim_truth {
    uint64_t t_us;
    double mirror_rev;            /* turned since power-up, mirror_start_rev included */
    double mirror_rps;            /* speed */
    double head_steps[HAL_AXES];  /* where the head really points (behind backlash, stalls),
                                     mechanical zero */
    double motor_steps[HAL_AXES]; /* where the motor stands, mechanical zero */
    int64_t pulses[HAL_AXES];     /* net step pulses given since power-up */
    bool laser, motors;           /* outputs */
    uint32_t inputs;              /* enum hal_input */
    bool trigger;                 /* trigger line */
};
struct sim_truth sim_truth(const struct sim *sim);

/* Mirror's turn at `t_us`, within the last 500 us of virtual time: what a twin samples between
 * advances; exact. */
double sim_mirror_rev_at(const struct sim *sim, double t_us);

/* The step that is about to be given. A finely stepped motor is on its way to it from since_us to
 * due_us. During an observer's step() it is the one that is being given, `counted` not yet changed.
 */
struct sim_step {
    bool pending;            /* false: none, the axis stands */
    bool positive;           /* its direction, or the last one's */
    double since_us, due_us; /* virtual time */
    int32_t counted;         /* position as the controller counts */
};
struct sim_step sim_step(const struct sim *sim, enum hal_axis axis);

/* Where the mirror stands if it has turned `smooth_rev` smoothly: with the ripple. */
double sim_ripple(const struct sim_config *config, double smooth_rev);

/* Told of what happens, in order of time. Any member may be NULL. They must not call sim_ functions
 * other than sim_truth, sim_step and sim_now_us. Times in us of virtual time; `exact_us` is the
 * plant's time before quantisation. */
struct sim_observer {
    void (*step)(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive);
    void (*laser)(void *ctx, uint64_t t_us, bool on);
    void (*motors)(void *ctx, uint64_t t_us, bool on);
    void (*index)(void *ctx, double exact_us, uint64_t turn);
    /* an index pulse on the wires: without those that a fault takes away, with spurious ones */
    void (*pulse)(void *ctx, double exact_us);
    void (*trigger)(void *ctx, uint64_t t_us);
    void (*strobe)(void *ctx, double exact_us);
    /* every 500 us: from t0_us to t1_us the mirror turned as rev0 + rps0 t + acceleration / 2 t^2,
     * t in s (smoothly: the ripple is added by sim_ripple) */
    void (*mirror)(void *ctx, uint64_t t0_us, uint64_t t1_us, double rev0, double rps0,
                   double acceleration);
    void (*fault)(void *ctx, uint64_t t_us, enum sim_fault fault, double value);
};
/* The observer's struct must outlive its use; NULL ends it. */
void sim_observe(struct sim *sim, const struct sim_observer *observer, void *ctx);

/* The firmware's state, for white-box tests. */
const struct firmware *sim_firmware(const struct sim *sim);

#ifdef __cplusplus
}
#endif
#endif
