/* Status codes and the error context.
 *
 * Every fallible function returns `enum st`: 0 is success, negative is a failure. Functions that open,
 * parse or touch files also fill a `struct errctx`: the deepest function writes what went wrong, where,
 * and what to do; callers may put a prefix before it. Only the program (host/app) prints it, once. */
#ifndef SC_BASE_ST_H
#define SC_BASE_ST_H

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define ST_MUST_CHECK      __attribute__((warn_unused_result))
#define ST_PRINTF(fmt, at) __attribute__((format(printf, fmt, at)))
#else
#define ST_MUST_CHECK
#define ST_PRINTF(fmt, at)
#endif

enum st {
    ST_OK = 0,
    ST_INVALID = -1,      /* an argument or an input value makes no sense */
    ST_DOMAIN = -2,       /* outside the stated domain of a model */
    ST_NOMEM = -3,        /* no memory, or a size above its bound */
    ST_IO = -4,           /* the operating system refused to read or write */
    ST_FORMAT = -5,       /* a file or message does not follow its format */
    ST_NOT_FOUND = -6,    /* the named thing is not there */
    ST_EXISTS = -7,       /* the named thing is there already */
    ST_BUSY = -8,         /* somebody else holds it */
    ST_TIMEOUT = -9,      /* a bounded wait ended without an answer */
    ST_FULL = -10,        /* a ring, table or disk has no room */
    ST_DAMAGED = -11,     /* content does not match its checksum or hash */
    ST_DEVICE = -12,      /* a device answered with a fault */
    ST_PERMISSION = -13,  /* not allowed */
    ST_CANCELLED = -14,   /* stopped on request */
    ST_UNSUPPORTED = -15, /* well formed, but not something this program can do */
    ST_SINGULAR = -16,    /* degenerate geometry: the answer is not determined */
    ST_INTERNAL = -17     /* our own bug */
};

/* What went wrong, in one line for a person: what, where, what to do. */
struct errctx {
    enum st st;
    char text[768];
};

/* Short English name of a status ("damaged"), never NULL. */
const char *st_name(enum st st);

/* Writes the message (printf style, truncated to fit, control characters replaced) and returns `st`,
 * so that a failing branch is `return errctx_set(err, ST_FORMAT, "...")`. `err` may be NULL. Not for the real-time path. */
enum st errctx_set(struct errctx *err, enum st st, const char *fmt, ...) ST_PRINTF(3, 4);

/* Puts "prefix: " before the message already there and returns its status. `err` may be NULL, then `st`
 * is returned unchanged. */
enum st errctx_prefix(struct errctx *err, enum st st, const char *fmt, ...) ST_PRINTF(3, 4);

#ifdef __cplusplus
}
#endif
#endif
