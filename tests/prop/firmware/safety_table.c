/* Raises every fault of the controller many times, at random phases of its tick, and measures how
 * long the laser and the motors stay on after the cause. The result is docs/controller-safety.md:
 * run with --write to renew it, without to compare. Virtual time: the figures are the same on every
 * machine. */
#include "firmware/core/firmware.h"
#include "firmware/hal/hal_time.h"
#include "firmware/port/sim/sim.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/regmap.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RAISES = 100, LIMIT_US = 1000 };

#define PAGE "docs/controller-safety.md"

struct bench {
    struct sim *sim;
    uint64_t random;
    uint64_t laser_off_us, motors_off_us; /* of the last switching off */
    uint64_t last_index_us;
    double slow_since_us; /* when the true speed fell below the safe one, -1 if it is not */
    uint64_t limit_us;    /* when a limit switch closed, 0 not */
};

/* --- the bench ------------------------------------------------------------------------------- */

static uint32_t below(struct bench *b, uint32_t n) {
    b->random = b->random * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((b->random >> 33) % n);
}

static void die(const char *what) {
    (void)fprintf(stderr, "safety_table: %s\n", what);
    exit(1);
}

static void must(int result, const char *what) {
    if (result != 0)
        die(what);
}

static void on_laser(void *ctx, uint64_t t_us, bool on) {
    struct bench *b = ctx;
    if (!on)
        b->laser_off_us = t_us;
}

static void on_motors(void *ctx, uint64_t t_us, bool on) {
    struct bench *b = ctx;
    if (!on)
        b->motors_off_us = t_us;
}

static void on_index(void *ctx, double exact_us, uint64_t turn) {
    (void)turn;
    ((struct bench *)ctx)->last_index_us = (uint64_t)exact_us;
}

static void on_mirror(void *ctx, uint64_t t0_us, uint64_t t1_us, double rev0, double rps0,
                      double acceleration) {
    struct bench *b = ctx;
    (void)rev0;
    double safe_rps = regmap_holding_initial.mirror_safe * 1e-3;
    double rps1 = rps0 + acceleration * (double)(t1_us - t0_us) * 1e-6;
    if (rps0 >= safe_rps && rps1 < safe_rps)
        b->slow_since_us = (double)t0_us + (safe_rps - rps0) / acceleration * 1e6;
    else if (rps1 >= safe_rps)
        b->slow_since_us = -1;
    else if (b->slow_since_us < 0)
        b->slow_since_us = (double)t0_us;
}

static void on_step(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive) {
    struct bench *b = ctx;
    (void)axis;
    (void)positive;
    const uint32_t limits =
        HAL_IN_PAN_LIMIT_MIN | HAL_IN_PAN_LIMIT_MAX | HAL_IN_TILT_LIMIT_MIN | HAL_IN_TILT_LIMIT_MAX;
    if (!b->limit_us && sim_truth(b->sim).inputs & limits)
        b->limit_us = t_us;
}

static const struct sim_observer observer = {.laser = on_laser,
                                             .motors = on_motors,
                                             .index = on_index,
                                             .mirror = on_mirror,
                                             .step = on_step};

static void start(struct bench *b, bool encoder) {
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    config.encoder = encoder;
    *b = (struct bench){.sim = sim_create(&config), .random = 1, .slow_since_us = -1};
    if (!b->sim)
        die("no memory");
    sim_observe(b->sim, &observer, b);
    must(sim_write1(b->sim, REGMAP_ADDR_mirror_spinup_ms, 4000), "spin-up time");
    must(sim_write1(b->sim, REGMAP_ADDR_mirror_max, 5500), "maximum speed");
    must(sim_write1(b->sim, REGMAP_ADDR_commission_save, 0x5afe), "commissioning");
    must(sim_write1(b->sim, REGMAP_ADDR_host_timeout_ms, 5000), "time-out");
}

static void alive(struct bench *b, uint64_t us) {
    uint16_t word;
    for (uint64_t done = 0; done < us; done += 200000) {
        must(sim_read(b->sim, REGMAP_ADDR_state, 1, &word), "read");
        sim_advance(b->sim, us - done < 200000 ? us - done : 200000);
    }
}

static void move_both(struct bench *b, int32_t target) {
    must(sim_write32(b->sim, REGMAP_ADDR_pan_target, (uint32_t)target), "pan");
    must(sim_write32(b->sim, REGMAP_ADDR_tilt_target, (uint32_t)target), "tilt");
}

/* From any state to: motors on, mirror at speed, laser on, pan and tilt moving. */
static void light(struct bench *b, bool laser) {
    struct sim *sim = b->sim;
    const struct firmware *fw = sim_firmware(sim);
    alive(b, 1000);
    if (fw->estop.state == CTLSTATE_FAULT)
        must(sim_write1(sim, REGMAP_ADDR_fault_clear, (uint16_t)fw->estop.fault), "clear");
    must(sim_coil(sim, REGMAP_COIL_motor_enable, true), "motors");
    must(sim_write1(sim, REGMAP_ADDR_mirror_target, 4000), "mirror");
    for (int i = 0; i < 100 && !fw->mirror.in_range; i++)
        alive(b, 100000);
    alive(b, 300000 + below(b, 250000));
    if (laser && sim_coil(sim, REGMAP_COIL_laser_enable, true)) {
        (void)fprintf(stderr, "laser refused: %s; mirror %u.%03u rev/s, really %.3f\n",
                      refusal_text(fw->refusal), fw->mirror.speed_mrps / 1000,
                      fw->mirror.speed_mrps % 1000, sim_truth(sim).mirror_rps);
        exit(1);
    }
    b->limit_us = 0;
    move_both(b, -1000);
    while (fw->axis[HAL_PAN].active || fw->axis[HAL_TILT].active)
        alive(b, 50000);
    move_both(b, 3000); /* in positive direction when the fault comes */
    alive(b, 20000 + below(b, 100000));
}

/* --- the table ------------------------------------------------------------------------------- */

enum cause {
    AT_FAULT,   /* the instant at which the sim's fault happens */
    AT_TIMEOUT, /* host: the last request plus the time-out */
    AT_INDEX,   /* index overdue: the last index plus the period of the safe speed */
    AT_SPEED,   /* the true speed falls below the safe one */
    AT_LOOP,    /* the main loop has stood for its limit */
    AT_TICK,    /* the tick is later than its limit */
    AT_LIMIT,   /* a limit switch closes */
    AT_DEADLINE /* the mirror's spin-up time is over */
};

struct row {
    enum faultcode fault;
    enum sim_fault raise;
    double value, repair;
    enum cause cause;
    bool laser;      /* raised with the laser on */
    bool no_encoder; /* on a board without encoder */
    bool physical;   /* measured from the plant, not from what can be observed: no limit applies */
    const char *text;
};

static const struct row rows[] = {
    {FAULT_ESTOP, SIM_FAULT_ESTOP, 1, 0, AT_FAULT, true, false, false,
     "emergency stop chain opens"},
    {FAULT_INTERLOCK, SIM_FAULT_INTERLOCK, 1, 0, AT_FAULT, true, false, false,
     "laser interlock opens"},
    {FAULT_DOOR, SIM_FAULT_DOOR, 1, 0, AT_FAULT, true, false, false, "cover opens"},
    {FAULT_OVER_TEMP, SIM_FAULT_OVER_TEMP, 85, 25, AT_FAULT, true, false, false,
     "temperature rises above the limit"},
    {FAULT_TEMP_SENSOR, SIM_FAULT_TEMP_SENSOR, 1, 0, AT_FAULT, true, false, false,
     "temperature sensor breaks"},
    {FAULT_PAN_LIMIT, SIM_FAULT_PAN_LIMIT, 1, 0, AT_FAULT, true, false, false,
     "pan moves into a limit switch"},
    {FAULT_TILT_LIMIT, SIM_FAULT_TILT_LIMIT, 1, 0, AT_FAULT, true, false, false,
     "tilt moves into a limit switch"},
    {FAULT_MIRROR_SLOW, SIM_FAULT_MIRROR_STALL, 1, 0, AT_SPEED, true, false, false,
     "mirror blocked; with encoder; from the instant it stands"},
    {FAULT_MIRROR_SLOW, SIM_FAULT_MIRROR_STALL, 1, 0, AT_INDEX, true, true, false,
     "mirror blocked; no encoder; from the instant the index is overdue"},
    {FAULT_MIRROR_SLOW, SIM_FAULT_MIRROR_STALL, 1, 0, AT_SPEED, true, true, true,
     "the same, from the instant it stands: half a turn at safe speed is blind without encoder"},
    {FAULT_MIRROR_SLOW, SIM_FAULT_MIRROR_SURGE, 0, 1, AT_SPEED, true, false, true,
     "mirror drive dead, it coasts below the safe speed; with encoder; from the true speed"},
    {FAULT_MIRROR_FAST, SIM_FAULT_MIRROR_SURGE, 10, 1, AT_FAULT, true, false, true,
     "mirror drive gain ten times too high; from the change of gain (the mirror needs the rest)"},
    {FAULT_MIRROR_STALL, SIM_FAULT_MIRROR_STALL, 1, 0, AT_DEADLINE, false, false, false,
     "mirror does not start; from the end of the spin-up time"},
    {FAULT_HOST_SILENT, SIM_FAULT_LINE_CUT, 1, 0, AT_TIMEOUT, true, false, false,
     "line cut; from the last request plus the host time-out"},
    {FAULT_STACK, SIM_FAULT_STACK, 255, 4096, AT_FAULT, true, false, false,
     "less free stack than the board's minimum"},
    {FAULT_CLOCK, SIM_FAULT_CLOCK, 1, 0, AT_FAULT, true, false, false, "clock source fails"},
    {FAULT_CLOCK, SIM_FAULT_TICK_LATE, 20000, 0, AT_TICK, true, false, false,
     "safety tick does not come; from 250 us after it was due"},
    {FAULT_LOOP, SIM_FAULT_LOOP_HANG, 100000, 0, AT_LOOP, true, false, false,
     "main loop hangs; from 50 ms after its last pass"},
    {FAULT_PAN_HOMING, SIM_FAULT_HOME_DEAD, 1, 0, AT_LIMIT, true, false, false,
     "pan homing meets the limit switch, the home switch being dead"},
    {FAULT_TILT_HOMING, SIM_FAULT_HOME_DEAD, 1, 0, AT_LIMIT, true, false, false,
     "tilt homing meets the limit switch, the home switch being dead"},
    {FAULT_LASER_STUCK, SIM_FAULT_LASER_STUCK, 1, 0, AT_FAULT, false, false, false,
     "laser current flows with the laser off; motors off, as the laser cannot be"},
};

struct result {
    uint64_t worst_laser_us, worst_motors_us;
    int raises;
};

static uint64_t cause_time(const struct bench *b, const struct row *row, uint64_t fault_us) {
    const struct firmware *fw = sim_firmware(b->sim);
    const uint64_t safe_period_us = 1000000000u / regmap_holding_initial.mirror_safe;
    switch (row->cause) {
    case AT_FAULT:
        return fault_us;
    case AT_TIMEOUT:
        return fw->heard_us + 1000u * fw->host_timeout_ms;
    case AT_INDEX:
        return b->last_index_us + safe_period_us;
    case AT_SPEED:
        return (uint64_t)b->slow_since_us;
    case AT_LOOP:
        return fw->loop_us + 1000u * FIRMWARE_LOOP_LIMIT_MS;
    case AT_TICK:
        return fw->tick_us + HAL_TICK_US + HAL_TICK_US / 2;
    case AT_LIMIT:
        return b->limit_us;
    case AT_DEADLINE:
        return fw->mirror.target_since_us + 4000000u;
    }
    return 0;
}

/* Homing: first back to the middle, then towards the dead switch. */
static void begin_homing(struct bench *b, const struct row *row) {
    bool pan = row->fault == FAULT_PAN_HOMING;
    uint16_t target = pan ? REGMAP_ADDR_pan_target : REGMAP_ADDR_tilt_target;
    uint16_t fast = pan ? REGMAP_ADDR_pan_velocity_max : REGMAP_ADDR_tilt_velocity_max;
    const struct axis *axis = &sim_firmware(b->sim)->axis[pan ? HAL_PAN : HAL_TILT];
    must(sim_write32(b->sim, fast, 20000000), "velocity");
    /* the controller's zero drifts from the plant's at each lost reference: move by what is left to
     * the end */
    double left = sim_truth(b->sim).head_steps[pan ? HAL_PAN : HAL_TILT] -
                  sim_config_default().axis[pan ? HAL_PAN : HAL_TILT].limit_min;
    must(sim_write32(b->sim, target, (uint32_t)(axis->position - (int32_t)(left - 300))), "target");
    while (axis->active)
        alive(b, 100000);
    must(sim_coil(b->sim, pan ? REGMAP_COIL_home_pan : REGMAP_COIL_home_tilt, true), "home");
    b->limit_us = 0;
}

/* Moves the axis away from its limit for the next round, so that the soft limits stay usable. */
static void after_homing(struct bench *b, const struct row *row) {
    bool pan = row->fault == FAULT_PAN_HOMING;
    alive(b, 1000);
    must(sim_write1(b->sim, REGMAP_ADDR_fault_clear, (uint16_t)row->fault), "clear");
    must(sim_coil(b->sim, REGMAP_COIL_motor_enable, true), "motors");
    const struct axis *axis = &sim_firmware(b->sim)->axis[pan ? HAL_PAN : HAL_TILT];
    must(sim_coil(b->sim, pan ? REGMAP_COIL_home_pan : REGMAP_COIL_home_tilt, true), "home");
    while (axis->homing)
        alive(b, 100000);
    if (!axis->homed)
        die(faultcode_text((int)sim_firmware(b->sim)->estop.fault));
}

static void raise_once(struct bench *b, const struct row *row, struct result *result) {
    struct sim *sim = b->sim;
    const struct firmware *fw = sim_firmware(sim);
    bool homing = row->cause == AT_LIMIT;
    if (row->cause == AT_DEADLINE) /* the mirror stands still before it is started */
        (void)sim_fault_at(sim, row->raise, sim_now_us(sim), row->value);
    if (row->cause == AT_DEADLINE) {
        alive(b, 1000);
        if (fw->estop.state == CTLSTATE_FAULT)
            must(sim_write1(sim, REGMAP_ADDR_fault_clear, (uint16_t)fw->estop.fault), "clear");
        must(sim_coil(sim, REGMAP_COIL_motor_enable, true), "motors");
        alive(b, below(b, 5000));
        must(sim_write1(sim, REGMAP_ADDR_mirror_target, 4000), "mirror");
    } else {
        light(b, row->laser);
    }
    uint64_t fault_us = sim_now_us(sim) + 1 + below(b, 2000);
    if (row->cause != AT_DEADLINE && !sim_fault_at(sim, row->raise, fault_us, row->value))
        die("too many faults");
    if (homing) {
        sim_advance(sim, 5000);
        begin_homing(b, row);
    }
    uint64_t cause_us = 0, end_us = sim_now_us(sim) + 8000000;
    while (fw->estop.state != CTLSTATE_FAULT && sim_now_us(sim) < end_us) {
        cause_us = cause_time(b, row, fault_us);
        if (row->raise != SIM_FAULT_LINE_CUT && row->cause != AT_LOOP && row->cause != AT_TICK &&
            sim_now_us(sim) > fault_us + 1000000 && sim_now_us(sim) % 1000000 < 100) {
            uint16_t word;
            (void)sim_read(sim, REGMAP_ADDR_state, 1, &word);
        }
        sim_advance(sim, 50);
    }
    if (row->cause == AT_SPEED)
        cause_us = (uint64_t)b->slow_since_us; /* found by the plant at the end of its step */
    if (row->cause == AT_LIMIT)
        cause_us = b->limit_us;
    if (fw->estop.fault != row->fault) {
        (void)fprintf(stderr, "%s gave fault %s\n", row->text,
                      faultcode_name((int)fw->estop.fault));
        exit(1);
    }
    if (sim_truth(sim).laser || sim_truth(sim).motors)
        die("an output is on in a fault");
    uint64_t laser_us = b->laser_off_us - cause_us, motors_us = b->motors_off_us - cause_us;
    if (row->laser && laser_us > result->worst_laser_us)
        result->worst_laser_us = laser_us;
    if (motors_us > result->worst_motors_us)
        result->worst_motors_us = motors_us;
    result->raises++;
    (void)sim_fault_at(sim, row->raise, sim_now_us(sim), row->repair);
    sim_advance(sim, 200000);
    if (homing)
        after_homing(b, row);
}

static struct result measure(const struct row *row) {
    struct bench bench;
    struct result result = {0, 0, 0};
    start(&bench, !row->no_encoder);
    int raises = row->cause == AT_LIMIT ? RAISES / 5 : RAISES;
    for (int i = 0; i < raises; i++)
        raise_once(&bench, row, &result);
    sim_destroy(bench.sim);
    return result;
}

static const char head[] = "<!-- Written by tests/prop/firmware/safety_table.c (run it with "
                           "--write); a test compares. -->\n"
                           "# How fast the controller makes the cart safe\n"
                           "\n"
                           "Every fault of the controller, raised on the simulated cart (the real "
                           "firmware core on a virtual clock) with the\n"
                           "laser on and both axes moving, each time at another phase of the "
                           "safety tick. Given are the **worst** times in\n"
                           "timer ticks (1 us) from the cause to the outputs going off. The bound "
                           "is 1000. Each row is a case of the test\n"
                           "`safety_table`, which fails if a bound is exceeded, if the code "
                           "latched is another one, or if this page does not\n"
                           "say what the test measures. Inputs are polled by the tick here; a "
                           "board that also wires them to pin-change\n"
                           "interrupts (`firmware_isr_pins`) is faster.\n"
                           "\n"
                           "| fault | code | raised by | times | laser off | motors off |\n"
                           "|---|--:|---|--:|--:|--:|\n";

static const char tail[] =
    "\n"
    "Rows with an asterisk measure the plant, not the controller: they contain the time that the "
    "mirror itself takes, or\n"
    "the time without any observation (between two index pulses on a board without encoder), and "
    "have no bound of\n"
    "1000. They are what a laser safety calculation needs.\n"
    "\n"
    "`WATCHDOG` (18) is latched at start-up after a reset by the hardware watchdog: outputs are "
    "off from the reset on, by\n"
    "pull resistors, before any code runs; the unit tests `watchdog_reset_starts_latched` and\n"
    "`a_reset_switches_everything_off` show it.\n";

static char page[16384];
static size_t page_length;

static void put(const char *text) {
    size_t n = strlen(text);
    if (page_length + n >= sizeof page)
        die("page too long");
    memcpy(page + page_length, text, n + 1);
    page_length += n;
}

static int build_page(void) {
    int failed = 0;
    put(head);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        const struct row *row = &rows[i];
        struct result result = measure(row);
        char line[512], laser[32] = "was off";
        if (row->laser)
            (void)snprintf(laser, sizeof laser, "%" PRIu64, result.worst_laser_us);
        (void)snprintf(line, sizeof line, "| %s%s | %d | %s | %d | %s | %" PRIu64 " |\n",
                       faultcode_name((int)row->fault), row->physical ? " *" : "", (int)row->fault,
                       row->text, result.raises, laser, result.worst_motors_us);
        put(line);
        (void)fputs(line, stdout);
        const uint64_t bound = LIMIT_US;
        if (!row->physical && (result.worst_laser_us > bound || result.worst_motors_us > bound)) {
            (void)fprintf(stderr, "over the bound of %" PRIu64 " us\n", bound);
            failed = 1;
        }
    }
    put(tail);
    return failed;
}

int main(int argc, char **argv) {
    int failed = build_page();
    bool write = argc > 1 && !strcmp(argv[1], "--write");
    FILE *file = fopen(PAGE, write ? "w" : "r");
    if (!file)
        die("cannot open " PAGE " (run from the source root)");
    if (write) {
        failed |= fputs(page, file) < 0;
    } else {
        static char have[sizeof page];
        size_t n = fread(have, 1, sizeof have - 1, file);
        have[n] = 0;
        if (strcmp(have, page) != 0) {
            (void)fprintf(stderr, PAGE " is not what was measured: run safety_table --write\n");
            failed = 1;
        }
    }
    return fclose(file) || failed;
}
