/* The controller's firmware on its simulated port, on a pseudo-terminal: a bench without an
 * emulator. Prints the terminal's name, then runs until its standard input ends. A letter on
 * standard input does something to the plant, as on the emulated board's console: e emergency stop,
 * i interlock, d door, t hot, b mirror blocked, l pan limit; upper case undoes it. It is answered
 * on standard output.
 *
 * --fast: virtual time follows real time, but the silence that ends a frame is not waited for. */
#define _XOPEN_SOURCE 600
#include "firmware/port/sim/sim.h"

#include "base/clock.h"

#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

enum { STEP_US = 250, REPLY_MAX_US = 20000 };

struct bench {
    struct sim *sim;
    int master;
    bool fast;
    int64_t start_ns;
    uint64_t ahead_us; /* by which virtual time runs before real time */
};

static int open_terminal(void) {
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 || grantpt(master) || unlockpt(master))
        return -1;
    /* Held open, so that a client's closing does not hang the terminal up. */
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY);
    struct termios raw;
    if (slave < 0 || tcgetattr(slave, &raw))
        return -1;
    raw.c_iflag = 0;
    raw.c_oflag = 0;
    raw.c_lflag = 0;
    raw.c_cflag = CS8 | CREAD | CLOCAL;
    if (tcsetattr(slave, TCSANOW, &raw))
        return -1;
    return master;
}

static bool pass_replies(struct bench *bench) {
    uint8_t bytes[512];
    size_t count = sim_collect(bench->sim, bytes, sizeof bytes);
    if (count && write(bench->master, bytes, count) != (ssize_t)count)
        exit(1);
    return count > 0;
}

static uint64_t real_us(const struct bench *bench) {
    return (uint64_t)(clock_now_ns() - bench->start_ns) / 1000;
}

static void follow_real_time(struct bench *bench) {
    sim_advance_to(bench->sim, real_us(bench) + bench->ahead_us);
    (void)pass_replies(bench);
}

/* Runs ahead until the frame just sent has been judged and answered. */
static void answer_now(struct bench *bench) {
    uint64_t end_us = sim_now_us(bench->sim) + REPLY_MAX_US;
    bool any = false;
    while (sim_now_us(bench->sim) < end_us) {
        sim_advance(bench->sim, STEP_US);
        bool came = pass_replies(bench);
        if (any && !came)
            break;
        any = any || came;
    }
    uint64_t real = real_us(bench), now = sim_now_us(bench->sim);
    bench->ahead_us = now > real ? now - real : 0;
}

static void serve_line(struct bench *bench) {
    uint8_t bytes[512];
    struct pollfd pfd = {.fd = bench->master, .events = POLLIN};
    do {
        ssize_t count = read(bench->master, bytes, sizeof bytes);
        if (count <= 0)
            return;
        (void)sim_send(bench->sim, bytes, (size_t)count);
    } while (bench->fast && poll(&pfd, 1, 0) == 1 && pfd.revents & POLLIN);
    if (bench->fast)
        answer_now(bench);
}

static bool serve_console(struct bench *bench) {
    static const struct {
        char letter;
        enum sim_fault fault;
        double on, off;
    } known[] = {{'e', SIM_FAULT_ESTOP, 1, 0},        {'i', SIM_FAULT_INTERLOCK, 1, 0},
                 {'d', SIM_FAULT_DOOR, 1, 0},         {'t', SIM_FAULT_OVER_TEMP, 80, 25},
                 {'b', SIM_FAULT_MIRROR_STALL, 1, 0}, {'l', SIM_FAULT_PAN_LIMIT, 1, 0}};
    char letter;
    if (read(STDIN_FILENO, &letter, 1) != 1)
        return false;
    char answer = '?';
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if ((letter | 0x20) == known[i].letter &&
            sim_fault_at(bench->sim, known[i].fault, sim_now_us(bench->sim),
                         letter == known[i].letter ? known[i].on : known[i].off))
            answer = letter;
    sim_advance(bench->sim, 1000);
    return write(STDOUT_FILENO, &answer, 1) == 1;
}

int main(int argc, char **argv) {
    struct sim_config config = sim_config_default();
    config.pin_interrupts = true;
    config.poll_us = 100;
    config.axis[HAL_PAN].start = config.axis[HAL_PAN].home_edge + 700;
    config.axis[HAL_TILT].start = config.axis[HAL_TILT].home_edge + 400;
    struct bench bench = {.sim = sim_create(&config),
                          .master = open_terminal(),
                          .fast = argc > 1 && !strcmp(argv[1], "--fast"),
                          .start_ns = clock_now_ns()};
    if (!bench.sim || bench.master < 0) {
        (void)fprintf(stderr, "controller_sim: cannot start\n");
        return 1;
    }
    (void)printf("%s\n", ptsname(bench.master));
    (void)fflush(stdout);
    for (;;) {
        struct pollfd pfds[] = {{.fd = bench.master, .events = POLLIN},
                                {.fd = STDIN_FILENO, .events = POLLIN}};
        (void)poll(pfds, 2, 1);
        follow_real_time(&bench);
        if (pfds[0].revents & POLLIN)
            serve_line(&bench);
        if (pfds[1].revents && !serve_console(&bench))
            break;
    }
    sim_destroy(bench.sim);
    return 0;
}
