/* Named faults of the simulated cart. */
#include "firmware/port/sim/simstate.h"
#include "firmware/shared/faultcode.h"
#include <math.h>
#include <string.h>

static const struct {
    const char *name, *text;
} names[SIM_FAULT_COUNT] = {
#define X(NAME, name, text) {name, text},
    SIM_FAULT_LIST(X)
#undef X
};

const char *sim_fault_name(enum sim_fault fault) {
    return (unsigned)fault < SIM_FAULT_COUNT ? names[fault].name : "unknown";
}

const char *sim_fault_text(enum sim_fault fault) {
    return (unsigned)fault < SIM_FAULT_COUNT ? names[fault].text : "unknown";
}

enum sim_fault sim_fault_find(const char *name) {
    int i = 0;
    while (i < SIM_FAULT_COUNT && strcmp(names[i].name, name) != 0)
        i++;
    return (enum sim_fault)i;
}

static void pins_changed(struct sim *sim, uint32_t before) {
    if (sim->config.pin_interrupts && simplant_inputs(sim) != before)
        firmware_isr_pins();
}

void sim_chain(struct sim *sim, uint32_t input, bool closed) {
    uint32_t chains = HAL_IN_ESTOP_CLOSED | HAL_IN_INTERLOCK_CLOSED | HAL_IN_DOOR_CLOSED;
    uint32_t before = simplant_inputs(sim);
    simstate_current = sim;
    if (closed)
        sim->chains |= input & chains;
    else
        sim->chains &= ~(input & chains);
    pins_changed(sim, before);
}

void sim_temperature(struct sim *sim, double celsius) {
    sim->temperature_c = fmin(fmax(celsius, -200), 1000);
}

static void force(struct sim *sim, uint32_t input, bool closed) {
    uint32_t before = simplant_inputs(sim);
    sim->forced = closed ? sim->forced | input : sim->forced & ~input;
    pins_changed(sim, before);
}

/* Mirror: changes that begin a new segment. */
static void mirror_fault(struct sim *sim, enum sim_fault fault, double value) {
    if (fault == SIM_FAULT_MIRROR_STALL)
        sim->mirror_blocked = value != 0;
    else if (fault == SIM_FAULT_MIRROR_SURGE)
        sim->mirror_gain = value;
    simplant_cut(sim);
    if (fault == SIM_FAULT_MIRROR_BRAKE) {
        sim->mirror.rps0 *= value;
        simplant_cut(sim);
    }
}

static void encoder_fault(struct sim *sim, enum sim_fault fault, double value) {
    uint16_t count = simplant_encoder(sim, (double)sim->now_us);
    if (fault == SIM_FAULT_ENCODER_SLIP) {
        sim->encoder_slip += (int32_t)value;
    } else if (value != 0) {
        sim->encoder_frozen = count;
        sim->encoder_dead = true;
    } else if (sim->encoder_dead) {
        sim->encoder_dead = false;
        sim->encoder_slip +=
            (int16_t)(uint16_t)(count - simplant_encoder(sim, (double)sim->now_us));
    }
}

static void clock_fault(struct sim *sim, bool bad) {
    sim->clock_bad = bad;
    if (bad && sim->config.pin_interrupts)
        firmware_isr_clock_failure();
}

static void controller_fault(struct sim *sim, enum sim_fault fault, double value) {
    uint64_t us = (uint64_t)value;
    if (fault == SIM_FAULT_STACK)
        sim->stack_free = (uint16_t)value;
    else if (fault == SIM_FAULT_CLOCK)
        clock_fault(sim, value != 0);
    else if (fault == SIM_FAULT_TICK_LATE)
        sim->next_tick += us;
    else if (fault == SIM_FAULT_LOOP_HANG)
        sim->next_poll += us;
    else if (fault == SIM_FAULT_ALARM_LATE && sim->alarm_us != SIMSTATE_NEVER)
        sim->alarm_us += us;
    else if (fault == SIM_FAULT_ALARM_LATE)
        sim->alarm_slip_us = us;
    else if (fault == SIM_FAULT_FLASH_BAD)
        sim->flash_bad = value != 0;
    else if (fault == SIM_FAULT_FLASH_FLIP)
        sim->flash[us / 8] ^= (uint8_t)(1u << us % 8);
    else
        sim_reset(sim, RESETCAUSE_POWER);
}

static void chain_fault(struct sim *sim, enum sim_fault fault, bool on) {
    uint32_t input = fault == SIM_FAULT_ESTOP       ? HAL_IN_ESTOP_CLOSED
                     : fault == SIM_FAULT_INTERLOCK ? HAL_IN_INTERLOCK_CLOSED
                                                    : HAL_IN_DOOR_CLOSED;
    sim_chain(sim, input, !on);
}

static void index_fault(struct sim *sim, enum sim_fault fault, double value) {
    if (fault == SIM_FAULT_INDEX_MISSING) {
        sim->index_skip = (uint32_t)value;
    } else {
        sim->index_extra = true;
        sim->index_us = (double)sim->now_us;
    }
}

static void axis_fault(struct sim *sim, enum sim_fault fault, double value) {
    bool on = value != 0;
    if (fault == SIM_FAULT_PAN_STALL)
        sim->axis[HAL_PAN].blocked = on;
    else if (fault == SIM_FAULT_TILT_STALL)
        sim->axis[HAL_TILT].blocked = on;
    else if (fault == SIM_FAULT_PAN_MISSED)
        sim->axis[HAL_PAN].lose = (uint32_t)value;
    else if (fault == SIM_FAULT_PAN_LIMIT)
        force(sim, HAL_IN_PAN_LIMIT_MAX, on);
    else if (fault == SIM_FAULT_TILT_LIMIT)
        force(sim, HAL_IN_TILT_LIMIT_MAX, on);
    else
        sim->home_dead = on;
}

static void device_fault(struct sim *sim, enum sim_fault fault, double value) {
    bool on = value != 0;
    if (fault == SIM_FAULT_OVER_TEMP)
        sim_temperature(sim, value);
    else if (fault == SIM_FAULT_TEMP_SENSOR)
        sim->temp_broken = on;
    else if (fault == SIM_FAULT_LASER_STUCK)
        sim->laser_stuck = on;
    else if (fault == SIM_FAULT_LINE_NOISE)
        sim->line_noise = value;
    else if (fault == SIM_FAULT_LINE_CUT)
        sim->line_cut = on;
    else
        sim->strobe_skip = (uint32_t)value;
}

static void apply(struct sim *sim, enum sim_fault fault, double value) {
    switch (fault) {
    case SIM_FAULT_ESTOP:
    case SIM_FAULT_INTERLOCK:
    case SIM_FAULT_DOOR:
        chain_fault(sim, fault, value != 0);
        break;
    case SIM_FAULT_MIRROR_BRAKE:
    case SIM_FAULT_MIRROR_STALL:
    case SIM_FAULT_MIRROR_SURGE:
        mirror_fault(sim, fault, value);
        break;
    case SIM_FAULT_INDEX_MISSING:
    case SIM_FAULT_INDEX_EXTRA:
        index_fault(sim, fault, value);
        break;
    case SIM_FAULT_ENCODER_SLIP:
    case SIM_FAULT_ENCODER_DEAD:
        encoder_fault(sim, fault, value);
        break;
    case SIM_FAULT_PAN_STALL:
    case SIM_FAULT_PAN_MISSED:
    case SIM_FAULT_TILT_STALL:
    case SIM_FAULT_PAN_LIMIT:
    case SIM_FAULT_TILT_LIMIT:
    case SIM_FAULT_HOME_DEAD:
        axis_fault(sim, fault, value);
        break;
    case SIM_FAULT_OVER_TEMP:
    case SIM_FAULT_TEMP_SENSOR:
    case SIM_FAULT_LASER_STUCK:
    case SIM_FAULT_LINE_NOISE:
    case SIM_FAULT_LINE_CUT:
    case SIM_FAULT_STROBE_MISSING:
        device_fault(sim, fault, value);
        break;
    case SIM_FAULT_STACK:
    case SIM_FAULT_CLOCK:
    case SIM_FAULT_TICK_LATE:
    case SIM_FAULT_LOOP_HANG:
    case SIM_FAULT_ALARM_LATE:
    case SIM_FAULT_FLASH_BAD:
    case SIM_FAULT_FLASH_FLIP:
    case SIM_FAULT_POWER:
        controller_fault(sim, fault, value);
        break;
    case SIM_FAULT_COUNT:
        break;
    }
}

static bool value_fits(enum sim_fault fault, double value) {
    if (!isfinite(value))
        return false;
    if (fault == SIM_FAULT_OVER_TEMP)
        return fabs(value) <= 1000;
    if (fault == SIM_FAULT_ENCODER_SLIP)
        return fabs(value) <= 32767;
    if (fault == SIM_FAULT_FLASH_FLIP)
        return value >= 0 && value < 8.0 * HAL_FLASH_SIZE;
    if (fault == SIM_FAULT_LINE_NOISE || fault == SIM_FAULT_MIRROR_BRAKE)
        return value >= 0 && value <= 1;
    if (fault == SIM_FAULT_MIRROR_SURGE)
        return value >= 0 && value <= 10;
    return value >= 0 && value <= (fault == SIM_FAULT_STACK ? 65535.0 : 1e9);
}

bool sim_fault_at(struct sim *sim, enum sim_fault fault, uint64_t t_us, double value) {
    if ((unsigned)fault >= SIM_FAULT_COUNT || !value_fits(fault, value))
        return false;
    for (unsigned i = 0; i < SIMSTATE_FAULTS; i++) {
        struct simfault_entry *entry = &sim->faults[i];
        if (entry->waiting)
            continue;
        *entry = (struct simfault_entry){t_us, sim->fault_order++, fault, value, true};
        if (t_us < sim->fault_next_us)
            sim->fault_next_us = t_us;
        return true;
    }
    return false;
}

static const struct simfault_entry *earliest(const struct sim *sim) {
    const struct simfault_entry *first = NULL;
    for (unsigned i = 0; i < SIMSTATE_FAULTS; i++) {
        const struct simfault_entry *entry = &sim->faults[i];
        if (entry->waiting && (!first || entry->t_us < first->t_us ||
                               (entry->t_us == first->t_us && entry->order < first->order)))
            first = entry;
    }
    return first;
}

void simfault_run(struct sim *sim) {
    const struct simfault_entry *entry = earliest(sim);
    enum sim_fault fault = entry->fault;
    double value = entry->value;
    sim->faults[entry - sim->faults].waiting = false;
    const struct simfault_entry *next = earliest(sim);
    sim->fault_next_us = next ? next->t_us : SIMSTATE_NEVER;
    if (sim->observer && sim->observer->fault)
        sim->observer->fault(sim->observer_ctx, sim->now_us, fault, value);
    apply(sim, fault, value);
}
