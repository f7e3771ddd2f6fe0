#include "twin/mechanics.h"

#include "twin/plant_setup.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double pi = 3.14159265358979323846;
/* The controller is commissioned in this time before true time 0. */
static const uint64_t commission_us = 500000;
/* What lies before a block is kept this long: integrations reach back a little. */
static const double keep_us = 2000;

/* ---- records ---- */

static void *list_add(struct mechanics *m, struct mechanics_list *list) {
    if (list->count + 2 >= list->capacity) { /* two more: the tail of marks */
        size_t capacity = list->capacity ? 2 * list->capacity : 256;
        void *items = realloc(list->items, capacity * list->item_size);
        if (!items) {
            m->out_of_memory = true;
            return NULL;
        }
        list->items = items;
        list->capacity = capacity;
    }
    return (char *)list->items + list->count++ * list->item_size;
}

static void on_segment(void *ctx, uint64_t t0_us, uint64_t t1_us, double rev0, double rps0,
                       double acceleration) {
    (void)t1_us;
    struct mechanics *m = ctx;
    struct mechanics_segment *s = list_add(m, &m->segment);
    if (s)
        *s = (struct mechanics_segment){(double)t0_us, rev0, rps0, acceleration};
}

static void add_mark(struct mechanics *m, enum hal_axis axis, double us, double head,
                     double counted) {
    struct mechanics_mark *mark = list_add(m, &m->mark[axis]);
    if (mark)
        *mark = (struct mechanics_mark){us, head, counted};
}

static const struct mechanics_mark *last_mark(const struct mechanics *m, enum hal_axis axis) {
    const struct mechanics_mark *marks = m->mark[axis].items;
    return &marks[m->mark[axis].count - 1];
}

static void on_step(void *ctx, uint64_t t_us, enum hal_axis axis, bool positive) {
    (void)positive;
    struct mechanics *m = ctx;
    struct sim_step step = sim_step(m->sim, axis);
    struct mechanics_mark before = *last_mark(m, axis);
    m->tail[axis] = 0;
    if (step.since_us > before.us) /* it stood until then */
        add_mark(m, axis, step.since_us, before.head_steps, step.counted);
    add_mark(m, axis, (double)t_us, sim_truth(m->sim).head_steps[axis],
             step.counted + (step.positive ? 1 : -1));
}

static void on_laser(void *ctx, uint64_t t_us, bool on) {
    struct mechanics *m = ctx;
    struct mechanics_laser *laser = list_add(m, &m->laser);
    if (laser)
        *laser = (struct mechanics_laser){(double)t_us, on};
}

static void add_event(struct mechanics *m, double us, enum mechanics_event_kind kind, bool high) {
    struct mechanics_event *event = list_add(m, &m->event);
    if (event)
        *event = (struct mechanics_event){us, kind, high};
}

static void on_pulse(void *ctx, double exact_us) {
    add_event(ctx, exact_us, MECHANICS_INDEX, true);
}

static void on_strobe(void *ctx, double exact_us) {
    add_event(ctx, exact_us, MECHANICS_STROBE, true);
}

static void on_fault(void *ctx, uint64_t t_us, enum sim_fault fault, double value) {
    if (fault == SIM_FAULT_ESTOP)
        add_event(ctx, (double)t_us, MECHANICS_ESTOP, value == 0);
    else if (fault == SIM_FAULT_INTERLOCK)
        add_event(ctx, (double)t_us, MECHANICS_INTERLOCK, value == 0);
}

static const struct sim_observer observer = {.step = on_step,
                                             .laser = on_laser,
                                             .pulse = on_pulse,
                                             .strobe = on_strobe,
                                             .mirror = on_segment,
                                             .fault = on_fault};

/* ---- time ---- */

/* The controller's plant time at true time t. */
static double us_at(const struct mechanics *m, int64_t t_ns) {
    return m->sim_zero_us + (double)clocks_show(m->clock, t_ns) * 1e-3 - m->shown_zero_us;
}

int64_t mechanics_reached_ns(const struct mechanics *m) {
    double shown_us = (double)sim_now_us(m->sim) - m->sim_zero_us + m->shown_zero_us;
    int64_t t_ns = clocks_when(m->clock, (int64_t)floor(shown_us * 1000));
    return t_ns > m->to_ns ? t_ns : m->to_ns;
}

void mechanics_run(struct mechanics *m, int64_t t_ns) {
    double us = us_at(m, t_ns);
    if (us > 0)
        sim_advance_to(m->sim, (uint64_t)ceil(us) + 1);
}

/* ---- life ---- */

static enum st let_loose(struct mechanics *m, struct errctx *err) {
    for (size_t i = 0; m->faults && i < m->faults->count; i++) {
        const struct fault *f = &m->faults->list[i];
        enum sim_fault kind;
        double on, off;
        int64_t length_ns;
        if (!plant_setup_fault(f, &kind, &on, &off, &length_ns))
            continue;
        bool fits = sim_fault_at(m->sim, kind, (uint64_t)us_at(m, f->start_ns), on);
        if (fits && length_ns > 0)
            fits = sim_fault_at(m->sim, kind, (uint64_t)us_at(m, f->start_ns + length_ns), off);
        if (!fits)
            return errctx_set(err, ST_INVALID, "too many faults of the controller and its motors");
    }
    return ST_OK;
}

static void first_records(struct mechanics *m) {
    struct sim_truth truth = sim_truth(m->sim);
    struct sim_step pan = sim_step(m->sim, HAL_PAN), tilt = sim_step(m->sim, HAL_TILT);
    m->segment.count = 0;
    on_segment(m, truth.t_us, truth.t_us, m->plant.mirror_start_rev, 0, 0);
    add_mark(m, HAL_PAN, (double)truth.t_us, truth.head_steps[HAL_PAN], pan.counted);
    add_mark(m, HAL_TILT, (double)truth.t_us, truth.head_steps[HAL_TILT], tilt.counted);
    on_laser(m, truth.t_us, false);
}

enum st mechanics_create(struct mechanics *m, const struct twin_config *config,
                         const struct faults *faults, const struct clocks *clock, uint64_t seed,
                         struct errctx *err) {
    memset(m, 0, sizeof *m);
    m->segment.item_size = sizeof(struct mechanics_segment);
    m->mark[HAL_PAN].item_size = m->mark[HAL_TILT].item_size = sizeof(struct mechanics_mark);
    m->laser.item_size = sizeof(struct mechanics_laser);
    m->event.item_size = sizeof(struct mechanics_event);
    m->rig = twin_config_rig(config, true);
    m->clock = clock;
    m->faults = faults;
    m->play_steps = m->rig.pan_backlash_rad / (2 * pi) * m->rig.pan_steps_per_turn;
    double shown_us = (double)clocks_show(clock, 0) * 1e-3;
    m->plant = plant_setup(config, seed);
    if (shown_us > (double)commission_us)
        m->plant.clock_start = (uint32_t)fmod(floor(shown_us) - (double)commission_us, 4e9);
    m->sim = sim_create(&m->plant);
    if (!m->sim)
        return errctx_set(err, ST_INVALID, "these parameters make no cart that moves");
    if (!plant_setup_commission(m->sim, config))
        return errctx_set(err, ST_INVALID,
                          "the controller refuses to be commissioned for this cart");
    sim_advance_to(m->sim, commission_us);
    m->sim_zero_us = (double)sim_now_us(m->sim);
    m->shown_zero_us = shown_us;
    sim_observe(m->sim, &observer, m);
    first_records(m);
    return m->out_of_memory ? errctx_set(err, ST_NOMEM, "simulated cart: out of memory")
                            : let_loose(m, err);
}

void mechanics_destroy(struct mechanics *m) {
    if (m->sim)
        sim_destroy(m->sim);
    free(m->segment.items);
    free(m->mark[HAL_PAN].items);
    free(m->mark[HAL_TILT].items);
    free(m->laser.items);
    free(m->event.items);
    memset(m, 0, sizeof *m);
}

/* ---- the block ---- */

/* Every record begins with its time. */
static double time_of(const struct mechanics_list *list, size_t i) {
    double us;
    memcpy(&us, (const char *)list->items + i * list->item_size, sizeof us);
    return us;
}

/* Number of the last record at or before `us` among `count`; 0 if there is none. */
static size_t find(const struct mechanics_list *list, size_t count, double us) {
    size_t low = 0, high = count;
    while (low + 1 < high) {
        size_t middle = (low + high) / 2;
        if (time_of(list, middle) <= us)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Drops what is before the record that holds at `us`. */
static void forget(struct mechanics_list *list, double us) {
    size_t first = list->count ? find(list, list->count, us) : 0;
    if (first < 64)
        return;
    memmove(list->items, (char *)list->items + first * list->item_size,
            (list->count - first) * list->item_size);
    list->count -= first;
}

/* The step that is about to be given, as two marks behind the record. */
static void add_tail(struct mechanics *m, enum hal_axis axis) {
    struct sim_step step = sim_step(m->sim, axis);
    struct mechanics_mark last = *last_mark(m, axis), *tail = m->mark[axis].items;
    tail += m->mark[axis].count;
    m->tail[axis] = 0;
    if (!step.pending || step.due_us <= last.us)
        return;
    if (step.since_us > last.us)
        tail[m->tail[axis]++] =
            (struct mechanics_mark){step.since_us, last.head_steps, step.counted};
    double motor = sim_truth(m->sim).motor_steps[axis] + (step.positive ? 1 : -1);
    double head = fmin(fmax(last.head_steps, motor), motor + m->plant.axis[axis].backlash);
    tail[m->tail[axis]++] =
        (struct mechanics_mark){step.due_us, head, step.counted + (step.positive ? 1.0 : -1.0)};
}

enum st mechanics_block(struct mechanics *m, int64_t from_ns, int64_t to_ns, struct errctx *err) {
    if (m->out_of_memory)
        return errctx_set(err, ST_NOMEM, "simulated cart: out of memory");
    m->from_ns = from_ns;
    m->to_ns = to_ns;
    m->from_us = us_at(m, from_ns);
    /* The clock is straight within a block: 6 ns off at most. */
    m->us_a_ns =
        to_ns > from_ns ? (us_at(m, to_ns) - m->from_us) / (double)(to_ns - from_ns) : 1e-3;
    double old_us = m->from_us - keep_us;
    forget(&m->segment, old_us);
    forget(&m->mark[HAL_PAN], old_us);
    forget(&m->mark[HAL_TILT], old_us);
    forget(&m->laser, old_us);
    forget(&m->event, old_us);
    add_tail(m, HAL_PAN);
    add_tail(m, HAL_TILT);
    return ST_OK;
}

static double to_us(const struct mechanics *m, double t_ns) {
    return m->from_us + (t_ns - (double)m->from_ns) * m->us_a_ns;
}

/* The disc's turns and speed, rev and rev/s. */
static double disc_rev(const struct mechanics *m, double us, double *out_rps) {
    const struct mechanics_segment *s = m->segment.items;
    s += find(&m->segment, m->segment.count, us);
    double dt_s = (us - s->t0_us) * 1e-6;
    if (out_rps)
        *out_rps = s->rps0 + s->acceleration * dt_s;
    return sim_ripple(&m->plant, s->rev0 + dt_s * (s->rps0 + 0.5 * s->acceleration * dt_s));
}

/* How far the disc has slipped on its shaft, counts. */
static double slipped(const struct mechanics *m, double t_ns) {
    double counts = 0;
    for (size_t i = 0; m->faults && i < m->faults->count; i++) {
        const struct fault *f = &m->faults->list[i];
        if (f->kind == FAULTS_ENCODER_SLIP && t_ns >= (double)f->start_ns)
            counts += f->value;
    }
    return counts;
}

static struct mechanics_mark axis_at(const struct mechanics *m, enum hal_axis axis, double us) {
    const struct mechanics_mark *marks = m->mark[axis].items;
    size_t count = m->mark[axis].count + m->tail[axis], i = find(&m->mark[axis], count, us);
    struct mechanics_mark a = marks[i];
    if (i + 1 >= count || us <= a.us)
        return a;
    struct mechanics_mark b = marks[i + 1];
    double x = (us - a.us) / (b.us - a.us);
    return (struct mechanics_mark){us, a.head_steps + x * (b.head_steps - a.head_steps),
                                   a.counted_steps + x * (b.counted_steps - a.counted_steps)};
}

double mechanics_counts(const struct mechanics *m, double t_ns) {
    return disc_rev(m, to_us(m, t_ns), NULL) * m->rig.encoder_counts_per_turn;
}

struct mechanics_state mechanics_at(const struct mechanics *m, double t_ns) {
    double us = to_us(m, t_ns), rps = 0;
    double counts = disc_rev(m, us, &rps) * m->rig.encoder_counts_per_turn;
    struct mechanics_mark pan = axis_at(m, HAL_PAN, us), tilt = axis_at(m, HAL_TILT, us);
    const struct mechanics_laser *laser = m->laser.items;
    laser += find(&m->laser, m->laser.count, us);
    /* The plant's head lies between motor and motor + play, the rig's at half the play to each
     * side. */
    return (struct mechanics_state){
        .mirror_rad = rig_mirror_angle(&m->rig, counts - slipped(m, t_ns)),
        .mirror_rad_s = 2 * pi * rps,
        .pan_rad = rig_pan_angle(&m->rig, pan.head_steps - m->play_steps / 2, 0),
        .tilt_rad = rig_tilt_angle(&m->rig, tilt.head_steps),
        .pan_motor_steps = pan.counted_steps,
        .tilt_motor_steps = tilt.counted_steps,
        .laser = laser->on && laser->us <= us};
}

bool mechanics_event(const struct mechanics *m, size_t number, struct mechanics_event *out_event,
                     int64_t *out_t_ns) {
    const struct mechanics_event *events = m->event.items;
    double to = to_us(m, (double)m->to_ns);
    for (size_t i = 0; i < m->event.count && events[i].us <= to; i++) {
        if (events[i].us <= m->from_us || number--)
            continue;
        *out_event = events[i];
        *out_t_ns = m->from_ns + (int64_t)llround((events[i].us - m->from_us) / m->us_a_ns);
        return true;
    }
    return false;
}
