/* The slow lines of one GPIO chip, by libgpiod. lines_gpiod_v1.c is for its 1.x interface (Debian
 * 12), lines_gpiod_v2.c for 2.x; the build takes the one that fits the installed library.
 *
 * Index and strobe give their rising edges, the chains (e-stop, interlock) both. Times are the
 * kernel's at the interrupt, monotonic (Linux 5.7 or newer). With 1.x the kernel keeps 16 edges a
 * line and drops further ones without a word; with 2.x a lost edge is counted. */
#ifndef SC_CAPTURE_LINES_GPIOD_H
#define SC_CAPTURE_LINES_GPIOD_H

#include "device/lines.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

enum lines_gpiod_bias {
    LINES_GPIOD_BIAS_AS_IS,
    LINES_GPIOD_BIAS_NONE,
    LINES_GPIOD_BIAS_PULL_UP,
    LINES_GPIOD_BIAS_PULL_DOWN
};

struct lines_gpiod_config {
    const char *chip;              /* label, name ("gpiochip0") or path of the chip */
    const char *line[LINES_COUNT]; /* by enum edge_record_line: a line's name, or its number on the
                                      chip; NULL: not wired */
    enum lines_gpiod_bias bias;
};

/* Opens the chip and takes the lines. ST_NOT_FOUND no such chip or line; ST_PERMISSION (the text
 * names the udev rule); ST_BUSY another program has a line; ST_UNSUPPORTED the chip gives no edges
 * or not that bias; ST_INVALID no chip or no line is named, or one twice. */
ST_MUST_CHECK enum st lines_gpiod_open(const struct lines_gpiod_config *config,
                                       struct lines **out_lines, struct errctx *err);

/* --- for the two implementations alone --- */

/* True if the chains' both edges are wanted. */
static inline bool lines_gpiod_both_edges(unsigned line) {
    return line == EDGE_RECORD_ESTOP || line == EDGE_RECORD_INTERLOCK;
}

/* ST_INVALID if the configuration names no chip or no line. */
ST_MUST_CHECK enum st lines_gpiod_check(const struct lines_gpiod_config *config,
                                        struct errctx *err);

/* True with the number if the text is one. */
bool lines_gpiod_number(const char *text, unsigned *out_number);

/* The status of errno `error` with its text. `line` may be NULL. */
enum st lines_gpiod_failed(int error, const char *chip, const char *line, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
