/* The clocks of a whole recording, off line: which pass of the head is which event of the
 * controller as cart_clock finds it, then every epoch smoothed from both sides. What comes out is
 * the index that base/sweep places samples by. */
#ifndef SC_BASE_CLOCK_SOLVE_H
#define SC_BASE_CLOCK_SOLVE_H

#include "base/cart_clock.h"
#include "base/head_turns.h"
#include "base/index_event.h"
#include "base/st.h"
#include "base/sweep_index.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct clock_solve_event {
    struct index_event event;
    int64_t t_host_ns; /* when the host read it, or CART_CLOCK_NO_ARRIVAL */
};

/* What is collected from a recording, each in the order of the stream. Arrays grow by
 * clock_solve_*(); zero it to begin. */
struct clock_solve {
    struct head_turns head;
    struct head_turn *turns;
    struct head_turns_incident *incidents;
    struct clock_solve_event *events;
    int64_t *edges_ns;
    size_t turn_count, incident_count, event_count, edge_count;
    size_t turn_capacity, incident_capacity, event_capacity, edge_capacity;
};

/* ST_NOMEM, also beyond 2^24 of a kind. */
ST_MUST_CHECK enum st clock_solve_packet(struct clock_solve *solve,
                                         const struct head_packet *packet, int64_t t_host_ns);
ST_MUST_CHECK enum st clock_solve_event(struct clock_solve *solve, const struct index_event *event,
                                        int64_t t_host_ns);
ST_MUST_CHECK enum st clock_solve_edge(struct clock_solve *solve, int64_t t_host_ns);
void clock_solve_fini(struct clock_solve *solve); /* takes a zeroed one */

struct clock_solution {
    struct sweep_index *index;             /* sorted by head epoch and head time; malloc'ed */
    size_t count;                          /* 0: the clocks could not be matched */
    struct cart_clock_incident *incidents; /* in order; malloc'ed */
    size_t incident_count;
    struct cart_clock_report report; /* residuals of the head are about the smoothed clocks */
};

/* ST_NOMEM. A recording that cannot be matched is no failure: count is then 0. Cost: linear. The
 * same input gives the same bytes. */
ST_MUST_CHECK enum st clock_solve_make(const struct clock_solve *solve,
                                       const struct cart_clock_params *params,
                                       struct clock_solution *out_solution);
void clock_solution_fini(struct clock_solution *solution); /* takes a zeroed one */

#ifdef __cplusplus
}
#endif
#endif
