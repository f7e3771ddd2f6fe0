/* Many transactions with a controller, a share of them broken: a libmodbus master that knows what
 * each answer must be.
 *
 *   controller_torture DEVICE [--transactions N] [--broken PERCENT] [--quiet-ms N] [--seed N]
 *
 * Of the requests, PERCENT % get one byte changed and PERCENT % are cut short: the controller must
 * stay silent and must not change. All others are checked against a model of the registers: echo,
 * values, exceptions. The mirror spins meanwhile; its index events are read by sequence number and
 * must come without a gap. A request without an answer is repeated and counted, for an emulator may
 * be stopped by its host in the middle of a frame; a wrong answer ends the program with status 1.
 * Prints one line of figures. */
#define _DEFAULT_SOURCE
#include "base/clock.h"
#include "base/rng.h"
#include "firmware/shared/faultcode.h"
#include "firmware/shared/idxevent.h"
#include "firmware/shared/mbframe.h"
#include "firmware/shared/regmap.h"

#include <errno.h>
#include <modbus/modbus.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum {
    UNIT = 1,
    RETRIES = 5,
    TIMEOUT_MS = 1000,
    MIRROR_MRPS = 9000,
    EVENTS_EVERY = 16, /* requests */
    SPINUP_MAX_MS = 30000
};

struct torture {
    modbus_t *modbus;
    int fd;
    struct rng rng;
    struct regmap_holding model; /* what the controller's registers hold */
    long quiet_ms;
    unsigned long good, corrupted, truncated, exceptions, silent, repeated;
    uint32_t next_event;
    bool any_event;
    uint32_t revolution;
    uint64_t event_us;
    unsigned long indexes, strobes;
};

static void die(const char *fmt, ...) {
    va_list args;
    va_start(args, fmt);
    (void)printf("WRONG: ");
    (void)vprintf(fmt, args);
    (void)printf("\n");
    va_end(args);
    exit(1);
}

static void wait_ms(long ms) {
    struct timespec t = {ms / 1000, ms % 1000 * 1000000};
    (void)nanosleep(&t, NULL);
}

/* Bytes that come within `ms`, counted; waits the whole time. */
static size_t listen_for(struct torture *t, long ms) {
    int64_t end_ns = clock_now_ns() + ms * 1000000;
    size_t heard = 0;
    for (;;) {
        int64_t left_ns = end_ns - clock_now_ns();
        if (left_ns <= 0)
            return heard;
        struct pollfd pfd = {.fd = t->fd, .events = POLLIN};
        uint8_t bytes[256];
        if (poll(&pfd, 1, (int)(left_ns / 1000000) + 1) == 1) {
            ssize_t n = read(t->fd, bytes, sizeof bytes);
            heard += n > 0 ? (size_t)n : 0;
        }
    }
}

/* Result of a libmodbus call: its count, or minus the exception code; repeats if there is no
 * answer. */
#define ASK(t, call)                                                                               \
    __extension__({                                                                                \
        int ask_result = -1000;                                                                    \
        for (int ask_try = 0; ask_try <= RETRIES && ask_result == -1000; ask_try++) {              \
            ask_result = (call);                                                                   \
            if (ask_result < 0)                                                                    \
                ask_result = failed((t));                                                          \
        }                                                                                          \
        if (ask_result == -1000)                                                                   \
            die("no answer to %s in %d tries", #call, RETRIES + 1);                                \
        ask_result;                                                                                \
    })

static int failed(struct torture *t) {
    if (errno > MODBUS_ENOBASE && errno < MODBUS_ENOBASE + MODBUS_EXCEPTION_MAX) {
        t->exceptions++;
        return -(errno - MODBUS_ENOBASE);
    }
    if (errno != ETIMEDOUT)
        die("libmodbus: %s", modbus_strerror(errno));
    t->silent++;
    (void)listen_for(t, t->quiet_ms);
    return -1000;
}

/* --- the model
 * ------------------------------------------------------------------------------------------ */

/* Blocks of registers that may be written at any time and do nothing by themselves. */
static const struct block {
    uint16_t start;
    uint8_t words;
} blocks[] = {
    {REGMAP_ADDR_pan_velocity_max, 8}, {REGMAP_ADDR_scan_from, 8}, {REGMAP_ADDR_camera_first, 6}};
enum { BLOCKS = sizeof blocks / sizeof blocks[0], BLOCK_WORDS = 8 };

static const struct regmap_entry *row_at(uint16_t address) {
    const struct regmap_entry *row = regmap_find(regmap_holdings, REGMAP_HOLDING_COUNT_, address);
    if (!row)
        die("no register at 0x%04x", address);
    return row;
}

static void model_words(const struct torture *t, uint16_t start, unsigned count, uint16_t *out) {
    if (!regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &t->model, start, count, out))
        die("model has no block at 0x%04x", start);
}

/* Random values within their ranges for a whole block. */
static void random_block(struct torture *t, const struct block *block,
                         struct regmap_holding *out_values) {
    for (unsigned at = block->start; at < block->start + block->words;) {
        const struct regmap_entry *row = row_at((uint16_t)at);
        uint64_t span = (uint64_t)(row->max - row->min);
        uint64_t pick = span ? rng_u64(&t->rng) % (span + 1) : 0;
        regmap_set(row, out_values, row->min + (int64_t)pick);
        at += regmap_type_words(row->type);
    }
}

static void expect_words(struct torture *t, uint16_t start, unsigned count, const uint16_t *words) {
    uint16_t want[BLOCK_WORDS];
    model_words(t, start, count, want);
    if (memcmp(want, words, count * sizeof *words))
        die("registers at 0x%04x do not hold what was written", start);
}

/* --- good requests
 * -------------------------------------------------------------------------------------- */

static void read_block(struct torture *t) {
    const struct block *b = &blocks[rng_below(&t->rng, BLOCKS)];
    uint16_t words[BLOCK_WORDS];
    int got = ASK(t, modbus_read_registers(t->modbus, b->start, b->words, words));
    if (got != b->words)
        die("read of 0x%04x gave %d", b->start, got);
    expect_words(t, b->start, b->words, words);
}

static void write_block(struct torture *t) {
    const struct block *b = &blocks[rng_below(&t->rng, BLOCKS)];
    struct regmap_holding next = t->model;
    random_block(t, b, &next);
    uint16_t words[BLOCK_WORDS];
    (void)regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &next, b->start, b->words, words);
    int got = ASK(t, modbus_write_registers(t->modbus, b->start, b->words, words));
    if (got != b->words)
        die("write of 0x%04x gave %d", b->start, got);
    t->model = next;
}

/* One value of the block out of its range: exception 03, and the whole block stays. */
static void write_out_of_range(struct torture *t) {
    const struct block *b = &blocks[rng_below(&t->rng, BLOCKS)];
    struct regmap_holding next = t->model;
    random_block(t, b, &next);
    const struct regmap_entry *row = row_at(b->start);
    regmap_set(row, &next, row->max + 1 + (int64_t)rng_below(&t->rng, 1000));
    uint16_t words[BLOCK_WORDS];
    (void)regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &next, b->start, b->words, words);
    int got = ASK(t, modbus_write_registers(t->modbus, b->start, b->words, words));
    if (got != -MBEXC_VALUE)
        die("a value out of range at 0x%04x gave %d", b->start, got);
}

static void read_hole(struct torture *t) {
    uint16_t words[4];
    int got = ASK(t, modbus_read_input_registers(t->modbus, 0x0f00, 4, words));
    if (got != -MBEXC_ADDRESS)
        die("a read of nothing gave %d", got);
}

static void write_word(struct torture *t) {
    uint16_t value = (uint16_t)(1 + rng_below(&t->rng, 1000));
    int got = ASK(t, modbus_write_register(t->modbus, REGMAP_ADDR_scan_steps, value));
    if (got != 1)
        die("write of one register gave %d", got);
    t->model.scan_steps = value;
}

static void mask_word(struct torture *t) {
    uint16_t and_mask = (uint16_t)rng_u64(&t->rng), or_mask = (uint16_t)rng_below(&t->rng, 1024);
    uint16_t next = (uint16_t)((t->model.scan_steps & and_mask) | (or_mask & ~and_mask));
    bool fits = next >= 1 && next <= 1000;
    unsigned long silent = t->silent;
    int got =
        ASK(t, modbus_mask_write_register(t->modbus, REGMAP_ADDR_scan_steps, and_mask, or_mask));
    if (fits ? got < 0 : got != -MBEXC_VALUE)
        die("a mask write to %u gave %d", next, got);
    if (fits)
        t->model.scan_steps = next;
    if (silent != t->silent) /* repeated: applied once or twice, which is the same for a mask */
        t->repeated++;
}

static void write_and_read(struct torture *t) {
    const struct block *w = &blocks[rng_below(&t->rng, BLOCKS)],
                       *r = &blocks[rng_below(&t->rng, BLOCKS)];
    random_block(t, w, &t->model);
    uint16_t words[BLOCK_WORDS], read[BLOCK_WORDS];
    model_words(t, w->start, w->words, words);
    int got = ASK(t, modbus_write_and_read_registers(t->modbus, w->start, w->words, words, r->start,
                                                     r->words, read));
    if (got != r->words)
        die("write and read gave %d", got);
    expect_words(t, r->start, r->words, read);
}

static void read_bits(struct torture *t) {
    uint8_t bits[REGMAP_DISCRETE_COUNT_];
    int got = ASK(t, modbus_read_input_bits(t->modbus, 0, REGMAP_DISCRETE_COUNT_, bits));
    if (got != REGMAP_DISCRETE_COUNT_)
        die("read of discrete inputs gave %d", got);
    if (bits[REGMAP_DISCRETE_fault] || !bits[REGMAP_DISCRETE_motors_on] ||
        bits[REGMAP_DISCRETE_laser_on])
        die("fault %d, motors %d, laser %d", bits[REGMAP_DISCRETE_fault],
            bits[REGMAP_DISCRETE_motors_on], bits[REGMAP_DISCRETE_laser_on]);
}

static void read_coils(struct torture *t) {
    uint8_t bits[REGMAP_COIL_COUNT_];
    int got = ASK(t, modbus_read_bits(t->modbus, 0, REGMAP_COIL_COUNT_, bits));
    if (got != REGMAP_COIL_COUNT_ || !bits[REGMAP_COIL_motor_enable] || bits[REGMAP_COIL_scan_run])
        die("read of coils gave %d: motor_enable %d", got, bits[REGMAP_COIL_motor_enable]);
}

static void write_coil(struct torture *t) {
    int got = ASK(t, modbus_write_bit(t->modbus, REGMAP_COIL_camera_trigger, 1));
    if (got != 1)
        die("write of a coil gave %d", got);
}

static void write_coils(struct torture *t) {
    const uint8_t off[2] = {0, 0};
    int got = ASK(t, modbus_write_bits(t->modbus, REGMAP_COIL_camera_trigger, 2, off));
    if (got != 2)
        die("write of coils gave %d", got);
}

static void (*const good[])(struct torture *t) = {
    read_block, read_block,     write_block, write_out_of_range, read_hole,  write_word,
    mask_word,  write_and_read, read_bits,   read_coils,         write_coil, write_coils};

/* --- broken requests
 * ------------------------------------------------------------------------------------ */

/* A request that would change something if it were believed. */
static unsigned make_request(struct torture *t, uint8_t *frame) {
    const struct block *b = &blocks[rng_below(&t->rng, BLOCKS)];
    struct regmap_holding next = t->model;
    random_block(t, b, &next);
    uint16_t words[BLOCK_WORDS];
    (void)regmap_encode(regmap_holdings, REGMAP_HOLDING_COUNT_, &next, b->start, b->words, words);
    frame[0] = UNIT;
    frame[1] = 16;
    mbframe_put16(frame + 2, b->start);
    mbframe_put16(frame + 4, b->words);
    frame[6] = (uint8_t)(2 * b->words);
    for (unsigned i = 0; i < b->words; i++)
        mbframe_put16(frame + 7 + 2 * i, words[i]);
    return mbframe_seal(frame, 7u + 2u * b->words);
}

static void send_broken(struct torture *t, bool truncate) {
    uint8_t frame[MBFRAME_MAX];
    unsigned count = make_request(t, frame);
    if (truncate) {
        count = 1 + rng_below(&t->rng, count - 1);
    } else {
        uint8_t change = (uint8_t)(1 + rng_below(&t->rng, 255));
        frame[rng_below(&t->rng, count)] ^= change;
    }
    if (mbframe_ok(frame, count))
        return; /* the change made another good frame: not what is wanted here */
    if (write(t->fd, frame, count) != (ssize_t)count)
        die("cannot write: %s", strerror(errno));
    size_t heard = listen_for(t, t->quiet_ms);
    if (heard)
        die("%zu bytes in answer to a %s request", heard, truncate ? "truncated" : "corrupted");
    *(truncate ? &t->truncated : &t->corrupted) += 1;
}

/* --- events
 * --------------------------------------------------------------------------------------------- */

static void take_event(struct torture *t, const struct idxevent *e) {
    if (e->seq != t->next_event)
        die("event %u where %u belongs", e->seq, t->next_event);
    t->next_event++;
    bool index = (e->flags & IDXEVENT_KIND) == IDXEVENT_INDEX;
    if (t->any_event && e->time_us < t->event_us && index)
        die("event %u goes back in time", e->seq);
    if (t->any_event && index && e->revolution != t->revolution + 1)
        die("event %u: revolution %u after %u", e->seq, e->revolution, t->revolution);
    if (index) {
        t->revolution = e->revolution;
        t->event_us = e->time_us;
        t->any_event = true;
    }
    *(index ? &t->indexes : &t->strobes) += 1;
}

static void read_events(struct torture *t) {
    unsigned count;
    do {
        uint16_t from[2], w[IDXEVENT_WINDOW_WORDS];
        regmap_store_U32(from, t->next_event);
        int got =
            ASK(t, modbus_write_and_read_registers(t->modbus, REGMAP_ADDR_event_from, 2, from,
                                                   IDXEVENT_WINDOW_ADDR, IDXEVENT_WINDOW_WORDS, w));
        if (got != IDXEVENT_WINDOW_WORDS)
            die("read of the event window gave %d", got);
        t->model.event_from = t->next_event;
        if (regmap_get_event_overrun(w, IDXEVENT_WINDOW_ADDR))
            die("%u events were overwritten", regmap_get_event_overrun(w, IDXEVENT_WINDOW_ADDR));
        count = regmap_get_event_count(w, IDXEVENT_WINDOW_ADDR);
        for (unsigned i = 0; i < count && i < IDXEVENT_WINDOW; i++) {
            struct idxevent e = idxevent_decode(w + IDXEVENT_HEADER + i * IDXEVENT_WORDS);
            take_event(t, &e);
        }
    } while (count == IDXEVENT_WINDOW);
}

/* --- start and end
 * -------------------------------------------------------------------------------------- */

static void start(struct torture *t) {
    uint16_t words[128], word;
    if (ASK(t, modbus_read_registers(t->modbus, REGMAP_ADDR_map_version, 1, words)) != 1 ||
        words[0] != REGMAP_VERSION)
        die("no controller with register map %d", REGMAP_VERSION);
    if (ASK(t, modbus_write_register(t->modbus, REGMAP_ADDR_host_timeout_ms, 5000)) != 1 ||
        ASK(t, modbus_write_bit(t->modbus, REGMAP_COIL_motor_enable, 1)) != 1 ||
        ASK(t, modbus_write_register(t->modbus, REGMAP_ADDR_mirror_target, MIRROR_MRPS)) != 1)
        die("cannot start the mirror");
    int64_t end_ns = clock_now_ns() + (int64_t)SPINUP_MAX_MS * 1000000;
    do {
        if (ASK(t, modbus_read_registers(t->modbus, REGMAP_ADDR_mirror_actual, 1, &word)) != 1 ||
            clock_now_ns() > end_ns)
            die("the mirror does not turn");
        read_events(t);
        wait_ms(20);
    } while (word < MIRROR_MRPS * 9 / 10);
    for (int i = 0; i < BLOCKS; i++) { /* both sides begin alike */
        model_words(t, blocks[i].start, blocks[i].words, words);
        (void)ASK(t, modbus_write_registers(t->modbus, blocks[i].start, blocks[i].words, words));
    }
}

static modbus_t *open_line(const char *device) {
    modbus_t *modbus = modbus_new_rtu(device, 115200, 'N', 8, 1);
    if (!modbus || modbus_set_slave(modbus, UNIT) ||
        modbus_set_error_recovery(modbus, MODBUS_ERROR_RECOVERY_NONE) ||
        modbus_set_response_timeout(modbus, TIMEOUT_MS / 1000, 0) || modbus_connect(modbus)) {
        (void)fprintf(stderr, "controller_torture: %s: %s\n", device, modbus_strerror(errno));
        exit(2);
    }
    return modbus;
}

static long option(int argc, char **argv, const char *name, long fallback) {
    for (int i = 2; i + 1 < argc; i++)
        if (!strcmp(argv[i], name))
            return strtol(argv[i + 1], NULL, 0);
    return fallback;
}

int main(int argc, char **argv) {
    if (argc < 2) {
        (void)fprintf(stderr,
                      "usage: controller_torture DEVICE [--transactions N] [--broken PERCENT] "
                      "[--quiet-ms N] [--seed N]\n");
        return 2;
    }
    long wanted = option(argc, argv, "--transactions", 2000);
    uint32_t broken = (uint32_t)option(argc, argv, "--broken", 1);
    struct torture t = {.modbus = open_line(argv[1]),
                        .rng = rng_make((uint64_t)option(argc, argv, "--seed", 1)),
                        .quiet_ms = option(argc, argv, "--quiet-ms", 30),
                        .model = regmap_holding_initial};
    t.fd = modbus_get_socket(t.modbus);
    start(&t);
    int64_t start_ns = clock_now_ns();
    for (long i = 0; i < wanted; i++) {
        uint32_t kind = rng_below(&t.rng, 100);
        if (kind < 2 * broken) {
            send_broken(&t, kind < broken);
        } else {
            good[rng_below(&t.rng, sizeof good / sizeof good[0])](&t);
            t.good++;
        }
        if (i % EVENTS_EVERY == 0) {
            read_events(&t);
            t.good++;
        }
    }
    read_events(&t);
    double seconds = (double)(clock_now_ns() - start_ns) * 1e-9;
    unsigned long all = t.good + t.corrupted + t.truncated;
    if (wanted >= 1000 && t.indexes < 10)
        die("only %lu index events", t.indexes);
    (void)printf(
        "%lu transactions in %.1f s, %.0f a second: %lu good (%lu of them exceptions, as wanted), "
        "%lu corrupted, %lu truncated, %lu without answer and repeated, 0 wrong; "
        "%lu index and %lu strobe events, none missed\n",
        all, seconds, (double)all / seconds, t.good, t.exceptions, t.corrupted, t.truncated,
        t.silent, t.indexes, t.strobes);
    modbus_close(t.modbus);
    modbus_free(t.modbus);
    return 0;
}
