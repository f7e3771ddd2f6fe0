#define _DEFAULT_SOURCE /* flock */
#include "capture/backends/motor_modbus.h"

#include "base/clock.h"
#include "device/motor_map.h"

#include <errno.h>
#include <fcntl.h>
#include <modbus/modbus.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

struct line {
    modbus_t *modbus;
    char device[256];
    unsigned unit, timeout_ms, retries;
};

enum {
    STATUS_REQUESTS = 7, /* of motor_map's status, its longest op */
    QUIET_MS = 20,       /* silence that ends a late or broken answer */
    FLUSH_MAX_MS = 500   /* longest wait for that silence */
};

/* Throws away what still comes until the line is quiet, so that a late answer is never taken for
 * the next one. Bounded. */
static void flush(const struct line *line) {
    struct pollfd pfd = {.fd = modbus_get_socket(line->modbus), .events = POLLIN};
    int64_t end_ns = clock_now_ns() + (int64_t)FLUSH_MAX_MS * 1000000;
    char waste[256];
    while (clock_now_ns() < end_ns && poll(&pfd, 1, QUIET_MS) == 1)
        if (!(pfd.revents & POLLIN) || read(pfd.fd, waste, sizeof waste) <= 0)
            break;
    (void)modbus_flush(line->modbus);
}

/* What libmodbus' errno means: a Modbus exception (positive) or a status with its text. */
static int translate(const struct line *line, int error, struct errctx *err) {
    if (error > MODBUS_ENOBASE && error < MODBUS_ENOBASE + MODBUS_EXCEPTION_MAX)
        return error - MODBUS_ENOBASE;
    if (error == ETIMEDOUT)
        return errctx_set(
            err, ST_TIMEOUT,
            "no answer on %s from unit %u within %u ms: is the controller powered, the "
            "cable A to A and B to B, baud rate and parity right?",
            line->device, line->unit, line->timeout_ms);
    if (error == EIO || error == ENODEV || error == ENXIO || error == EBADF || error == ECONNRESET)
        return errctx_set(err, ST_IO, "%s is gone (%s): has the converter been unplugged?",
                          line->device, strerror(error));
    return errctx_set(err, ST_DAMAGED,
                      "answers on %s are garbled (%s): check cable, baud rate, parity",
                      line->device, modbus_strerror(error));
}

/* One request, described by what only its own kind needs. */
struct request {
    enum { READ, READ_DISCRETE, WRITE, WRITE_COIL, WRITE_READ } kind;
    uint16_t start, read_start;
    unsigned count, read_count;
    const uint16_t *words;
    uint16_t *out_words;
    uint8_t *out_bits;
    bool on;
};

static int send_once(const struct line *line, const struct request *r) {
    int n = (int)r->count;
    switch (r->kind) {
    case READ: /* input and holding registers share one space: function 3 reads both */
        return modbus_read_registers(line->modbus, r->start, n, r->out_words);
    case READ_DISCRETE:
        return modbus_read_input_bits(line->modbus, r->start, n, r->out_bits);
    case WRITE:
        return n == 1 ? modbus_write_register(line->modbus, r->start, r->words[0])
                      : modbus_write_registers(line->modbus, r->start, n, r->words);
    case WRITE_COIL:
        return modbus_write_bit(line->modbus, r->start, r->on);
    case WRITE_READ:
        return modbus_write_and_read_registers(line->modbus, r->start, n, r->words, r->read_start,
                                               (int)r->read_count, r->out_words);
    }
    return -1;
}

/* Sends a request, again up to `retries` times if no or a broken answer comes. */
static int transact(const struct line *line, const struct request *request, unsigned retries,
                    struct errctx *err) {
    for (unsigned attempt = 0;; attempt++) {
        if (send_once(line, request) >= 0) {
            if (attempt) /* this may have been the first one's late answer: the second's is on its
                            way */
                flush(line);
            return 0;
        }
        int result = translate(line, errno, err);
        if (result > 0 || result == ST_IO)
            return result;
        flush(line);
        if (attempt == retries)
            return result;
    }
}

static int line_read(void *ctx, uint16_t start, unsigned count, uint16_t *out_words,
                     struct errctx *err) {
    const struct line *line = ctx;
    struct request r = {.kind = READ, .start = start, .count = count, .out_words = out_words};
    return transact(line, &r, line->retries, err);
}

static int line_read_discrete(void *ctx, uint16_t start, unsigned count, uint8_t *out_bits,
                              struct errctx *err) {
    const struct line *line = ctx;
    struct request r = {
        .kind = READ_DISCRETE, .start = start, .count = count, .out_bits = out_bits};
    return transact(line, &r, line->retries, err);
}

static int line_write(void *ctx, uint16_t start, unsigned count, const uint16_t *words, bool repeat,
                      struct errctx *err) {
    const struct line *line = ctx;
    struct request r = {.kind = WRITE, .start = start, .count = count, .words = words};
    return transact(line, &r, repeat ? line->retries : 0, err);
}

static int line_write_coil(void *ctx, uint16_t coil, bool on, bool repeat, struct errctx *err) {
    const struct line *line = ctx;
    struct request r = {.kind = WRITE_COIL, .start = coil, .count = 1, .on = on};
    return transact(line, &r, repeat ? line->retries : 0, err);
}

static int line_write_read(void *ctx, uint16_t write_start, unsigned write_count,
                           const uint16_t *words, uint16_t read_start, unsigned read_count,
                           uint16_t *out_words, struct errctx *err) {
    const struct line *line = ctx;
    struct request r = {.kind = WRITE_READ,
                        .start = write_start,
                        .count = write_count,
                        .words = words,
                        .read_start = read_start,
                        .read_count = read_count,
                        .out_words = out_words};
    return transact(line, &r, line->retries, err);
}

static void line_close(void *ctx) {
    struct line *line = ctx;
    if (line->modbus) {
        modbus_close(line->modbus);
        modbus_free(line->modbus);
    }
    free(line);
}

struct motor_modbus_config motor_modbus_default(void) {
    return (struct motor_modbus_config){
        .baud = 115200, .parity = 'E', .unit = 1, .timeout_ms = 1000, .retries = 2};
}

static enum st open_failed(const char *device, int error, struct errctx *err) {
    switch (error) {
    case ENOENT:
    case ENXIO:
    case ENODEV:
        return errctx_set(err, ST_NOT_FOUND,
                          "no device %s: plug in the controller's USB converter, see `ls "
                          "/dev/serial/by-id`, or give another --port",
                          device);
    case EACCES:
    case EPERM:
        return errctx_set(err, ST_PERMISSION,
                          "not allowed to open %s: install the udev rules of the board's folder "
                          "(boards/rpi5/70-scancart.rules) and add yourself to the group scancart",
                          device);
    case EBUSY:
        return errctx_set(err, ST_BUSY, "%s is in use by another program", device);
    default:
        return errctx_set(err, ST_IO, "cannot open %s: %s", device, strerror(error));
    }
}

/* A pseudo-terminal (an emulator's line) carries no parity, and asking for one fails the second
 * time. */
static bool is_pseudo_terminal(const struct stat *info) {
    enum { FIRST_PTS_MAJOR = 136, LAST_PTS_MAJOR = 143 };
    return major(info->st_rdev) >= FIRST_PTS_MAJOR && major(info->st_rdev) <= LAST_PTS_MAJOR;
}

/* libmodbus makes a terminal of anything: look first, so that there is a clear word. */
static enum st look_at_device(const char *device, bool *out_pseudo, struct errctx *err) {
    struct stat info;
    int fd = open(device, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        return open_failed(device, errno, err);
    bool terminal = isatty(fd);
    bool known = !fstat(fd, &info);
    (void)close(fd);
    if (!terminal)
        return errctx_set(err, ST_INVALID, "%s is not a serial line", device);
    *out_pseudo = known && is_pseudo_terminal(&info);
    return ST_OK;
}

static enum st connect_line(struct line *line, struct errctx *err) {
    if (modbus_set_slave(line->modbus, (int)line->unit) ||
        modbus_set_error_recovery(line->modbus, MODBUS_ERROR_RECOVERY_NONE) ||
        modbus_set_response_timeout(line->modbus, line->timeout_ms / 1000,
                                    line->timeout_ms % 1000 * 1000))
        return errctx_set(err, ST_INVALID, "unit %u or time-out %u ms makes no sense", line->unit,
                          line->timeout_ms);
    if (modbus_connect(line->modbus))
        return open_failed(line->device, errno, err);
    if (flock(modbus_get_socket(line->modbus), LOCK_EX | LOCK_NB))
        return open_failed(line->device, EBUSY, err);
    flush(line);
    return ST_OK;
}

enum st motor_modbus_open(const struct motor_modbus_config *config, struct motor **out_motor,
                          struct errctx *err) {
    if (!config->device || strlen(config->device) >= sizeof(((struct line *)NULL)->device) ||
        !config->unit || config->unit > 247 || !config->baud || config->baud > 4000000 ||
        !config->parity || !strchr("NEO", config->parity) || config->timeout_ms < 200 ||
        config->timeout_ms > 60000 || config->retries > 10)
        return errctx_set(err, ST_INVALID, "the controller's line is not configured sensibly");
    bool pseudo = false;
    enum st st = look_at_device(config->device, &pseudo, err);
    if (st)
        return st;
    struct line *line = calloc(1, sizeof *line);
    if (!line)
        return errctx_set(err, ST_NOMEM, "no memory for the controller's line");
    memcpy(line->device, config->device, strlen(config->device) + 1);
    line->unit = config->unit;
    line->timeout_ms = config->timeout_ms;
    line->retries = config->retries;
    char parity = pseudo ? 'N' : config->parity;
    line->modbus =
        modbus_new_rtu(line->device, (int)config->baud, parity, 8, parity == 'N' ? 2 : 1);
    if (!line->modbus)
        st = errctx_set(err, ST_NOMEM, "no memory for the controller's line");
    else
        st = connect_line(line, err);
    if (st) {
        line_close(line);
        return st;
    }
    struct motor_line calls = {.ctx = line,
                               .read = line_read,
                               .read_discrete = line_read_discrete,
                               .write = line_write,
                               .write_coil = line_write_coil,
                               .write_read = line_write_read,
                               .close = line_close};
    unsigned block_ms =
        STATUS_REQUESTS * (config->retries + 1) * (config->timeout_ms + FLUSH_MAX_MS);
    return motor_map_open(&calls, block_ms, out_motor, err);
}
