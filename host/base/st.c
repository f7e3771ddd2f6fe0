#include "base/st.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *st_name(enum st st) {
    switch (st) {
    case ST_OK:
        return "ok";
    case ST_INVALID:
        return "invalid";
    case ST_DOMAIN:
        return "outside domain";
    case ST_NOMEM:
        return "out of memory";
    case ST_IO:
        return "i/o error";
    case ST_FORMAT:
        return "bad format";
    case ST_NOT_FOUND:
        return "not found";
    case ST_EXISTS:
        return "exists already";
    case ST_BUSY:
        return "busy";
    case ST_TIMEOUT:
        return "timed out";
    case ST_FULL:
        return "full";
    case ST_DAMAGED:
        return "damaged";
    case ST_DEVICE:
        return "device fault";
    case ST_PERMISSION:
        return "not permitted";
    case ST_CANCELLED:
        return "cancelled";
    case ST_UNSUPPORTED:
        return "unsupported";
    case ST_SINGULAR:
        return "degenerate";
    case ST_INTERNAL:
        return "internal error";
    }
    return "unknown status";
}

/* Messages quote names and values from outside: whatever they hold, the message stays one line and does
 * nothing to a terminal. */
static void keep_to_one_line(struct errctx *err) {
    for (char *c = err->text; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7f)
            *c = '?';
}

enum st errctx_set(struct errctx *err, enum st st, const char *fmt, ...) {
    if (!err)
        return st;
    err->st = st;
    va_list args;
    va_start(args, fmt);
    (void)vsnprintf(err->text, sizeof err->text, fmt, args);
    va_end(args);
    keep_to_one_line(err);
    return st;
}

enum st errctx_prefix(struct errctx *err, enum st st, const char *fmt, ...) {
    if (!err)
        return st;
    char rest[sizeof err->text];
    memcpy(rest, err->text, sizeof rest);
    va_list args;
    va_start(args, fmt);
    int n = vsnprintf(err->text, sizeof err->text, fmt, args);
    va_end(args);
    if (n >= 0 && (size_t)n < sizeof err->text)
        (void)snprintf(err->text + n, sizeof err->text - (size_t)n, ": %s", rest);
    err->st = st;
    keep_to_one_line(err);
    return st;
}
