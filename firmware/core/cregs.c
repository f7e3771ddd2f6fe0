#include "firmware/core/cregs.h"
#include "firmware/core/ctlcmd.h"
#include "firmware/core/firmware.h"
#include "firmware/core/timebase.h"
#include "firmware/hal/hal_board.h"
#include "firmware/hal/hal_capture.h"
#include "firmware/hal/hal_time.h"
#include <stddef.h>

/* The map is read and written here; what the commands mean is in ctlcmd.c. */

/* --- reading --------------------------------------------------------------------------------- */

static void picture_identity(const struct firmware *fw, struct regmap_input *out) {
    const struct hal_board *board = hal_board();
    out->map_version = REGMAP_VERSION;
    out->fw_version = FIRMWARE_VERSION_MAJOR * 256 + FIRMWARE_VERSION_MINOR;
    out->fw_patch = FIRMWARE_VERSION_PATCH;
    out->board_id = board->board_id;
    out->serial = board->serial;
    out->build_id = board->build_id;
    out->reset_cause = board->reset_cause;
    out->commission_state = fw->commission_state;
    out->event_record_size = IDXEVENT_WORDS;
}

static void picture_safety(const struct firmware *fw, struct regmap_input *out) {
    const struct estop *estop = &fw->estop;
    out->state = (uint16_t)estop->state;
    out->fault_code = (uint16_t)estop->fault;
    out->fault_context = estop->context;
    out->fault_time_us = estop->fault_us;
    out->fault_count = estop->fault_count;
    out->conditions = estop->conditions;
    out->refusal = fw->refusal;
    out->refusal_address = fw->refusal_address;
    out->temperature = fw->temperature;
    out->safety_inputs = (uint16_t)fw->pins;
}

static void picture_motion(const struct firmware *fw, struct regmap_input *out) {
    const struct axis *pan = &fw->axis[HAL_PAN], *tilt = &fw->axis[HAL_TILT];
    out->pan_actual = pan->position;
    out->tilt_actual = tilt->position;
    out->pan_velocity = axis_velocity(pan);
    out->tilt_velocity = axis_velocity(tilt);
    out->pan_flags = axis_flags(pan);
    out->tilt_flags = axis_flags(tilt);
    out->pan_home_error = pan->home_error;
    out->tilt_home_error = tilt->home_error;
    out->step_slips = fw->step_slips;
    out->scan_state = (uint16_t)fw->scan.state;
    out->scan_overruns = fw->scan.overruns;
    out->scan_lines = fw->scan.lines;
}

/* Encoder, index counter, time and axes at one instant. */
static void picture_latch(struct firmware *fw, struct regmap_input *out) {
    struct hal_encoder encoder = hal_capture_encoder();
    out->latch_encoder = encunwrap_update(&fw->encoder, encoder.count);
    out->latch_time_us = timebase_extend(fw, encoder.now_us);
    out->latch_fraction = encunwrap_fraction(encoder.now_us - encoder.edge_us, fw->mirror.period_us,
                                             fw->mirror.params.encoder_counts);
    out->latch_phase = (uint16_t)(out->latch_encoder - fw->index.counts);
    out->latch_revolution = fw->revolution;
    out->latch_pan = fw->axis[HAL_PAN].position;
    out->latch_tilt = fw->axis[HAL_TILT].position;
    out->mirror_actual = fw->mirror.speed_mrps;
    out->mirror_drive = fw->mirror.drive;
    out->mirror_period_us = fw->mirror.period_us;
    out->index_missed = fw->index_missed;
    out->index_rejected = fw->index_rejected;
}

static void picture_camera(const struct firmware *fw, struct regmap_input *out) {
    const struct strobe *strobe = &fw->strobe;
    out->trigger_count = strobe->trigger_count;
    out->trigger_pan = strobe->trigger_pan;
    out->trigger_time_us = strobe->trigger_us;
    out->strobe_count = strobe->strobe_count;
    out->strobe_pan = strobe->strobe_pan;
    out->strobe_time_us = strobe->strobe_us;
}

static void picture_health(const struct firmware *fw, struct regmap_input *out) {
    out->frames_ok = fw->slave.frames_ok;
    out->frames_bad = fw->slave.frames_bad;
    out->exceptions = fw->slave.exceptions;
    out->rx_overruns = fw->link.ring.lost > UINT16_MAX ? UINT16_MAX : (uint16_t)fw->link.ring.lost;
    out->host_age_ms = fw->host_age_ms;
    out->tick_max_us = fw->tick_max_us;
    out->loop_max_us = fw->loop_max_us;
    out->stack_free = fw->stack_free;
}

void cregs_picture(struct firmware *fw, struct regmap_input *out_picture) {
    picture_identity(fw, out_picture);
    uint32_t saved = hal_irq_save();
    out_picture->uptime_us = timebase_now(fw);
    picture_safety(fw, out_picture);
    picture_motion(fw, out_picture);
    picture_latch(fw, out_picture);
    picture_camera(fw, out_picture);
    out_picture->event_next = fw->events.next;
    out_picture->event_overrun = fw->events.overrun;
    hal_irq_restore(saved);
    picture_health(fw, out_picture);
}

/* The event window: header fields of the picture and the records' words. */
static void read_window(struct firmware *fw, uint16_t start, unsigned count, uint16_t *out_words) {
    struct idxevent events[IDXEVENT_WINDOW];
    unsigned have = evring_read(&fw->events, events, IDXEVENT_WINDOW);
    fw->picture.event_count = (uint16_t)have;
    fw->picture.event_first = have ? events[0].seq : fw->events.from;
    /* An event that came between the picture and the records belongs to both. */
    if (have && fw->picture.event_next <= events[have - 1].seq)
        fw->picture.event_next = events[have - 1].seq + 1;
    uint16_t record[IDXEVENT_WORDS];
    unsigned filled = IDXEVENT_WINDOW; /* which record is in `record` */
    for (unsigned i = 0; i < count; i++) {
        unsigned at = start + i - IDXEVENT_FIRST_ADDR;
        if (start + i < IDXEVENT_FIRST_ADDR)
            continue;
        if (at / IDXEVENT_WORDS != filled) {
            filled = at / IDXEVENT_WORDS;
            idxevent_encode(&events[filled < have ? filled : 0], record);
        }
        out_words[i] = filled < have ? record[at % IDXEVENT_WORDS] : 0;
    }
}

/* A fault sets the mirror's target to 0 behind the register's back. */
static void refresh_holding(struct firmware *fw) {
    uint32_t saved = hal_irq_save();
    fw->holding.mirror_target = fw->mirror.target_mrps;
    hal_irq_restore(saved);
}

static enum mbexc model_read_words(void *ctx, bool holding, uint16_t start, unsigned count,
                                   uint16_t *out_words) {
    struct firmware *fw = ctx;
    if (start >= REGMAP_ADDR_fault_clear) {
        refresh_holding(fw);
        bool there = holding && regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &fw->holding,
                                              start, count, out_words);
        return there ? MBEXC_OK : MBEXC_ADDRESS;
    }
    uint32_t end = (uint32_t)start + count;
    unsigned in_table = count;
    cregs_picture(fw, &fw->picture);
    if (start >= IDXEVENT_WINDOW_ADDR) {
        if (end > IDXEVENT_WINDOW_ADDR + IDXEVENT_WINDOW_WORDS)
            return MBEXC_ADDRESS;
        read_window(fw, start, count, out_words);
        if (start >= IDXEVENT_FIRST_ADDR)
            in_table = 0;
        else if (end > IDXEVENT_FIRST_ADDR)
            in_table = IDXEVENT_FIRST_ADDR - start;
    }
    bool there =
        regmap_encode(regmap_inputs, REGMAP_INPUT_COUNT_, &fw->picture, start, in_table, out_words);
    return there ? MBEXC_OK : MBEXC_ADDRESS;
}

static enum mbexc copy_bits(uint32_t bits, unsigned total, uint16_t start, unsigned count,
                            uint8_t *out_bits) {
    if ((uint32_t)start + count > total)
        return MBEXC_ADDRESS;
    for (unsigned i = 0; i < count; i++)
        out_bits[i] = bits >> (start + i) & 1u;
    return MBEXC_OK;
}

static enum mbexc model_read_coils(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits) {
    struct firmware *fw = ctx;
    uint32_t saved = hal_irq_save();
    uint32_t bits = 0;
    bits |= (uint32_t)estop_motors_on(&fw->estop) << REGMAP_COIL_motor_enable;
    bits |= (uint32_t)estop_laser_on(&fw->estop) << REGMAP_COIL_laser_enable;
    bits |= (uint32_t)(fw->axis[HAL_PAN].homing != AXIS_HOMING_OFF) << REGMAP_COIL_home_pan;
    bits |= (uint32_t)(fw->axis[HAL_TILT].homing != AXIS_HOMING_OFF) << REGMAP_COIL_home_tilt;
    bits |= (uint32_t)scanprog_active(&fw->scan) << REGMAP_COIL_scan_run;
    bits |= (uint32_t)(fw->strobe.left != 0) << REGMAP_COIL_camera_auto;
    hal_irq_restore(saved);
    return copy_bits(bits, REGMAP_COIL_COUNT_, start, count, out_bits);
}

static enum mbexc model_read_discrete(void *ctx, uint16_t start, unsigned count,
                                      uint8_t *out_bits) {
    struct firmware *fw = ctx;
    uint32_t saved = hal_irq_save();
    const struct axis *pan = &fw->axis[HAL_PAN], *tilt = &fw->axis[HAL_TILT];
    bool alive = fw->estop.last.host_silence_ms <= fw->estop.last.host_timeout_ms;
    uint32_t bits = fw->pins & 0x3ffu; /* same order: hal_safety.h */
    bits |= (uint32_t)(fw->estop.state == CTLSTATE_FAULT) << REGMAP_DISCRETE_fault;
    bits |= (uint32_t)estop_motors_on(&fw->estop) << REGMAP_DISCRETE_motors_on;
    bits |= (uint32_t)estop_laser_on(&fw->estop) << REGMAP_DISCRETE_laser_on;
    bits |= (uint32_t)fw->mirror.in_range << REGMAP_DISCRETE_mirror_in_range;
    bits |= (uint32_t)alive << REGMAP_DISCRETE_host_alive;
    bits |= (uint32_t)pan->active << REGMAP_DISCRETE_pan_moving;
    bits |= (uint32_t)tilt->active << REGMAP_DISCRETE_tilt_moving;
    bits |= (uint32_t)pan->homed << REGMAP_DISCRETE_pan_homed;
    bits |= (uint32_t)tilt->homed << REGMAP_DISCRETE_tilt_homed;
    bits |= (uint32_t)scanprog_active(&fw->scan) << REGMAP_DISCRETE_scan_active;
    hal_irq_restore(saved);
    return copy_bits(bits, REGMAP_DISCRETE_COUNT_, start, count, out_bits);
}

/* --- writing --------------------------------------------------------------------------------- */

static enum mbexc refused(struct firmware *fw, enum refusal refusal, uint16_t address) {
    fw->refusal = (uint16_t)refusal;
    fw->refusal_address = address;
    return ctlcmd_exception(refusal);
}

/* The rows of a block: each must lie in it whole. Returns the first row's index and their number.
 */
static enum mbexc find_rows(uint16_t start, unsigned count, unsigned *out_first, unsigned *out_n) {
    const struct regmap_entry *entry = regmap_find(regmap_holdings, REGMAP_HOLDING_COUNT_, start);
    if (!entry || entry->address != start)
        return MBEXC_ADDRESS;
    unsigned first = (unsigned)(entry - regmap_holdings), n = 0, done = 0;
    while (done < count) {
        if (first + n >= REGMAP_HOLDING_COUNT_ || entry[n].address != start + done)
            return MBEXC_ADDRESS;
        done += regmap_type_words(entry[n].type);
        n++;
    }
    if (done != count)
        return MBEXC_ADDRESS;
    *out_first = first;
    *out_n = n;
    return MBEXC_OK;
}

static enum mbexc model_write_words(void *ctx, uint16_t start, unsigned count,
                                    const uint16_t *words) {
    struct firmware *fw = ctx;
    unsigned first, n;
    enum mbexc exc = find_rows(start, count, &first, &n);
    if (exc)
        return exc;
    refresh_holding(fw);
    struct regmap_holding wanted = fw->holding;
    (void)regmap_decode(regmap_holdings + first, n, &wanted, start, count, words);
    for (unsigned row = first; row < first + n; row++) {
        const struct regmap_entry *entry = &regmap_holdings[row];
        int64_t value = regmap_value(entry, &wanted);
        if (value < entry->min || value > entry->max)
            return refused(fw, REFUSAL_RANGE, entry->address);
    }
    for (unsigned row = first; row < first + n; row++) {
        enum refusal refusal = ctlcmd_check_register(fw, row, &wanted);
        if (refusal)
            return refused(fw, refusal, regmap_holdings[row].address);
    }
    enum refusal refusal = ctlcmd_apply_registers(fw, first, n, &wanted);
    return refused(fw, refusal, start);
}

static enum mbexc model_write_coils(void *ctx, uint16_t start, unsigned count,
                                    const uint8_t *bits) {
    struct firmware *fw = ctx;
    if ((uint32_t)start + count > REGMAP_COIL_COUNT_)
        return MBEXC_ADDRESS;
    for (unsigned i = 0; i < count; i++) {
        enum refusal refusal = ctlcmd_check_coil(fw, start + i, bits[i] != 0);
        if (refusal)
            return refused(fw, refusal, (uint16_t)(start + i));
    }
    for (unsigned i = 0; i < count; i++)
        ctlcmd_apply_coil(fw, start + i, bits[i] != 0);
    return refused(fw, REFUSAL_NONE, start);
}

/* --- the rest of the model ------------------------------------------------------------------- */

static void model_heard(void *ctx) {
    struct firmware *fw = ctx;
    uint32_t saved = hal_irq_save();
    uint64_t now_us = timebase_now(fw), age_ms = (now_us - fw->heard_us) / 1000;
    fw->heard_us = now_us;
    hal_irq_restore(saved);
    fw->host_age_ms = age_ms > UINT16_MAX ? UINT16_MAX : (uint16_t)age_ms;
}

static const char *model_identity(void *ctx, uint8_t id) {
    (void)ctx;
    switch (id) {
    case 0:
        return "scancart";
    case 1:
        return "cart controller";
    case 2:
        return FIRMWARE_VERSION_TEXT;
    case 4:
        return "scancart controller";
    case 5:
        return hal_board()->name;
    case 6:
        return "pan-tilt, mirror, laser safety";
    default:
        return NULL;
    }
}

const struct mbslave_model cregs_model = {
    .read_coils = model_read_coils,
    .read_discrete = model_read_discrete,
    .read_words = model_read_words,
    .write_coils = model_write_coils,
    .write_words = model_write_words,
    .heard = model_heard,
    .identity = model_identity,
};

void cregs_init(struct firmware *fw) {
    fw->holding = regmap_holding_initial;
    fw->commission_state = (uint8_t)commission_load(&fw->holding);
    ctlcmd_use_settings(fw);
}
