/* The mirror is the clock. Head, controller and host each have a clock of their own; all three see
 * the mirror's index: the head's encoder passes zero, the controller logs the revolution with the
 * pan steps, the host gets an edge. This finds which pass is which event and which edge, follows
 * the clocks against each other (clock_track.h), and so places every sample of the head between two
 * logged positions, with the standard deviation of that.
 *
 *   head time --(passes and events)--> controller time --(events and edges)--> host time
 *
 * Which belongs to which. At first many shifts by whole turns are possible. No mirror turns evenly:
 * the right shift leaves some us of scatter, a wrong one what the mirror varied in a turn,
 * hundreds. If the mirror is too even for that, the arrival of the events at the host decides. From
 * then on each is expected where the clocks say: what comes elsewhere is spurious, what does not
 * come is missing, three in a row that are off by the same are a step, and a new segment begins.
 *
 * On line: bounded memory (this struct, some 60 kB), no allocation, no clock, no locks: the same
 * input gives the same result. Belongs to one thread. Off line: clock_solve.h. */
#ifndef SC_BASE_CART_CLOCK_H
#define SC_BASE_CART_CLOCK_H

#include "base/clock_track.h"
#include "base/head_turns.h"
#include "base/index_event.h"
#include "base/sweep.h"
#include "base/sweep_index.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    CART_CLOCK_QUEUE = 128, /* passes, events and edges that wait for each other */
    CART_CLOCK_KNOTS = 256, /* events that samples can be placed between, the newest */
    CART_CLOCK_INCIDENTS = 32,
    CART_CLOCK_SLIPS = 16,
    CART_CLOCK_SEEN = 64
};

/* An arrival that is not known. */
#define CART_CLOCK_NO_ARRIVAL INT64_MIN

struct cart_clock_params {
    double
        max_drift_ppm;   /* of two clocks against each other, one sigma of what is thinkable; 200 */
    unsigned lock_turns; /* passes and events needed to find which is which; 6 */
    double capture_ns;   /* the controller truncates times to twice this; 500 */
    double wake_ns;      /* sigma of an edge's time, as first guess; 500 000 */
    double acceleration_steps_s2; /* of the pan's ramps; 0: not known */
};
struct cart_clock_params cart_clock_params_default(void);

enum cart_clock_kind {
    CART_CLOCK_LOCKED,       /* found which pass is which event; value: scatter, us */
    CART_CLOCK_AMBIGUOUS,    /* locked, but only arrivals told one turn from the next */
    CART_CLOCK_PACKETS_LOST, /* value: packets */
    CART_CLOCK_HEAD_RESET,
    CART_CLOCK_HEAD_JUMP,          /* the head's clock jumped */
    CART_CLOCK_ENCODER_SLIP,       /* value: counts; samples are corrected by it */
    CART_CLOCK_MIRROR_SLOW,        /* below half its speed; value: Hz */
    CART_CLOCK_INDEX_SHIFT,        /* pulses come at another encoder position; value: counts */
    CART_CLOCK_EVENTS_LOST,        /* numbers missing in the controller's log; value: events */
    CART_CLOCK_CONTROLLER_RESTART, /* its log began anew */
    CART_CLOCK_HOST_JUMP,          /* value: s */
    CART_CLOCK_KINDS
};
const char *cart_clock_kind_text(enum cart_clock_kind kind);

struct cart_clock_incident {
    enum cart_clock_kind kind;
    uint32_t head_epoch;
    int64_t t_head_ns, t_host_ns; /* 0 where it has none */
    double value;
};

/* Two clocks against each other. */
struct cart_clock_pair {
    uint64_t pairs, outliers;          /* taken, and near but not believed (late wake-ups) */
    double rms_ns, max_ns;             /* of a pair about its prediction */
    double drift_ppm, drift_sigma_ppm; /* mean of the longest segment; NaN: unknown */
    unsigned segments;
};

struct cart_clock_report {
    struct cart_clock_pair head; /* controller against head */
    struct cart_clock_pair host; /* host against controller */
    uint64_t turns, events, edges;
    uint64_t missing_events, spurious_events; /* a pass without event, an event without pass */
    uint64_t unseen_turns;                    /* events while the head sent nothing */
    uint64_t missing_edges, spurious_edges;
    uint64_t lost_events, repeated_events;
    uint64_t incidents[CART_CLOCK_KINDS];
    double pan_noise_steps; /* of logged positions while the pan moves; negative: unknown */
};

/* A pass and its event, for those who smooth. */
struct cart_clock_match {
    uint32_t head_epoch, log;
    int64_t t_head_ns, t_controller_ns; /* of the pulse: shifts and truncation taken out */
    double sigma_ns;
    double common_ns; /* sigma of what is common to all of them around */
};

struct cart_clock_event { /* waiting */
    struct sweep_index index;
    int64_t t_host_ns; /* arrival */
};

struct cart_clock_expected { /* an index pulse that the host should see */
    int64_t t_controller_ns, t_host_ns;
    double turn_ns;
    bool has_event;
};

/* Drift of the longest segment. */
struct cart_clock_span {
    int64_t first_ns, last_ns;
    double first_d_ns, first_sigma_ns, span_s, drift_ppm, sigma_ppm;
    uint64_t pairs;
};

struct cart_clock {
    struct cart_clock_params params;
    struct cart_clock_report report; /* counters only: read it by cart_clock_report() */
    struct head_turns head;
    /* taken by whoever wants to smooth; NULL: nobody */
    void (*on_match)(void *ctx, const struct cart_clock_match *match);
    void *on_match_ctx;
    struct cart_clock_incident incident[CART_CLOCK_INCIDENTS]; /* the last ones, by number */
    uint64_t incident_count;
    /* private */
    struct head_turn turn[CART_CLOCK_QUEUE];
    struct cart_clock_event event[CART_CLOCK_QUEUE];
    struct cart_clock_expected expected[CART_CLOCK_QUEUE];
    int64_t edge_ns[CART_CLOCK_QUEUE];
    unsigned turns, events, expecteds, edges;
    struct cart_clock_event recent[2]; /* the last events that have left the queue */
    unsigned recents;
    uint32_t log;
    uint64_t next_seq;
    int64_t seen_ns[CART_CLOCK_SEEN]; /* times of the last events by number */
    uint32_t last_run, last_turn;     /* of the last pass that left the queue */
    bool had_turn;
    bool locked;
    uint32_t epoch; /* locked on */
    struct clock_track head_track, host_track;
    struct cart_clock_span head_span, host_span;
    double sum_head, sum_host; /* of squared residuals */
    uint64_t n_head, n_host;
    double shift_counts; /* where on the encoder the pulses come */
    double shift_sigma_ns;
    double bias_ns; /* running mean of the passes' */
    unsigned offs;  /* in a row, all near off_ns, their mean */
    double off_ns;
    bool host_locked;
    unsigned host_offs;
    double host_off_ns;
    struct {
        uint32_t epoch;
        int64_t t_head_ns;
        double counts; /* all of the epoch up to this */
    } slip[CART_CLOCK_SLIPS];
    unsigned slips;
    struct sweep_index knot[CART_CLOCK_KNOTS];
    size_t knots;
    double noise_steps;
    size_t noise_at;
    bool noise_of_sweep;
};

void cart_clock_init(struct cart_clock *clock, const struct cart_clock_params *params);

/* The next packet of the head; t_host_ns: when it arrived. */
void cart_clock_packet(struct cart_clock *clock, const struct head_packet *packet,
                       int64_t t_host_ns);
/* The same in two parts, for passes that were found before. In order of time. */
void cart_clock_turn(struct cart_clock *clock, const struct head_turn *turn);
void cart_clock_head_incident(struct cart_clock *clock, const struct head_turns_incident *incident);
/* The next event of the controller's log, whenever it was read; t_host_ns: when, or
 * CART_CLOCK_NO_ARRIVAL. */
void cart_clock_event(struct cart_clock *clock, const struct index_event *event, int64_t t_host_ns);
/* The next rising edge of the index line. */
void cart_clock_edge(struct cart_clock *clock, int64_t t_host_ns);

/* Where the head was pointed at a head time of an epoch (head.epoch.number is the present one), by
 * what is known now. counts: what the encoder showed then; corrected for slips in out_place.
 * SWEEP_LATER if the next event has not come yet, SWEEP_NO_INDEX if it never can be known (older
 * than what is kept, not matched). */
void cart_clock_place(const struct cart_clock *clock, uint32_t head_epoch, int64_t t_head_ns,
                      double counts, struct sweep_place *out_place);

/* An event without what the clocks say of it. */
struct sweep_index cart_clock_index(const struct index_event *event, uint32_t log);

/* What has come of it all so far. */
void cart_clock_report(const struct cart_clock *clock, struct cart_clock_report *out_report);

#ifdef __cplusplus
}
#endif
#endif
