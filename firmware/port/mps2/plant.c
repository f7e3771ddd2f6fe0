#include "firmware/port/mps2/plant.h"

enum {
    TURN_BITS = 40,
    ENCODER_BITS = 12,        /* 4096 counts */
    FULL_DRIVE_RPS = 20,      /* speed at full drive */
    SPINUP_TAU_US = 400000,   /* time constant of mirror and motor */
    CAMERA_DELAY_US = 2300,   /* trigger to strobe */
    TRAVEL_LIMIT = 14300,     /* pan's limit switches close outside */
    TILT_TRAVEL_LIMIT = 3800, /* tilt's */
    PAN_HOME_EDGE = -13800,   /* home switches are closed below */
    TILT_HOME_EDGE = -3300,   /* */
    PAN_START = -13100,       /* where the axes stand at power-up */
    TILT_START = -2900,
    ROOM_TEMPERATURE = 250, /* 0.1 C */
    HOT_TEMPERATURE = 800
};

static const uint32_t chains = HAL_IN_ESTOP_CLOSED | HAL_IN_INTERLOCK_CLOSED | HAL_IN_DOOR_CLOSED;

void plant_init(struct plant *plant, uint64_t now_us) {
    *plant = (struct plant){.now_us = now_us,
                            .position = {PAN_START, TILT_START},
                            .closed = chains,
                            .temperature = ROOM_TEMPERATURE};
}

/* First-order motor: the speed tends to drive * full speed; without power it coasts down alike. */
static void advance_speed(struct plant *plant) {
    if (plant->blocked) {
        plant->speed = 0;
        return;
    }
    int64_t full = ((int64_t)FULL_DRIVE_RPS << TURN_BITS) / 1000000;
    int64_t wanted = plant->motors ? full * plant->drive / 10000 : 0;
    int64_t speed = plant->speed;
    plant->speed = (uint32_t)(speed + (wanted - speed) * (int64_t)PLANT_STEP_US / SPINUP_TAU_US);
}

/* Time from plant->now_us until the index, at the present speed; UINT32_MAX if it stands. */
static uint64_t index_in_us(const struct plant *plant) {
    if (!plant->speed)
        return UINT32_MAX;
    uint64_t left = (UINT64_C(1) << TURN_BITS) - (plant->turn & ((UINT64_C(1) << TURN_BITS) - 1));
    return (left + plant->speed - 1) / plant->speed;
}

/* End of the present 500 us, on a grid of absolute time. */
static uint64_t step_end_us(const struct plant *plant) {
    return (plant->now_us / PLANT_STEP_US + 1) * PLANT_STEP_US;
}

static uint64_t next_us(const struct plant *plant) {
    uint64_t next = step_end_us(plant);
    uint64_t index = plant->now_us + index_in_us(plant);
    if (index < next)
        next = index;
    if (plant->strobe_us && plant->strobe_us < next)
        next = plant->strobe_us;
    return next;
}

void plant_run(struct plant *plant, uint64_t now_us, const struct plant_events *events) {
    while (plant->now_us < now_us) {
        uint64_t to = next_us(plant);
        if (to > now_us)
            to = now_us;
        uint64_t before = plant->turn >> TURN_BITS;
        bool step_ends = to == step_end_us(plant);
        plant->turn += plant->speed * (to - plant->now_us);
        plant->now_us = to;
        if (plant->turn >> TURN_BITS != before)
            events->index(to, plant_encoder(plant, to));
        if (plant->strobe_us && plant->strobe_us <= to) {
            plant->strobe_us = 0;
            events->strobe(to);
        }
        if (step_ends)
            advance_speed(plant);
    }
}

uint64_t plant_due_us(const struct plant *plant) {
    return next_us(plant);
}

uint16_t plant_encoder(const struct plant *plant, uint64_t t_us) {
    uint64_t turn = plant->turn + plant->speed * (t_us - plant->now_us);
    return (uint16_t)(turn >> (TURN_BITS - ENCODER_BITS));
}

void plant_step(struct plant *plant, enum hal_axis axis) {
    if (plant->motors)
        plant->position[axis] += plant->positive[axis] ? 1 : -1;
}

void plant_direction(struct plant *plant, enum hal_axis axis, bool positive) {
    plant->positive[axis] = positive;
}

void plant_trigger(struct plant *plant, uint64_t now_us) {
    plant->strobe_us = now_us + CAMERA_DELAY_US;
}

uint32_t plant_inputs(const struct plant *plant) {
    int32_t pan = plant->position[HAL_PAN], tilt = plant->position[HAL_TILT];
    uint32_t inputs = plant->closed | plant->forced;
    inputs |= pan < -TRAVEL_LIMIT ? HAL_IN_PAN_LIMIT_MIN : 0u;
    inputs |= pan > TRAVEL_LIMIT ? HAL_IN_PAN_LIMIT_MAX : 0u;
    inputs |= pan < PAN_HOME_EDGE ? HAL_IN_PAN_HOME : 0u;
    inputs |= tilt < -TILT_TRAVEL_LIMIT ? HAL_IN_TILT_LIMIT_MIN : 0u;
    inputs |= tilt > TILT_TRAVEL_LIMIT ? HAL_IN_TILT_LIMIT_MAX : 0u;
    inputs |= tilt < TILT_HOME_EDGE ? HAL_IN_TILT_HOME : 0u;
    inputs |= plant->laser ? HAL_IN_LASER_CURRENT : 0u;
    return inputs;
}

bool plant_console(struct plant *plant, char letter) {
    switch (letter) {
    case 'e':
        plant->closed &= ~(uint32_t)HAL_IN_ESTOP_CLOSED;
        break;
    case 'E':
        plant->closed |= HAL_IN_ESTOP_CLOSED;
        break;
    case 'i':
        plant->closed &= ~(uint32_t)HAL_IN_INTERLOCK_CLOSED;
        break;
    case 'I':
        plant->closed |= HAL_IN_INTERLOCK_CLOSED;
        break;
    case 'd':
        plant->closed &= ~(uint32_t)HAL_IN_DOOR_CLOSED;
        break;
    case 'D':
        plant->closed |= HAL_IN_DOOR_CLOSED;
        break;
    case 'l':
        plant->forced |= HAL_IN_PAN_LIMIT_MAX;
        break;
    case 'L':
        plant->forced &= ~(uint32_t)HAL_IN_PAN_LIMIT_MAX;
        break;
    case 't':
        plant->temperature = HOT_TEMPERATURE;
        break;
    case 'T':
        plant->temperature = ROOM_TEMPERATURE;
        break;
    case 'b':
        plant->blocked = true;
        break;
    case 'B':
        plant->blocked = false;
        break;
    default:
        return false;
    }
    return true;
}
