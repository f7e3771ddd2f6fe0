/* The mirror's turns as the head counts them: over the packets of a head stream, in the order they
 * were sent, the head times at which the encoder passed its zero, and what went wrong on the way
 * (lost samples, resets, jumps of the head's clock, slips of the encoder, a mirror that stands).
 *
 * Head time is continuous within an epoch; a reset or a jump of the clock begins the next one. A
 * pass that was not looked at (the head leaves out an arc, packets were lost) is found by a cubic
 * through the angles and speeds on both sides, if the gap is shorter than 0.6 of a turn.
 *
 * No allocation; safe on the real-time path; linear time, samples nearer than 16 us to the last one
 * taken cost only their flags. Belongs to one thread. */
#ifndef SC_BASE_HEAD_TURNS_H
#define SC_BASE_HEAD_TURNS_H

#include "base/head_packet.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    HEAD_TURNS_RING = 128,
    HEAD_TURNS_FOUND = 16,
    HEAD_TURNS_ARRIVALS = 16,
    HEAD_TURNS_SLOPES = 5 /* speeds over 8, 16, ... 128 samples */
};

/* A pass of the encoder's zero. */
struct head_turn {
    int64_t t_head_ns;
    int64_t t_host_ns;   /* of the same instant, from the arrival of packets: late by some ms */
    double sigma_ns;     /* of t_head_ns, from the encoder's noise and the width of the gap */
    double rate_hz;      /* speed of the mirror there */
    uint32_t epoch, run; /* runs are separated by gaps in which turns cannot be counted */
    uint32_t turn;       /* counts the passes of a run, seen or not */
    double bias_ns; /* what may be wrong in the same way at every turn; signed; 0 if looked at */
};

enum head_turns_kind {
    HEAD_TURNS_LOST,      /* samples did not come; value: how many packets */
    HEAD_TURNS_RESET,     /* the head began anew */
    HEAD_TURNS_TIME_JUMP, /* head time against sample numbers; value: s */
    HEAD_TURNS_SLIP,      /* the encoder jumped; value: counts */
    HEAD_TURNS_SLOW,      /* the mirror fell below half its speed; value: Hz */
    HEAD_TURNS_KINDS
};

struct head_turns_incident {
    enum head_turns_kind kind;
    uint32_t epoch;
    int64_t t_head_ns, t_host_ns;
    double value;
};

/* Which epoch a packet belongs to, and whether it follows the one before. */
struct head_epoch {
    uint32_t number; /* from 1; 0: no packet yet */
    uint32_t packet_seq, next_sample_seq;
    int64_t next_t_ns; /* head time of that sample */
};

enum head_epoch_step {
    HEAD_EPOCH_NEXT,     /* follows */
    HEAD_EPOCH_GAP,      /* samples are missing before it: lost, or left out by the head */
    HEAD_EPOCH_REPEATED, /* came before: ignore it */
    HEAD_EPOCH_RESET,    /* first of a new epoch */
    HEAD_EPOCH_TIME_JUMP /* likewise: head time does not follow the sample numbers */
};

/* Takes the next packet. *out_lost: packets missing before it. */
enum head_epoch_step head_epoch_packet(struct head_epoch *epoch, const struct head_packet *packet,
                                       uint32_t *out_lost);

struct head_turns {
    /* what the last packet brought; read it after each */
    struct head_turn turn[HEAD_TURNS_FOUND];
    unsigned turn_count;
    struct head_turns_incident incident[HEAD_TURNS_FOUND];
    unsigned incident_count;
    /* totals */
    uint64_t turns, count[HEAD_TURNS_KINDS], samples;
    /* private */
    struct head_epoch epoch;
    uint32_t run;
    int64_t ring_t_ns[HEAD_TURNS_RING], ring_u[HEAD_TURNS_RING]; /* u: 2^32 a turn, unwrapped */
    unsigned ring_at, ring_count;                                /* of this stretch */
    int64_t next_zero_u;                                         /* the next pass to be found */
    unsigned since_zero;                                         /* samples beyond it */
    unsigned checked; /* samples of the stretch since a slip was looked for */
    bool gap_open;    /* a pass may lie between the stretches: wait for the speed after it */
    int64_t gap_t0_ns, gap_u0, gap_step_ns;
    double gap_rate0[HEAD_TURNS_SLOPES]; /* speed before it, u a ns */
    double gap_lag_ns[HEAD_TURNS_SLOPES];
    unsigned gap_slope;    /* which of them suits its width */
    double unrest, change; /* of the speed: see head_turns.c */
    double rate_hz;        /* usual, of the last passes */
    bool slow;
    int64_t arrival_ns[HEAD_TURNS_ARRIVALS]; /* host less head time of the last packets */
    unsigned arrivals;
};

void head_turns_init(struct head_turns *turns);

/* The next packet; t_host_ns: when it arrived. */
void head_turns_packet(struct head_turns *turns, const struct head_packet *packet,
                       int64_t t_host_ns);

#ifdef __cplusplus
}
#endif
#endif
