#include "base/head_turns.h"

#include <math.h>
#include <string.h>

static const double turn_u = 4294967296.0; /* 2^32: a position word's whole range */
static const double count_u = 1048576.0;   /* 2^20 */
static const int64_t nearest_ns = 16000;   /* samples nearer to each other say nothing new */
static const int32_t repeats = 64;         /* packets back that may come a second time */
static const int64_t longest_gap_ns = 5000000000;
static const double widest_gap_turns = 0.6;
/* Of the square of the relative speed, a second, until it has been measured: 0.3 % within 0.7 s. */
static const double usual_unrest = 2.6e-5;
static const double least_noise_counts = 0.003;
static const double slip_least_counts = 0.75;

enum {
    SIDE = 8,        /* samples on each side of a pass that a line is fitted through */
    SLOPE_LEAST = 8, /* samples that a speed is taken from, at least */
    SLIP_BEFORE = 16,
    SLIP_AFTER = 4
};

void head_turns_init(struct head_turns *turns) {
    memset(turns, 0, sizeof *turns);
    turns->unrest = usual_unrest;
}

/* ---- epochs ---- */

static void epoch_take(struct head_epoch *e, const struct head_packet *p) {
    e->packet_seq = p->packet_seq;
    e->next_sample_seq = p->first_sample_seq + p->sample_count;
    e->next_t_ns = p->head_t_ns + (int64_t)p->sample_count * p->interval_ns;
}

enum head_epoch_step head_epoch_packet(struct head_epoch *epoch, const struct head_packet *packet,
                                       uint32_t *out_lost) {
    struct head_epoch *e = epoch;
    *out_lost = 0;
    enum head_epoch_step step = HEAD_EPOCH_RESET;
    if (e->number && !(packet->flags & HEAD_PACKET_RESET)) {
        int32_t ahead = (int32_t)(packet->first_sample_seq - e->next_sample_seq);
        int32_t packets = (int32_t)(packet->packet_seq - e->packet_seq);
        int64_t skew_ns =
            packet->head_t_ns - e->next_t_ns - (int64_t)ahead * (int64_t)packet->interval_ns;
        int64_t slack_ns =
            (int64_t)packet->interval_ns + (ahead > 0 ? ahead : 0) / 100; /* rounded intervals */
        bool follows = skew_ns >= -slack_ns && skew_ns <= slack_ns;
        if (ahead < 0 && follows && packets <= 0 && packets > -repeats)
            return HEAD_EPOCH_REPEATED;
        if (ahead < 0) /* the packet that said so was lost */
            step = HEAD_EPOCH_RESET;
        else if (!follows)
            step = HEAD_EPOCH_TIME_JUMP;
        else
            step = ahead ? HEAD_EPOCH_GAP : HEAD_EPOCH_NEXT;
        if (packets > 1 && packets < 100000 && step == HEAD_EPOCH_GAP)
            *out_lost = (uint32_t)packets - 1;
    }
    if (step == HEAD_EPOCH_RESET || step == HEAD_EPOCH_TIME_JUMP)
        e->number++;
    epoch_take(e, packet);
    return step;
}

/* ---- what is found ---- */

static int64_t host_of(const struct head_turns *s, int64_t t_head_ns) {
    unsigned n = s->arrivals < HEAD_TURNS_ARRIVALS ? s->arrivals : HEAD_TURNS_ARRIVALS;
    int64_t least = s->arrival_ns[0];
    for (unsigned i = 1; i < n; i++)
        least = s->arrival_ns[i] < least ? s->arrival_ns[i] : least;
    return t_head_ns + least;
}

static void report(struct head_turns *s, enum head_turns_kind kind, int64_t t_head_ns,
                   double value) {
    s->count[kind]++;
    if (s->incident_count < HEAD_TURNS_FOUND)
        s->incident[s->incident_count++] = (struct head_turns_incident){
            kind, s->epoch.number, t_head_ns, host_of(s, t_head_ns), value};
}

static void found(struct head_turns *s, double t_ns, int64_t base_ns, int64_t zero_u,
                  double sigma_ns, double rate_u_ns, double bias_ns) {
    if (s->turn_count == HEAD_TURNS_FOUND || !(rate_u_ns > 0))
        return;
    int64_t t_head_ns = base_ns + (int64_t)llround(t_ns);
    double hz = rate_u_ns / turn_u * 1e9;
    s->rate_hz = s->rate_hz > 0 ? s->rate_hz + 0.25 * (hz - s->rate_hz) : hz;
    s->turn[s->turn_count++] = (struct head_turn){.t_head_ns = t_head_ns,
                                                  .t_host_ns = host_of(s, t_head_ns),
                                                  .sigma_ns = sigma_ns,
                                                  .rate_hz = hz,
                                                  .epoch = s->epoch.number,
                                                  .run = s->run,
                                                  .turn = (uint32_t)(zero_u >> 32),
                                                  .bias_ns = bias_ns};
    s->turns++;
}

/* ---- the last samples ---- */

static unsigned slot(const struct head_turns *s, unsigned back) {
    return (s->ring_at + HEAD_TURNS_RING - 1u - back) % HEAD_TURNS_RING;
}

/* A line through `count` of the last samples, `skip` newest ones left out: u = mean_u + rate (t -
 * mean_t), relative to sample `skip`. */
struct line {
    double mean_t, mean_u, rate, rms_u, rate_sigma; /* ns, u */
    int64_t t0_ns, u0;
};

static struct line line_of(const struct head_turns *s, unsigned skip, unsigned count) {
    struct line l = {.t0_ns = s->ring_t_ns[slot(s, skip)], .u0 = s->ring_u[slot(s, skip)]};
    double stt = 0, stu = 0, suu = 0, n = (double)count;
    for (unsigned i = 0; i < count; i++) {
        unsigned k = slot(s, skip + i);
        l.mean_t += (double)(s->ring_t_ns[k] - l.t0_ns) / n;
        l.mean_u += (double)(s->ring_u[k] - l.u0) / n;
    }
    for (unsigned i = 0; i < count; i++) {
        unsigned k = slot(s, skip + i);
        double t = (double)(s->ring_t_ns[k] - l.t0_ns) - l.mean_t;
        double u = (double)(s->ring_u[k] - l.u0) - l.mean_u;
        stt += t * t, stu += t * u, suu += u * u;
    }
    l.rate = stt > 0 ? stu / stt : 0;
    l.rms_u = count > 2 ? sqrt(fmax(suu - l.rate * stu, 0) / (n - 2)) : 0;
    l.rate_sigma = stt > 0 ? l.rms_u / sqrt(stt) : 0;
    return l;
}

/* The pass of a zero that lies among the samples. */
static void pass_among(struct head_turns *s, unsigned skip, unsigned count, int64_t zero_u) {
    struct line l = line_of(s, skip, count);
    if (!(l.rate > 0))
        return;
    double t_ns = l.mean_t + ((double)(zero_u - l.u0) - l.mean_u) / l.rate;
    double sigma = fmax(l.rms_u, least_noise_counts * count_u) / l.rate / sqrt((double)count);
    found(s, t_ns, l.t0_ns, zero_u, fmax(sigma, 20), l.rate, 0);
}

/* What a cubic may get wrong, of the time that a change of speed makes over a gap of so many turns:
 * the error of a Hermite cubic over a mirror that is uneven once a turn, and of the speeds beside
 * the gap. */
static double bend_share(double turns) {
    double quarters = 4 * turns;
    return quarters * (0.005 + 0.007 * quarters);
}

/* The speed walks at random: the square of its relative change a second, from how it changed over
 * the gaps before; what changes in every gap alike is no chance. The error in the middle of a gap
 * that is bridged by a cubic has the variance unrest / 192 span^3. */
static void note_unrest(struct head_turns *s, double change, double span_s) {
    const double part = 0.05, most = 4;
    double off = change - s->change, limit = sqrt(most * s->unrest * span_s);
    off = fmin(fmax(off, -limit), limit); /* a mirror that starts or stops is no measure */
    s->change += part * off;
    s->unrest +=
        part * (1.3 * off * off / span_s - s->unrest); /* 1.3: what is cut off at two sigmas */
}

/* Passes between the last sample before a gap and the first after it: cubic Hermite in time. */
static void passes_in_gap(struct head_turns *s) {
    unsigned count = (unsigned)SLOPE_LEAST << s->gap_slope;
    count = s->ring_count < count ? s->ring_count : count;
    struct line after = line_of(s, s->ring_count - count, count);
    unsigned first = slot(s, s->ring_count - 1);
    int64_t t1_ns = s->ring_t_ns[first], u1 = s->ring_u[first];
    double span_ns = (double)(t1_ns - s->gap_t0_ns), way_u = (double)(u1 - s->gap_u0);
    /* Speeds belong to the middles of their samples: carried to the gap by how they change. */
    double lag0 = s->gap_lag_ns[s->gap_slope], lag1 = (double)(after.t0_ns - t1_ns) + after.mean_t;
    double rate0 = s->gap_rate0[s->gap_slope];
    double bend = (after.rate - rate0) / (span_ns + lag0 + lag1);
    double r0 = (rate0 + bend * lag0) * span_ns, r1 = (after.rate - bend * lag1) * span_ns;
    double change = (after.rate - rate0) * span_ns / way_u; /* of the speed, over the gap */
    double bias = bend_share(way_u / turn_u) * change * span_ns;
    note_unrest(s, change, span_ns * 1e-9);
    s->gap_open = false;
    if (!(after.rate > 0) || r0 > 3 * way_u || r1 > 3 * way_u) /* no smooth motion */
        return;
    int64_t zero_u = ((s->gap_u0 >> 32) + 1) * (int64_t)turn_u;
    for (; zero_u <= u1; zero_u += (int64_t)turn_u) {
        double want = (double)(zero_u - s->gap_u0), lo = 0, hi = 1, x = 0.5;
        for (int i = 0; i < 50; i++) { /* bisection: r0, r1 < 3 way keep it monotone */
            x = 0.5 * (lo + hi);
            double y = 1 - x;
            double u = x * x * (3 - 2 * x) * way_u + x * y * y * r0 - x * x * y * r1;
            *(u < want ? &lo : &hi) = x;
        }
        double walk = sqrt(s->unrest / 192 * span_ns * 1e-9) * span_ns;
        double ends = fmax(after.rms_u, least_noise_counts * count_u) / after.rate * sqrt(0.5);
        double speeds = after.rate_sigma / after.rate * span_ns * sqrt(2.0) / 8;
        double sigma = hypot(hypot(walk, ends), speeds) + fabs(bias);
        found(s, x * span_ns, s->gap_t0_ns, zero_u, sigma, way_u / span_ns, bias);
    }
}

/* ---- gaps ---- */

/* The stretch of samples ends: closes what waited for its speed, and notes it as one side of a
 * gap. */
static void end_stretch(struct head_turns *s, bool bridge) {
    if (s->gap_open && s->ring_count >= SLOPE_LEAST)
        passes_in_gap(s);
    s->gap_open = false;
    if (s->ring_count >= SLOPE_LEAST) {
        unsigned k = slot(s, 0);
        if (s->since_zero) /* the zero was just passed */
            pass_among(s, 0, s->ring_count < 2 * SIDE ? s->ring_count : 2 * SIDE, s->next_zero_u);
        s->gap_open = bridge;
        s->gap_t0_ns = s->ring_t_ns[k];
        s->gap_u0 = s->ring_u[k];
        for (unsigned i = 0; i < HEAD_TURNS_SLOPES; i++) {
            unsigned count = (unsigned)SLOPE_LEAST << i;
            struct line l = line_of(s, 0, s->ring_count < count ? s->ring_count : count);
            s->gap_rate0[i] = l.rate;
            s->gap_lag_ns[i] = -l.mean_t;
        }
        s->gap_step_ns = s->ring_t_ns[k] - s->ring_t_ns[slot(s, 1)];
    }
    s->ring_count = 0;
    s->since_zero = 0;
    s->checked = 0;
}

/* The first sample after a gap: how many turns were made meanwhile? */
static int64_t unwrap_gap(struct head_turns *s, int64_t t_ns, uint32_t position, int64_t last_u) {
    int64_t forward = (int64_t)(uint32_t)(position - (uint32_t)last_u);
    double gap_ns = (double)(t_ns - s->gap_t0_ns);
    double turns = s->gap_rate0[1] * gap_ns / turn_u;
    bool countable = s->gap_open && gap_ns < (double)longest_gap_ns && turns < 3;
    double whole = countable ? floor(turns - (double)forward / turn_u + 0.5) : 0;
    int64_t u = last_u + forward + (int64_t)fmax(whole, 0) * (int64_t)turn_u;
    if (!countable)
        s->run++;
    if (!countable || turns > widest_gap_turns || turns < 0)
        s->gap_open = false;
    /* Speeds are taken over an eighth of the gap: shorter ones are noisier, longer ones older. */
    s->gap_slope = 0;
    while (s->gap_slope + 1 < HEAD_TURNS_SLOPES &&
           (double)(s->gap_step_ns * (SLOPE_LEAST << (s->gap_slope + 1))) <= gap_ns / 8)
        s->gap_slope++;
    return u;
}

/* ---- slips ---- */

/* Did the encoder jump before the last SLIP_AFTER samples? They must stand beside the line of those
 * before it, all by the same. */
static bool look_for_slip(struct head_turns *s) {
    if (s->ring_count < SLIP_BEFORE + SLIP_AFTER)
        return false;
    struct line l = line_of(s, SLIP_AFTER, SLIP_BEFORE);
    double step_ns = (double)(s->ring_t_ns[slot(s, 0)] - s->ring_t_ns[slot(s, 1)]);
    double step_counts = fabs(l.rate) * step_ns / count_u;
    double least = fmax(fmax(slip_least_counts, 0.1 * step_counts), 8 * l.rms_u / count_u);
    double lo = INFINITY, hi = -INFINITY;
    for (unsigned i = 0; i < SLIP_AFTER; i++) {
        unsigned k = slot(s, i);
        double t = (double)(s->ring_t_ns[k] - l.t0_ns) - l.mean_t;
        double off = ((double)(s->ring_u[k] - l.u0) - l.mean_u - l.rate * t) / count_u;
        lo = fmin(lo, off), hi = fmax(hi, off);
    }
    double middle = 0.5 * (lo + hi);
    if (fabs(lo) < least || fabs(hi) < least || lo * hi < 0 || hi - lo > 0.25 * fabs(middle) + 0.1)
        return false;
    report(s, HEAD_TURNS_SLIP, s->ring_t_ns[slot(s, SLIP_AFTER - 1)], middle);
    s->ring_count = SLIP_AFTER; /* the line begins anew */
    s->since_zero = 0;
    s->gap_open = false;
    s->next_zero_u = ((s->ring_u[slot(s, 0)] >> 32) + 1) * (int64_t)turn_u;
    return true;
}

/* ---- samples ---- */

static void watch_speed(struct head_turns *s) {
    if (!(s->rate_hz > 0) || s->ring_count < SLOPE_LEAST)
        return;
    double hz = line_of(s, 0, SLOPE_LEAST).rate / turn_u * 1e9;
    if (!s->slow && hz < 0.5 * s->rate_hz)
        report(s, HEAD_TURNS_SLOW, s->ring_t_ns[slot(s, 0)], hz);
    s->slow = s->slow ? hz < 0.7 * s->rate_hz : hz < 0.5 * s->rate_hz;
}

static void push(struct head_turns *s, int64_t t_ns, int64_t u) {
    s->ring_t_ns[s->ring_at] = t_ns;
    s->ring_u[s->ring_at] = u;
    s->ring_at = (s->ring_at + 1) % HEAD_TURNS_RING;
    if (s->ring_count < HEAD_TURNS_RING)
        s->ring_count++;
}

static void take_sample(struct head_turns *s, int64_t t_ns, uint32_t position) {
    int64_t last_u = s->ring_count ? s->ring_u[slot(s, 0)] : s->gap_u0;
    if (s->ring_count) {
        push(s, t_ns, last_u + (int32_t)(position - (uint32_t)last_u));
    } else {
        int64_t u = unwrap_gap(s, t_ns, position, last_u);
        push(s, t_ns, u);
        s->next_zero_u = ((u >> 32) + 1) * (int64_t)turn_u;
        return;
    }
    if (s->gap_open && s->ring_count == (unsigned)SLOPE_LEAST << s->gap_slope)
        passes_in_gap(s);
    if (look_for_slip(s))
        return;
    int64_t u = s->ring_u[slot(s, 0)];
    if (u >= s->next_zero_u || s->since_zero)
        s->since_zero++;
    if (s->since_zero >= SIDE && (double)(u - s->next_zero_u) > count_u) {
        unsigned count = s->since_zero + SIDE;
        if (count < HEAD_TURNS_RING / 2) /* else it crept over it: no instant to speak of */
            pass_among(s, 0, count < s->ring_count ? count : s->ring_count, s->next_zero_u);
        else
            s->run++;
        s->since_zero = 0;
        s->next_zero_u += (int64_t)turn_u;
    }
    if (++s->checked >= HEAD_TURNS_RING / 4) {
        s->checked = 0;
        watch_speed(s);
    }
}

void head_turns_packet(struct head_turns *turns, const struct head_packet *packet,
                       int64_t t_host_ns) {
    struct head_turns *s = turns;
    uint32_t lost = 0;
    s->turn_count = s->incident_count = 0;
    if (!packet->sample_count)
        return;
    bool first = !s->epoch.number;
    enum head_epoch_step step = head_epoch_packet(&s->epoch, packet, &lost);
    if (step == HEAD_EPOCH_REPEATED)
        return;
    bool anew = step == HEAD_EPOCH_RESET || step == HEAD_EPOCH_TIME_JUMP;
    if (anew)
        s->arrivals = 0;
    int64_t last_ns = packet->head_t_ns + (int64_t)(packet->sample_count - 1) * packet->interval_ns;
    s->arrival_ns[s->arrivals++ % HEAD_TURNS_ARRIVALS] = t_host_ns - last_ns;
    if (step != HEAD_EPOCH_NEXT)
        end_stretch(s, !anew);
    if (anew) {
        s->run++;
        if (!first)
            report(s, step == HEAD_EPOCH_RESET ? HEAD_TURNS_RESET : HEAD_TURNS_TIME_JUMP,
                   packet->head_t_ns, 0);
    }
    if (lost)
        report(s, HEAD_TURNS_LOST, packet->head_t_ns, lost);
    for (unsigned i = 0; i < packet->sample_count; i++) {
        int64_t t_ns = packet->head_t_ns + (int64_t)i * packet->interval_ns;
        if (s->ring_count && t_ns - s->ring_t_ns[slot(s, 0)] < nearest_ns)
            continue;
        take_sample(s, t_ns, packet->samples[i].position);
    }
    s->samples += packet->sample_count;
}
