/* Named faults and when they happen. One fault as text:
 *
 *   NAME@START[+DURATION][=VALUE]      seconds of true time; VALUE's unit depends on the fault
 *
 * for example  mirror_stall@12+1.5   packet_lost@30+0=5   clock_jump@60=0.25   encoder_slip@10=3 */
#ifndef SC_TWIN_FAULTS_H
#define SC_TWIN_FAULTS_H

#include "base/st.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum faults_kind {
    FAULTS_PACKET_LOST,
    FAULTS_PACKET_REPEATED,
    FAULTS_PACKET_SEQUENCE,
    FAULTS_BIT_ERROR,
    FAULTS_HEAD_RESET,
    FAULTS_ENCODER_SLIP,
    FAULTS_INDEX_MISSING,
    FAULTS_MIRROR_STALL,
    FAULTS_MIRROR_SURGE,
    FAULTS_PAN_STALL,
    FAULTS_MISSED_STEPS,
    FAULTS_MODBUS_NOISE,
    FAULTS_MODBUS_SILENCE,
    FAULTS_FRAME_DROPPED,
    FAULTS_EXPOSURE_LATE,
    FAULTS_LIGHT_CHANGE,
    FAULTS_CLOCK_JUMP,
    FAULTS_DISK_FULL,
    FAULTS_POWER_LOSS,
    FAULTS_ESTOP,
    FAULTS_INTERLOCK,
    FAULTS_KINDS
};

struct faults_info {
    const char *name, *what, *value; /* value: its meaning and unit, NULL: takes none */
    double fallback;                 /* value if none is given */
    double min, max;                 /* of the value */
};

/* Name and meaning of each kind, indexed by enum faults_kind. */
const struct faults_info *faults_info_of(enum faults_kind kind);

struct fault {
    enum faults_kind kind;
    int64_t start_ns, duration_ns;
    double value;
};

enum { FAULTS_MAX = 64 };

/* A schedule. */
struct faults {
    struct fault list[FAULTS_MAX];
    size_t count;
};

/* Adds one fault from its text. ST_NOT_FOUND for a name (the message lists the names), ST_FORMAT,
 * ST_INVALID for a value out of bounds, ST_FULL. */
ST_MUST_CHECK enum st faults_parse(struct faults *faults, const char *text, struct errctx *err);

/* The first fault of that kind that is on at t (start <= t < start + duration, or exactly one
 * instant within [t, t + step) if its duration is 0); NULL: none. */
const struct fault *faults_at(const struct faults *faults, enum faults_kind kind, int64_t t_ns,
                              int64_t step_ns);

#endif
