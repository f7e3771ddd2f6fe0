#include "twin/plant_setup.h"

#include "base/rng.h"
#include "firmware/shared/regmap.h"

#include <math.h>

static const double pi = 3.14159265358979323846;
/* Faults that last, if no duration is given. */
static const int64_t lasting_ns = 1000000000;
/* Parked this far beside the home switches' edges, part of a turn. */
static const double parked_turn = 60.0 / 28000;
/* Where the home switches are, part of a turn from the middle. */
static const double pan_home_turn = -13800.0 / 28000, tilt_home_turn = -3300.0 / 28000;
/* The control loop takes speed errors back in about this time; it sets the wander that the given
 * unevenness of the torque leaves. */
static const double loop_s = 0.5;

static double real(const struct twin_config *config, enum twin_config_key key) {
    return config->value[key].real;
}

static double pan_turn(const struct twin_config *config) {
    return config->value[TWIN_CONFIG_PAN_STEPS].nominal;
}

static double tilt_turn(const struct twin_config *config) {
    return config->value[TWIN_CONFIG_TILT_STEPS].nominal;
}

/* The pan may go half a turn each way, or as far as the sweep wants. */
static double pan_reach(const struct twin_config *config) {
    double deg =
        fmax(fabs(real(config, TWIN_CONFIG_PAN_FROM)), fabs(real(config, TWIN_CONFIG_PAN_TO))) + 5;
    return floor(pan_turn(config) * fmax(0.5, deg / 360));
}

static double drive_gain_rps(const struct twin_config *config) {
    return fmax(20, 2.5 * real(config, TWIN_CONFIG_MIRROR_HZ));
}

static struct sim_axis_config axis_of(double turn, double home, double reach, double backlash) {
    double edge = floor(home * turn + 0.5);
    return (struct sim_axis_config){.travel_min = -reach - 0.0215 * turn,
                                    .travel_max = reach + 0.0215 * turn,
                                    .limit_min = -reach - 0.007 * turn,
                                    .limit_max = reach + 0.007 * turn,
                                    .home_edge = edge,
                                    .start = edge + ceil(parked_turn * turn),
                                    .backlash = backlash,
                                    .stall_velocity = 120000};
}

struct sim_config plant_setup(const struct twin_config *config, uint64_t seed) {
    struct sim_config plant = sim_config_default();
    struct rng rng = rng_make(seed);
    double hz = real(config, TWIN_CONFIG_MIRROR_HZ);
    double play =
        real(config, TWIN_CONFIG_BACKLASH) * 1e-3 / (2 * pi) * real(config, TWIN_CONFIG_PAN_STEPS);
    plant.axis[HAL_PAN] = axis_of(pan_turn(config), pan_home_turn, pan_reach(config), play);
    plant.axis[HAL_TILT] = axis_of(tilt_turn(config), tilt_home_turn, tilt_turn(config) / 8, 0);
    plant.mirror_gain_rps = drive_gain_rps(config);
    plant.mirror_tau_s = real(config, TWIN_CONFIG_MIRROR_SPIN_UP);
    plant.mirror_jitter = real(config, TWIN_CONFIG_MIRROR_WANDER) * hz * sqrt(2 / loop_s);
    plant.mirror_ripple = real(config, TWIN_CONFIG_MIRROR_RIPPLE);
    plant.mirror_ripple_phase_rad = rng_range(&rng, 0, 2 * pi);
    plant.mirror_start_rev = rng_range(&rng, 0.05, 0.95);
    plant.capture_jitter_us = real(config, TWIN_CONFIG_CONTROLLER_JITTER);
    plant.poll_us = 200;
    plant.flash_us = 2000;
    plant.seed = rng_u64(&rng);
    return plant;
}

static int32_t clamped(double x, double low, double high) {
    return (int32_t)llround(fmax(low, fmin(high, x)));
}

bool plant_setup_commission(struct sim *sim, const struct twin_config *config) {
    double turn = pan_turn(config), reach = pan_reach(config), tilt = tilt_turn(config);
    double hz = real(config, TWIN_CONFIG_MIRROR_HZ), part = turn / 28000, tilt_part = tilt / 28000;
    double velocity = real(config, TWIN_CONFIG_PAN_SLEW) / 360 * turn * 1000;
    double acceleration = real(config, TWIN_CONFIG_PAN_ACCELERATION) / 360 * turn;
    double play = real(config, TWIN_CONFIG_BACKLASH) * 1e-3 / (2 * pi) * turn;
    const struct {
        uint16_t address;
        int32_t value;
    } wide[] = {
        {REGMAP_ADDR_pan_steps_turn, clamped(turn, 100, 1e7)},
        {REGMAP_ADDR_tilt_steps_turn, clamped(tilt, 100, 1e7)},
        {REGMAP_ADDR_pan_min, clamped(-reach, -1e9, 0)},
        {REGMAP_ADDR_pan_max, clamped(reach, 0, 1e9)},
        {REGMAP_ADDR_tilt_min, clamped(-tilt / 8, -1e9, 0)},
        {REGMAP_ADDR_tilt_max, clamped(tilt / 8, 0, 1e9)},
        {REGMAP_ADDR_pan_home_position, clamped(floor(pan_home_turn * turn + 0.5), -1e9, 1e9)},
        {REGMAP_ADDR_tilt_home_position, clamped(floor(tilt_home_turn * tilt + 0.5), -1e9, 1e9)},
        {REGMAP_ADDR_home_fast, clamped(2e6 * fmin(part, tilt_part), 1000, 2e7)},
        {REGMAP_ADDR_home_slow, clamped(1e5 * fmin(part, tilt_part), 1000, 2e6)},
        {REGMAP_ADDR_pan_velocity_max, clamped(velocity, 1000, 5e7)},
        {REGMAP_ADDR_tilt_velocity_max, clamped(4e6 * tilt_part, 1000, 5e7)},
        {REGMAP_ADDR_pan_acceleration, clamped(acceleration, 100, 1e6)},
        {REGMAP_ADDR_tilt_acceleration, clamped(8000 * tilt_part, 100, 1e6)},
    };
    const struct {
        uint16_t address;
        int32_t value;
    } narrow[] = {
        {REGMAP_ADDR_pan_backlash, clamped(fmax(40, ceil(play) + 20), 0, 1000)},
        {REGMAP_ADDR_mirror_safe, clamped(1000 * fmin(2, 0.6 * hz), 500, 50000)},
        {REGMAP_ADDR_mirror_max, clamped(1000 * fmax(15, 1.2 * hz), 1000, 60000)},
        {REGMAP_ADDR_mirror_feed, clamped(1e4 / drive_gain_rps(config), 1, 10000)},
        {REGMAP_ADDR_mirror_gain, clamped(6e3 / drive_gain_rps(config), 1, 10000)},
        {REGMAP_ADDR_mirror_integral, clamped(2e3 / drive_gain_rps(config), 1, 10000)},
    };
    bool good = true;
    for (size_t i = 0; i < sizeof wide / sizeof wide[0]; i++)
        good = good && !sim_write32(sim, wide[i].address, (uint32_t)wide[i].value);
    for (size_t i = 0; i < sizeof narrow / sizeof narrow[0]; i++)
        good = good && !sim_write1(sim, narrow[i].address, (uint16_t)narrow[i].value);
    return good && !sim_write1(sim, REGMAP_ADDR_commission_save, 0x5afe);
}

bool plant_setup_fault(const struct fault *fault, enum sim_fault *out_fault, double *out_on,
                       double *out_off, int64_t *out_length_ns) {
    const double forever = 1e9; /* pulses */
    static const struct {
        enum faults_kind twin;
        enum sim_fault plant;
    } kinds[] = {{FAULTS_INDEX_MISSING, SIM_FAULT_INDEX_MISSING},
                 {FAULTS_MIRROR_STALL, SIM_FAULT_MIRROR_STALL},
                 {FAULTS_MIRROR_SURGE, SIM_FAULT_MIRROR_SURGE},
                 {FAULTS_PAN_STALL, SIM_FAULT_PAN_STALL},
                 {FAULTS_MISSED_STEPS, SIM_FAULT_PAN_MISSED},
                 {FAULTS_MODBUS_NOISE, SIM_FAULT_LINE_NOISE},
                 {FAULTS_MODBUS_SILENCE, SIM_FAULT_LINE_CUT},
                 {FAULTS_ESTOP, SIM_FAULT_ESTOP},
                 {FAULTS_INTERLOCK, SIM_FAULT_INTERLOCK}};
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        if (kinds[i].twin != fault->kind)
            continue;
        *out_fault = kinds[i].plant;
        *out_on = fault->value;
        *out_off = fault->kind == FAULTS_MIRROR_SURGE ? 1 : 0;
        *out_length_ns = fault->duration_ns ? fault->duration_ns : lasting_ns;
        if (fault->kind == FAULTS_MISSED_STEPS ||
            (fault->kind == FAULTS_INDEX_MISSING && !fault->duration_ns))
            *out_length_ns = 0;
        else if (fault->kind == FAULTS_INDEX_MISSING)
            *out_on = forever;
        return true;
    }
    return false;
}
