/* What `scancart controller` prints. */
#ifndef SC_APP_CONTROLLER_TEXT_H
#define SC_APP_CONTROLLER_TEXT_H

#include "base/st.h"
#include "device/motor.h"

/* What a crew member can do about a fault; one or two sentences. */
const char *controller_text_advice(unsigned fault);

enum st controller_text_status(const struct motor_identity *identity,
                               const struct motor_status *status, bool json, struct errctx *err);

/* Where the axes stand after a motion. */
enum st controller_text_axes(const char *done, const struct motor_status *status, bool json,
                             struct errctx *err);

/* A moving line on a terminal; nothing elsewhere. */
void controller_text_progress(const struct motor_status *status);
void controller_text_progress_end(void);

/* The fault cannot be cleared: ST_DEVICE with its causes that are present. */
enum st controller_text_causes(const struct motor_status *status, struct errctx *err);
/* fault 0: there was none. */
enum st controller_text_cleared(unsigned fault, bool json, struct errctx *err);
enum st controller_text_saved(bool json, struct errctx *err);

/* Events since monitoring began. */
struct controller_events {
    uint64_t indexes, strobes, lost, missed;
    int64_t last_t_ns;  /* controller time of the last index */
    double last_turn_s; /* time of the last whole turn, 0 unknown */
};
void controller_text_count(struct controller_events *events, const struct index_event *event);
enum st controller_text_monitor(const struct motor_status *status,
                                const struct controller_events *events, uint64_t next, bool first,
                                bool json, struct errctx *err);

#endif
