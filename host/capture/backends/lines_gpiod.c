#include "capture/backends/lines_gpiod.h"

#include <errno.h>
#include <string.h>

enum st lines_gpiod_check(const struct lines_gpiod_config *config, struct errctx *err) {
    bool any = false;
    for (int i = 0; i < LINES_COUNT; i++) {
        any = any || config->line[i];
        for (int j = 0; j < i; j++)
            if (config->line[i] && config->line[j] && !strcmp(config->line[i], config->line[j]))
                return errctx_set(err, ST_INVALID, "line '%s' of %s is named twice",
                                  config->line[i], config->chip ? config->chip : "the chip");
    }
    if (!config->chip || !any)
        return errctx_set(err, ST_INVALID,
                          "the board file names no GPIO %s: add gpio.chip and gpio.mirror_index",
                          config->chip ? "line" : "chip");
    return ST_OK;
}

bool lines_gpiod_number(const char *text, unsigned *out_number) {
    enum { LARGEST = 65535 };
    unsigned n = 0;
    if (!*text)
        return false;
    for (; *text; text++) {
        if (*text < '0' || *text > '9' || n > LARGEST)
            return false;
        n = n * 10 + (unsigned)(*text - '0');
    }
    *out_number = n;
    return n <= LARGEST;
}

enum st lines_gpiod_failed(int error, const char *chip, const char *line, struct errctx *err) {
    switch (error) {
    case EACCES:
    case EPERM:
        return errctx_set(err, ST_PERMISSION,
                          "not allowed to use GPIO chip %s: install the udev rules of the board's "
                          "folder (boards/rpi5/70-scancart.rules) and add yourself to the group "
                          "scancart",
                          chip);
    case EBUSY:
        return errctx_set(err, ST_BUSY, "line '%s' of %s is in use: see `gpioinfo`",
                          line ? line : "?", chip);
    case EINVAL:
        if (line)
            return errctx_set(err, ST_NOT_FOUND, "%s has no line '%s': see `gpioinfo`", chip, line);
        return errctx_set(err, ST_DEVICE, "%s refuses: %s", chip, strerror(error));
    case ENOENT:
        if (line)
            return errctx_set(err, ST_NOT_FOUND, "%s has no line '%s': see `gpioinfo`", chip, line);
        return errctx_set(err, ST_NOT_FOUND, "no GPIO chip '%s': see `gpiodetect`", chip);
    case ENXIO:
    case ENOTSUP:
        return errctx_set(err, ST_UNSUPPORTED,
                          "line '%s' of %s gives no edges, or not with that bias",
                          line ? line : "?", chip);
    case ENODEV:
    case EIO:
        return errctx_set(err, ST_DEVICE, "GPIO chip %s is gone: has it been unplugged?", chip);
    case ENOMEM:
        return errctx_set(err, ST_NOMEM, "no memory for the lines of %s", chip);
    default:
        return errctx_set(err, ST_IO, "GPIO chip %s%s%s: %s", chip, line ? ", line " : "",
                          line ? line : "", strerror(error));
    }
}
