#include "firmware/core/ctlcmd.h"
#include "firmware/core/firmware.h"
#include "firmware/core/stepsched.h"
#include "firmware/core/timebase.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_time.h"

enum mbexc ctlcmd_exception(enum refusal refusal) {
    switch (refusal) {
    case REFUSAL_NONE:
        return MBEXC_OK;
    case REFUSAL_BUSY:
    case REFUSAL_ENERGISED:
        return MBEXC_BUSY;
    case REFUSAL_RANGE:
    case REFUSAL_WRONG_FAULT:
        return MBEXC_VALUE;
    case REFUSAL_FAULTED:
    case REFUSAL_MOTORS_OFF:
    case REFUSAL_NOT_HOMED:
    case REFUSAL_MIRROR:
    case REFUSAL_HOST:
    case REFUSAL_LIMIT:
    case REFUSAL_CONDITION:
    case REFUSAL_FLASH:
    case REFUSAL_UNCOMMISSIONED:
    case REFUSAL_COUNT_:
        break;
    }
    return MBEXC_DEVICE;
}

/* --- checks ---------------------------------------------------------------------------------- */

/* What every command needs that moves something. */
static enum refusal check_motion(const struct firmware *fw) {
    if (fw->estop.state == CTLSTATE_FAULT)
        return REFUSAL_FAULTED;
    return estop_motors_on(&fw->estop) ? REFUSAL_NONE : REFUSAL_MOTORS_OFF;
}

static enum refusal check_target(const struct firmware *fw, enum hal_axis id, int32_t target) {
    const struct axis *axis = &fw->axis[id];
    enum refusal refusal = check_motion(fw);
    if (refusal)
        return refusal;
    if (axis->homing || (id == HAL_PAN && scanprog_active(&fw->scan)))
        return REFUSAL_BUSY;
    uint8_t closed = target > axis->position   ? AXIS_AT_LIMIT_MAX
                     : target < axis->position ? AXIS_AT_LIMIT_MIN
                                               : 0;
    return axis->switches & closed ? REFUSAL_LIMIT : REFUSAL_NONE;
}

static enum refusal check_mirror(const struct firmware *fw, uint16_t target_mrps) {
    if (!target_mrps)
        return REFUSAL_NONE;
    return check_motion(fw);
}

static bool within(int32_t value, int32_t low, int32_t high) {
    return value >= low && value <= high;
}

/* Values that are within their own range but do not fit the others. */
static enum refusal check_fit(unsigned row, const struct regmap_holding *wanted) {
    bool fits = true;
    if (row == REGMAP_HOLDING_pan_target)
        fits = within(wanted->pan_target, wanted->pan_min, wanted->pan_max);
    else if (row == REGMAP_HOLDING_tilt_target)
        fits = within(wanted->tilt_target, wanted->tilt_min, wanted->tilt_max);
    else if (row == REGMAP_HOLDING_mirror_target)
        fits = wanted->mirror_target <= wanted->mirror_max;
    else if (row == REGMAP_HOLDING_mirror_safe || row == REGMAP_HOLDING_mirror_max)
        fits = wanted->mirror_safe < wanted->mirror_max;
    return fits ? REFUSAL_NONE : REFUSAL_RANGE;
}

static enum refusal check_locked(const struct firmware *fw, unsigned row,
                                 const struct regmap_holding *wanted) {
    switch (row) {
    case REGMAP_HOLDING_fault_clear:
        return estop_clear_check(&fw->estop, wanted->fault_clear);
    case REGMAP_HOLDING_pan_target:
        return check_target(fw, HAL_PAN, wanted->pan_target);
    case REGMAP_HOLDING_tilt_target:
        return check_target(fw, HAL_TILT, wanted->tilt_target);
    case REGMAP_HOLDING_mirror_target:
        return check_mirror(fw, wanted->mirror_target);
    default:
        break;
    }
    if (regmap_holdings[row].access == REGMAP_COM && estop_motors_on(&fw->estop))
        return REFUSAL_ENERGISED;
    return REFUSAL_NONE;
}

enum refusal ctlcmd_check_register(struct firmware *fw, unsigned row,
                                   const struct regmap_holding *wanted) {
    enum refusal refusal = check_fit(row, wanted);
    if (refusal)
        return refusal;
    uint32_t saved = hal_irq_save();
    refusal = check_locked(fw, row, wanted);
    hal_irq_restore(saved);
    return refusal;
}

static enum refusal check_home(const struct firmware *fw, enum hal_axis id) {
    const struct axis *axis = &fw->axis[id];
    enum refusal refusal = check_motion(fw);
    if (!refusal && (axis->active || axis->homing || scanprog_active(&fw->scan)))
        refusal = REFUSAL_BUSY;
    return refusal;
}

static enum refusal check_scan(const struct firmware *fw) {
    const struct axis *pan = &fw->axis[HAL_PAN];
    const struct regmap_holding *h = &fw->holding;
    enum refusal refusal = check_motion(fw);
    if (refusal)
        return refusal;
    if (pan->active || pan->homing || scanprog_active(&fw->scan))
        return REFUSAL_BUSY;
    if (!pan->homed)
        return REFUSAL_NOT_HOMED;
    if (!within(h->scan_from, h->pan_min, h->pan_max) ||
        !within(h->scan_to, h->pan_min, h->pan_max))
        return REFUSAL_RANGE;
    return h->scan_mode == 1 && !fw->mirror.in_range ? REFUSAL_MIRROR : REFUSAL_NONE;
}

static enum refusal check_coil_locked(const struct firmware *fw, unsigned coil) {
    switch (coil) {
    case REGMAP_COIL_motor_enable:
        return estop_motors_check(&fw->estop);
    case REGMAP_COIL_laser_enable:
        return estop_laser_check(&fw->estop);
    case REGMAP_COIL_home_pan:
        return check_home(fw, HAL_PAN);
    case REGMAP_COIL_home_tilt:
        return check_home(fw, HAL_TILT);
    case REGMAP_COIL_scan_run:
        return check_scan(fw);
    case REGMAP_COIL_camera_trigger:
    case REGMAP_COIL_camera_auto:
        return fw->estop.state == CTLSTATE_FAULT ? REFUSAL_FAULTED : REFUSAL_NONE;
    default: /* stop */
        return REFUSAL_NONE;
    }
}

enum refusal ctlcmd_check_coil(struct firmware *fw, unsigned coil, bool on) {
    if (!on) /* switching off is never refused */
        return REFUSAL_NONE;
    uint32_t saved = hal_irq_save();
    enum refusal refusal = check_coil_locked(fw, coil);
    hal_irq_restore(saved);
    return refusal;
}

/* --- registers ------------------------------------------------------------------------------- */

static struct axis_limits limits_of(const struct regmap_holding *h, enum hal_axis id) {
    struct axis_limits limits = {.home_fast = h->home_fast,
                                 .home_slow = h->home_slow,
                                 .invert = (h->axis_invert >> id & 1u) != 0};
    if (id == HAL_PAN) {
        limits.velocity_max = h->pan_velocity_max;
        limits.acceleration = h->pan_acceleration;
        limits.min_steps = h->pan_min;
        limits.max_steps = h->pan_max;
        limits.backlash_steps = h->pan_backlash;
        limits.home_position = h->pan_home_position;
    } else {
        limits.velocity_max = h->tilt_velocity_max;
        limits.acceleration = h->tilt_acceleration;
        limits.min_steps = h->tilt_min;
        limits.max_steps = h->tilt_max;
        limits.backlash_steps = h->tilt_backlash;
        limits.home_position = h->tilt_home_position;
    }
    return limits;
}

static struct mirrorctl_params mirror_params(const struct regmap_holding *h) {
    return (struct mirrorctl_params){.safe_mrps = h->mirror_safe,
                                     .max_mrps = h->mirror_max,
                                     .feed = h->mirror_feed,
                                     .gain = h->mirror_gain,
                                     .integral = h->mirror_integral,
                                     .spinup_ms = h->mirror_spinup_ms,
                                     .encoder_counts = h->encoder_counts,
                                     .has_encoder = (hal_board()->caps & HAL_CAP_ENCODER) != 0};
}

void ctlcmd_use_settings(struct firmware *fw) {
    uint32_t saved = hal_irq_save();
    for (unsigned i = 0; i < HAL_AXES; i++)
        fw->axis[i].limits = limits_of(&fw->holding, (enum hal_axis)i);
    fw->mirror.params = mirror_params(&fw->holding);
    fw->strobe.pulse_us = fw->holding.camera_pulse_us;
    fw->host_timeout_ms = fw->holding.host_timeout_ms;
    fw->temperature_max = fw->holding.temperature_max;
    fw->commissioned = fw->commission_state == COMMISSION_VALID;
    hal_irq_restore(saved);
}

/* Blocks up to 1 s: nothing moves and the laser is off, and the safety tick may be late without a
 * fault. */
static enum refusal save(struct firmware *fw) {
    fw->flash_busy = true;
    bool done = commission_save(&fw->holding);
    uint32_t saved = hal_irq_save();
    fw->loop_us = timebase_now(fw);
    fw->ticked = false;
    fw->flash_busy = false;
    hal_irq_restore(saved);
    fw->commission_state = done ? COMMISSION_VALID : COMMISSION_CHANGED;
    return done ? REFUSAL_NONE : REFUSAL_FLASH;
}

/* The commands among the rows, after all values have been stored. Under the interrupt lock. */
static void command(struct firmware *fw, unsigned row) {
    const struct regmap_holding *h = &fw->holding;
    uint64_t now_us = timebase_now(fw);
    switch (row) {
    case REGMAP_HOLDING_fault_clear:
        (void)estop_clear(&fw->estop, h->fault_clear); /* checked before */
        break;
    case REGMAP_HOLDING_mirror_target:
        hal_axis_mirror_drive(mirrorctl_target(&fw->mirror, h->mirror_target, now_us));
        break;
    case REGMAP_HOLDING_event_from:
        evring_seek(&fw->events, h->event_from);
        break;
    case REGMAP_HOLDING_pan_target:
        axis_move(&fw->axis[HAL_PAN], h->pan_target, 0, now_us);
        break;
    case REGMAP_HOLDING_tilt_target:
        axis_move(&fw->axis[HAL_TILT], h->tilt_target, 0, now_us);
        break;
    default:
        break;
    }
}

enum refusal ctlcmd_apply_registers(struct firmware *fw, unsigned first, unsigned n,
                                    const struct regmap_holding *wanted) {
    fw->holding = *wanted;
    bool saves = false;
    for (unsigned row = first; row < first + n; row++) {
        saves = saves || row == REGMAP_HOLDING_commission_save;
        if (regmap_holdings[row].access == REGMAP_COM)
            fw->commission_state = COMMISSION_CHANGED;
    }
    enum refusal refusal = saves ? save(fw) : REFUSAL_NONE;
    ctlcmd_use_settings(fw);
    uint32_t saved = hal_irq_save();
    for (unsigned row = first; row < first + n; row++)
        command(fw, row);
    stepsched_arm(fw);
    hal_irq_restore(saved);
    fw->holding.fault_clear = 0;
    fw->holding.commission_save = 0;
    return refusal;
}

/* --- coils ----------------------------------------------------------------------------------- */

static void stop_axes(struct firmware *fw) {
    scanprog_end(&fw->scan);
    for (unsigned i = 0; i < HAL_AXES; i++)
        axis_stop(&fw->axis[i]);
}

static void end_homing(struct axis *axis) {
    if (axis->homing)
        axis_stop(axis);
}

static void run_scan(struct firmware *fw, bool on, uint64_t now_us) {
    const struct regmap_holding *h = &fw->holding;
    struct scanprog *scan = &fw->scan;
    if (on) {
        scan->from = h->scan_from;
        scan->to = h->scan_to;
        scan->rate = h->scan_rate;
        scan->stepwise = h->scan_mode == 1;
        scan->steps = h->scan_steps;
        scanprog_start(scan, &fw->axis[HAL_PAN], now_us);
    } else {
        if (scanprog_active(scan))
            axis_stop(&fw->axis[HAL_PAN]);
        scanprog_end(scan);
    }
}

static void switch_coil(struct firmware *fw, unsigned coil, bool on, uint64_t now_us) {
    const struct regmap_holding *h = &fw->holding;
    switch (coil) {
    case REGMAP_COIL_motor_enable:
        (void)estop_motors(&fw->estop, on); /* checked before */
        if (!on)
            firmware_halt(fw);
        break;
    case REGMAP_COIL_laser_enable:
        (void)estop_laser(&fw->estop, on);
        break;
    case REGMAP_COIL_home_pan:
    case REGMAP_COIL_home_tilt: {
        struct axis *axis = &fw->axis[coil == REGMAP_COIL_home_pan ? HAL_PAN : HAL_TILT];
        if (on)
            axis_home(axis, now_us);
        else
            end_homing(axis);
        break;
    }
    case REGMAP_COIL_stop:
        if (on)
            stop_axes(fw);
        break;
    case REGMAP_COIL_scan_run:
        run_scan(fw, on, now_us);
        break;
    case REGMAP_COIL_camera_trigger:
        if (on)
            strobe_trigger(&fw->strobe, fw->axis[HAL_PAN].position, now_us);
        break;
    default: /* camera_auto */
        if (on)
            strobe_arm(&fw->strobe, h->camera_first, h->camera_interval, h->camera_number);
        else
            strobe_disarm(&fw->strobe);
        break;
    }
}

void ctlcmd_apply_coil(struct firmware *fw, unsigned coil, bool on) {
    uint32_t saved = hal_irq_save();
    switch_coil(fw, coil, on, timebase_now(fw));
    stepsched_arm(fw);
    hal_irq_restore(saved);
}
