/* Data for docs/controller-motion.png: step pulses of the firmware on the simulated cart, and the
 * ideal ramp. Prints blocks for gnuplot (index 0, 1, ...), see scripts/motion-plot. */
#include "firmware/port/sim/sim.h"
#include "firmware/shared/regmap.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { MOST = 20000 };

struct trace {
    double t_s[MOST];
    int position[MOST];
    int count, at;
};

static void on_step(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive) {
    struct trace *trace = ctx;
    if (axis != HAL_PAN || trace->count == MOST)
        return;
    trace->at += positive ? 1 : -1;
    trace->t_s[trace->count] = (double)t_us * 1e-6;
    trace->position[trace->count++] = trace->at;
}

static void must(int result) {
    if (result != 0) {
        (void)fputs("motion_trace: the controller refused a command\n", stderr);
        exit(1);
    }
}

static struct sim *cart(struct trace *trace, uint16_t backlash) {
    static const struct sim_observer observer = {.step = on_step};
    struct sim_config config = sim_config_default();
    config.lossless_line = true;
    struct sim *sim = sim_create(&config);
    if (!sim)
        exit(1);
    *trace = (struct trace){.count = 0};
    sim_observe(sim, &observer, trace);
    must(sim_write1(sim, REGMAP_ADDR_host_timeout_ms, 5000));
    must(sim_write1(sim, REGMAP_ADDR_pan_backlash, backlash));
    must(sim_coil(sim, REGMAP_COIL_motor_enable, true));
    return sim;
}

/* Velocity between steps, signed, against time since the first command. */
static void print_velocity(const struct trace *trace, double t0_s) {
    for (int i = 1; i < trace->count; i++) {
        double dt_s = trace->t_s[i] - trace->t_s[i - 1];
        (void)printf("%.6f %.2f %d\n", (trace->t_s[i] + trace->t_s[i - 1]) / 2 - t0_s,
                     (trace->position[i] - trace->position[i - 1]) / dt_s, trace->position[i]);
    }
    (void)printf("\n\n");
}

/* The same for the ideal trapezoid or triangle that starts at 0. */
static void print_ideal(double way, double v, double a) {
    double ramp = v * v / (2 * a);
    if (2 * ramp > way) {
        v = sqrt(a * way);
        ramp = way / 2;
    }
    double t_ramp = v / a, t_end = 2 * t_ramp + (way - 2 * ramp) / v;
    (void)printf("0 0\n%.6f %.2f\n%.6f %.2f\n%.6f 0\n\n\n", t_ramp, v, t_end - t_ramp, v, t_end);
}

static struct trace trace;

static void simple_move(int way) {
    struct sim *sim = cart(&trace, 0);
    must(sim_write32(sim, REGMAP_ADDR_pan_target, (uint32_t)way));
    sim_advance(sim, 3000000);
    double start_s = trace.t_s[0] - sqrt(2 / 8000.0); /* the first step of the ideal ramp */
    print_velocity(&trace, start_s);
    print_ideal(way, 4000, 8000);
    sim_destroy(sim);
}

static void changed_move(void) {
    struct sim *sim = cart(&trace, 40);
    must(sim_write32(sim, REGMAP_ADDR_pan_target, 3000));
    double start_s = (double)sim_now_us(sim) * 1e-6;
    sim_advance(sim, 600000);
    must(sim_write32(sim, REGMAP_ADDR_pan_target, 1000));
    sim_advance(sim, 3000000);
    print_velocity(&trace, start_s);
    sim_destroy(sim);
}

int main(void) {
    simple_move(3000);
    simple_move(600);
    changed_move();
    return fflush(stdout) != 0;
}
