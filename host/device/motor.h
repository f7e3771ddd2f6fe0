/* The cart's controller as the host sees it: pan, tilt, mirror, laser, camera trigger, index
 * events. Backends: motor_modbus (the real controller and the emulated one), motor_sim (the
 * firmware on its simulated port).
 *
 * Threads: a struct motor belongs to one thread at a time; no op is for the real-time path. Each op
 * blocks at most `motor->block_ms` (time-outs and repetitions included) unless its comment says
 * otherwise. All fill `err` on failure. Statuses: ST_TIMEOUT no answer; ST_DEVICE the controller
 * refused (the text says why); ST_INVALID a value is out of its range; ST_IO the line broke;
 * ST_DAMAGED the answers make no sense.
 *
 * A command that failed with ST_TIMEOUT may or may not have been carried out: ask for the status.
 */
#ifndef SC_DEVICE_MOTOR_H
#define SC_DEVICE_MOTOR_H

#include "base/index_event.h"
#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum motor_axis { MOTOR_PAN, MOTOR_TILT, MOTOR_AXES };

struct motor_identity {
    unsigned map_version, fw_major, fw_minor, fw_patch;
    unsigned board_id; /* 1 cart_f405, 2 qemu_mps2, 3 sim */
    uint32_t serial, build_id;
    unsigned reset_cause;      /* enum resetcause */
    unsigned commission_state; /* 0 defaults, 1 stored, 2 damaged, 3 changed and not saved */
    int64_t uptime_ns;
};

struct motor_axis_status {
    int32_t steps;
    double velocity; /* steps/s */
    bool moving, homed, homing, limit_min, limit_max, home_switch;
    int32_t home_error_steps; /* found at the last homing: steps lost since the one before */
};

struct motor_status {
    int64_t t_ns;   /* host time at which the answer had come */
    unsigned state; /* enum ctlstate: 0 idle, 1 ready, 2 laser on, 3 fault */
    unsigned fault; /* enum faultcode, 0 none */
    int32_t fault_context;
    int64_t fault_t_ns;   /* controller time */
    unsigned fault_count; /* since reset */
    uint32_t conditions;  /* bit n: the cause of fault n is present now */
    uint16_t
        inputs; /* bits: chains closed (0 e-stop, 1 interlock, 2 door), switches, laser current */
    double temperature_c;
    struct motor_axis_status axis[MOTOR_AXES];
    double mirror_rps;
    bool mirror_in_range, motors_on, laser_on, host_alive;
    uint32_t index_missed, index_rejected; /* since reset, modulo 65536 */
    unsigned scan_state;                   /* enum scanstate */
    uint32_t scan_lines, scan_overruns;
    uint32_t triggers, strobes;
    uint32_t frames_ok, frames_bad, rx_overruns;
    unsigned tick_max_us, loop_max_us, stack_free;
};

struct motor_scan {
    int32_t from_steps, to_steps;
    double rate;             /* steps/s of a continuous sweep; ignored in step mode */
    uint16_t steps_per_turn; /* 0: continuous; else steps at each mirror revolution */
};

struct motor_camera {
    int32_t first_steps, interval_steps; /* pan positions of the triggers */
    uint16_t number;
    uint16_t pulse_us;
};

struct motor;

struct motor_ops {
    /* Required. Who is there; fails with ST_UNSUPPORTED if it is no controller that this program
     * knows. */
    enum st (*identify)(struct motor *motor, struct motor_identity *out_identity,
                        struct errctx *err);
    /* Required. */
    enum st (*status)(struct motor *motor, struct motor_status *out_status, struct errctx *err);
    /* Required. Drive power of pan, tilt and mirror; off also turns the laser off and stops all. */
    enum st (*enable)(struct motor *motor, bool on, struct errctx *err);
    /* Required. Starts homing of an axis; status tells when it is homed. */
    enum st (*home)(struct motor *motor, enum motor_axis axis, struct errctx *err);
    /* Required. Starts a move to an absolute position; status tells when it has arrived. */
    enum st (*move)(struct motor *motor, enum motor_axis axis, int32_t steps, struct errctx *err);
    /* Required. Ramps both axes down, ends homing and scan. */
    enum st (*stop)(struct motor *motor, struct errctx *err);
    /* Required. Speed of the mirror, rev/s; 0 lets it coast. */
    enum st (*mirror)(struct motor *motor, double speed_rps, struct errctx *err);
    /* Required. */
    enum st (*laser)(struct motor *motor, bool on, struct errctx *err);
    /* Required. Sets the scan program without starting it. */
    enum st (*scan_program)(struct motor *motor, const struct motor_scan *scan, struct errctx *err);
    /* Required. Starts the program, or ends it. */
    enum st (*scan_run)(struct motor *motor, bool on, struct errctx *err);
    /* Required. Sets and arms triggers at pan positions; number 0 disarms. */
    enum st (*camera_program)(struct motor *motor, const struct motor_camera *camera,
                              struct errctx *err);
    /* Required. One trigger now. Never repeated by itself: after ST_TIMEOUT there may have been
     * one. */
    enum st (*trigger)(struct motor *motor, struct errctx *err);
    /* Required. Events from sequence number `from` on, up to `capacity` (at most 8 come at once).
     * *out_lost: events before the first one given that the controller no longer has; never
     * silently left out. `from` beyond what exists gives none. ST_DAMAGED if the controller has
     * restarted since `from` (its count is lower): identify, begin again at 0. */
    enum st (*read_events)(struct motor *motor, uint64_t from, struct index_event *out_events,
                           size_t capacity, size_t *out_count, uint64_t *out_lost,
                           struct errctx *err);
    /* Required. Longest silence of the host that the controller bears with motors on, 50 to 5000
     * ms. */
    enum st (*host_timeout)(struct motor *motor, unsigned timeout_ms, struct errctx *err);
    /* Required. Tells the controller that the host is alive; any other op does so too. */
    enum st (*kick)(struct motor *motor, struct errctx *err);
    /* Required. Clears the latched fault `fault`; refused while its cause is present. */
    enum st (*clear_fault)(struct motor *motor, unsigned fault, struct errctx *err);
    /* Required. Stores the commissioning values in the controller's flash. Blocks up to 3 s. */
    enum st (*save)(struct motor *motor, struct errctx *err);
    /* Required. Releases everything; leaves the controller as it is. */
    void (*close)(struct motor *motor);
};

struct motor {
    const struct motor_ops *ops;
    unsigned block_ms; /* bound of one op */
};

/* Calls close; takes NULL. */
static inline void motor_close(struct motor *motor) {
    if (motor)
        motor->ops->close(motor);
}

#ifdef __cplusplus
}
#endif
#endif
