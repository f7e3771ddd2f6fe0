#include "base/sweep.h"

#include <math.h>
#include <string.h>

static const double two_pi = 6.283185307179586;
static const double uniform = 0.28867513459481287; /* sigma of a uniform distribution of width 1 */

/* Of 2^32 position units a turn: beyond a quarter turn between neighbours the direction is in
 * doubt. */
static const uint32_t quarter_turn = 1u << 30;

/* Samples farther apart than this may hide a turn. */
static int64_t safe_gap_ns(const struct sweep *s) {
    const int64_t unknown_ns = 40000000; /* 0.4 of a turn at 10 Hz */
    if (s->at + 1 >= s->index_count)
        return unknown_ns;
    const struct sweep_index *a = &s->index[s->at], *b = &s->index[s->at + 1];
    int64_t turns = (int64_t)b->revolution - (int64_t)a->revolution;
    return turns > 0 && b->t_host_ns > a->t_host_ns ? (b->t_host_ns - a->t_host_ns) / turns * 2 / 5
                                                    : unknown_ns;
}

void sweep_init(struct sweep *sweep, const struct sweep_index *index, size_t index_count) {
    memset(sweep, 0, sizeof *sweep);
    sweep->index = index;
    sweep->index_count = index_count;
    sweep->fitted = index_count > 0 && index[0].head_epoch > 0;
    if (sweep->fitted)
        sweep->cursor.params.noise_steps = fmax(pan_curve_noise(index, index_count), 0);
}

/* ---- by the clocks ---- */

static bool before(const struct sweep_index *a, uint32_t epoch, int64_t t_head_ns) {
    return a->head_epoch != epoch ? a->head_epoch < epoch : a->t_head_ns <= t_head_ns;
}

/* The last pulse at or before, or 0; samples come in order, so it is mostly where it was. */
static size_t seek(const struct sweep_index *index, size_t count, size_t at, uint32_t epoch,
                   int64_t t_head_ns) {
    if (at >= count || !before(&index[at], epoch, t_head_ns)) {
        size_t low = 0, high = count;
        while (low < high) {
            size_t middle = (low + high) / 2;
            if (before(&index[middle], epoch, t_head_ns))
                low = middle + 1;
            else
                high = middle;
        }
        return low ? low - 1 : 0;
    }
    while (at + 1 < count && before(&index[at + 1], epoch, t_head_ns))
        at++;
    return at;
}

void sweep_at(struct sweep_cursor *cursor, const struct sweep_index *index, size_t count,
              uint32_t head_epoch, int64_t t_head_ns, double counts,
              struct sweep_place *out_place) {
    struct sweep_place place = {.verdict = SWEEP_NO_INDEX,
                                .counts = counts,
                                .pan_sigma_steps = (double)NAN,
                                .tilt_sigma_steps = (double)NAN};
    *out_place = place;
    if (!count)
        return;
    size_t at = seek(index, count, cursor->at, head_epoch, t_head_ns);
    cursor->at = at;
    const struct sweep_index *a = &index[at], *b = a + 1;
    if (!before(a, head_epoch, t_head_ns) || at + 1 >= count || a->head_epoch != head_epoch ||
        b->head_epoch != head_epoch)
        return;
    if (!cursor->has_curve || cursor->curve_at != at) {
        cursor->has_curve = pan_curve_make(index, count, at, &cursor->params, &cursor->curve);
        cursor->curve_at = at;
        if (!cursor->has_curve)
            return;
    }
    double part = (double)(t_head_ns - a->t_head_ns) / (double)(b->t_head_ns - a->t_head_ns);
    double sigma_s = 1e-9 * (a->t_sigma_ns + part * (b->t_sigma_ns - a->t_sigma_ns));
    struct pan_curve_point p = pan_curve_at(&cursor->curve, part * cursor->curve.span_s);
    double slip =
        a->slip_t_head_ns && t_head_ns >= a->slip_t_head_ns ? a->slip_after_counts : a->slip_counts;
    place.verdict = SWEEP_GOOD;
    place.counts = slip == 0 ? counts : counts - slip;
    place.pan_steps = p.pan_steps;
    place.tilt_steps = p.tilt_steps;
    place.pan_sigma_steps = hypot(p.pan_sigma_steps, p.pan_rate * sigma_s);
    place.tilt_sigma_steps = p.tilt_sigma_steps;
    place.pan_direction = a->pan_direction == b->pan_direction ? a->pan_direction : 0;
    place.sweep = a->sweep && b->sweep;
    place.revolution = a->revolution;
    if (b->revolution > a->revolution + 1) /* pulses are missing: by time */
        place.revolution += (uint32_t)(part * (double)(b->revolution - a->revolution));
    *out_place = place;
}

static void packet_by_clocks(struct sweep *s, const struct head_packet *packet,
                             struct sweep_place *out_places) {
    uint32_t lost = 0;
    (void)head_epoch_packet(&s->epoch, packet, &lost);
    for (unsigned i = 0; i < packet->sample_count; i++)
        sweep_at(&s->cursor, s->index, s->index_count, s->epoch.number,
                 packet->head_t_ns + (int64_t)i * packet->interval_ns,
                 head_position_counts(packet->samples[i].position), &out_places[i]);
}

/* ---- by the encoder's phase ---- */

/* The index event whose pulse began the turn in which the host was at t: the last one before t. */
static size_t event_before(const struct sweep *s, int64_t t_host_ns) {
    size_t low = 0, high = s->index_count;
    while (low < high) {
        size_t middle = (low + high) / 2;
        if (s->index[middle].t_host_ns <= t_host_ns)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Finds the revolution of the present turn from the host's time and the encoder's phase: the pulse
 * that began this turn was phase * period ago. */
static void match(struct sweep *s, int64_t t_host_ns, uint32_t position) {
    size_t n = event_before(s, t_host_ns);
    if (n < 1 || s->index_count < 2)
        return;
    size_t k = n < s->index_count ? n : n - 1; /* a pair of events gives the period */
    const struct sweep_index *a = &s->index[k - 1], *b = &s->index[k];
    if (b->revolution == a->revolution)
        return;
    double period_ns =
        (double)(b->t_host_ns - a->t_host_ns) / (double)(b->revolution - a->revolution);
    if (!(period_ns > 0))
        return;
    double began_ns = (double)t_host_ns - (double)position / 4294967296.0 * period_ns;
    double turns_after = (began_ns - (double)a->t_host_ns) / period_ns;
    s->revolution_of_turn_0 = (int64_t)a->revolution + (int64_t)floor(turns_after + 0.5) - s->turns;
    s->matched = true;
}

static void interpolate(struct sweep *s, struct sweep_place *place, int64_t revolution,
                        double part) {
    while (s->at + 1 < s->index_count && (int64_t)s->index[s->at + 1].revolution <= revolution)
        s->at++;
    while (s->at > 0 && (int64_t)s->index[s->at].revolution > revolution)
        s->at--;
    const struct sweep_index *a = &s->index[s->at];
    if ((int64_t)a->revolution > revolution || s->at + 1 >= s->index_count)
        return; /* the verdict stays SWEEP_NO_INDEX */
    const struct sweep_index *b = &s->index[s->at + 1];
    /* Missed pulses: several revolutions between a and b. */
    double k = ((double)(revolution - (int64_t)a->revolution) + part) /
               (double)(b->revolution - a->revolution);
    place->pan_steps = a->pan_steps + k * (b->pan_steps - a->pan_steps);
    place->tilt_steps = a->tilt_steps + k * (b->tilt_steps - a->tilt_steps);
    place->pan_direction = a->pan_direction == b->pan_direction ? a->pan_direction : 0;
    place->sweep = a->sweep && b->sweep;
    place->revolution = (uint32_t)revolution;
    place->verdict = SWEEP_GOOD;
}

static void packet_by_phase(struct sweep *s, const struct head_packet *packet, int64_t t_host_ns,
                            struct sweep_place *out_places) {
    for (unsigned i = 0; i < packet->sample_count; i++) {
        uint32_t position = packet->samples[i].position, seq = packet->first_sample_seq + i;
        int64_t t_ns =
            t_host_ns - (int64_t)packet->interval_ns * (int64_t)(packet->sample_count - 1u - i);
        bool reset = i == 0 && (packet->flags & HEAD_PACKET_RESET);
        int64_t gap_ns = (int64_t)(seq - s->last_seq) * packet->interval_ns;
        if (s->started && !reset && gap_ns > 0 && gap_ns < safe_gap_ns(s)) {
            /* Less than half a turn: the encoder wrapped once at most. A step back by jitter is no
             * turn. */
            if (position < s->last_position && s->last_position - position > quarter_turn)
                s->turns++;
            else if (position > s->last_position && position - s->last_position > 3u * quarter_turn)
                s->turns--;
        } else {
            s->matched = false; /* find the turn anew by time */
        }
        s->started = true;
        s->last_position = position;
        s->last_seq = seq;
        if (!s->matched)
            match(s, t_ns, position);
        struct sweep_place *place = &out_places[i];
        memset(place, 0, sizeof *place);
        place->verdict = SWEEP_NO_INDEX;
        place->counts = head_position_counts(position);
        place->pan_sigma_steps = place->tilt_sigma_steps = (double)NAN;
        if (s->matched && s->index_count)
            interpolate(s, place, s->turns + s->revolution_of_turn_0,
                        (double)position / 4294967296.0);
    }
}

void sweep_packet(struct sweep *sweep, const struct head_packet *packet, int64_t t_host_ns,
                  struct sweep_place *out_places) {
    if (sweep->fitted)
        packet_by_clocks(sweep, packet, out_places);
    else
        packet_by_phase(sweep, packet, t_host_ns, out_places);
}

double sweep_pan_sigma(const struct rig *rig, const struct sweep_place *place) {
    if (place->verdict != SWEEP_GOOD)
        return (double)NAN;
    double play_rad = place->pan_direction ? 0 : uniform * rig->pan_backlash_rad;
    return hypot(place->pan_sigma_steps * two_pi / rig->pan_steps_per_turn, play_rad);
}

double sweep_tilt_sigma(const struct rig *rig, const struct sweep_place *place) {
    if (place->verdict != SWEEP_GOOD)
        return (double)NAN;
    return place->tilt_sigma_steps * two_pi / rig->tilt_steps_per_turn;
}

struct vec3 sweep_point(const struct rig *rig, const struct sweep_place *place,
                        const struct head_sample *sample) {
    double range_m = place->verdict == SWEEP_GOOD ? head_range_m(sample->range) : (double)NAN;
    return rig_point(rig, rig_mirror_angle(rig, place->counts),
                     rig_tilt_angle(rig, place->tilt_steps),
                     rig_pan_angle(rig, place->pan_steps, place->pan_direction), range_m);
}
