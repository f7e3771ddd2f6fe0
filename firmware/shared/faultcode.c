/* Texts of the codes: host side, never linked into an image. */
#include "firmware/shared/faultcode.h"

static const struct {
    const char *name, *text, *context;
} faults[FAULT_COUNT_] = {
#define X(name, number, text, context) [number] = {#name, text, context},
    FAULTCODE_LIST(X)
#undef X
};

static const char *const refusals[REFUSAL_COUNT_] = {
#define X(name, number, text) [number] = text,
    REFUSAL_LIST(X)
#undef X
};

const char *faultcode_text(int code) {
    return code >= 0 && code < FAULT_COUNT_ ? faults[code].text : "unknown";
}

const char *faultcode_name(int code) {
    return code >= 0 && code < FAULT_COUNT_ ? faults[code].name : "unknown";
}

const char *faultcode_context(int code) {
    return code >= 0 && code < FAULT_COUNT_ ? faults[code].context : "unknown";
}

const char *refusal_text(int code) {
    return code >= 0 && code < REFUSAL_COUNT_ ? refusals[code] : "unknown";
}
