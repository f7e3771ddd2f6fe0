#include "raster/raster.h"

#include "raster/raster_band.h"

#include <omp.h>
#include <stdlib.h>
#include <time.h>

/* Keys of one band should stay in a core's cache; narrower bands project their tiles more often. */
#define BAND_KEYS_BYTES (1 << 20)
enum { BAND_ROWS_MIN = 48, BANDS_MAX = 512, BANDS_PER_THREAD = 3 };

static double now_s(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

void raster_scratch_fini(struct raster_scratch *scratch) {
    if (!scratch)
        return;
    free(scratch->tiles);
    free(scratch->bands);
    memset(scratch, 0, sizeof *scratch);
}

struct raster_options raster_options_default(void) {
    struct raster_options options = {.primitive = RASTER_SPLATS,
                                     .filter = RASTER_FILTER_LINEAR,
                                     .skins = RASTER_SKINS_LEAVE_OUT,
                                     .faces = RASTER_FACES_BOTH,
                                     .radius = RASTER_RADIUS_AREA,
                                     .radius_k = 1.3,
                                     .radius_max_px = 64.0,
                                     .falloff = 6.0,
                                     .skin_rgb = {92, 58, 112}};
    return options;
}

/* ---- checks ---- */

static bool positive(double value) {
    return isfinite(value) && value > 0.0;
}

static enum st check_view(const struct raster_view *view, struct errctx *err) {
    if (view->width_px < 1 || view->height_px < 1 || view->width_px > RASTER_MAX_SIDE_PX ||
        view->height_px > RASTER_MAX_SIDE_PX)
        return errctx_set(err, ST_INVALID, "a view of %dx%d pixels; sides go from 1 to %d",
                          (int)view->width_px, (int)view->height_px, RASTER_MAX_SIDE_PX);
    bool numbers = positive(view->fx) && positive(view->fy) && isfinite(view->cx_px) &&
                   isfinite(view->cy_px) && vec3_is_finite(view->eye_m) && view->near_m >= 0.0 &&
                   isfinite(view->near_m);
    for (int i = 0; i < 9; i++)
        numbers = numbers && isfinite(view->cam_from_world_r.m[i]);
    if (!numbers)
        return errctx_set(
            err, ST_INVALID,
            "the view has a number that is not finite or a scale that is not positive");
    if (view->projection == RASTER_ORTHOGRAPHIC && !positive(view->far_m - view->near_m))
        return errctx_set(err, ST_INVALID, "a parallel view needs near < far");
    return ST_OK;
}

static enum st check_options(const struct raster_options *options, struct errctx *err) {
    if (!positive(options->radius_k) || !(options->radius_max_px >= 1.0) ||
        !(options->radius_max_px <= 4096.0))
        return errctx_set(err, ST_INVALID,
                          "splats need radius_k > 0 and radius_max_px from 1 to 4096");
    if (!(options->falloff >= 0.0) || !isfinite(options->falloff) ||
        !(options->push_sigma >= 0.0) || !isfinite(options->push_sigma) ||
        !(options->sigma_unknown_per_m >= 0.0) || !isfinite(options->sigma_unknown_per_m) ||
        options->threads < 0)
        return errctx_set(err, ST_INVALID,
                          "falloff, push-back, sigma and threads must be finite and not negative");
    return ST_OK;
}

static enum st check(const struct raster_input *inputs, size_t input_count,
                     const struct raster_view *view, const struct raster_options *options,
                     const struct raster_target *target, struct errctx *err) {
    enum st st = check_view(view, err);
    if (!st)
        st = check_options(options, err);
    if (st)
        return st;
    if (target->width_px != view->width_px || target->height_px != view->height_px)
        return errctx_set(err, ST_INVALID, "the target has %dx%d pixels, the view %dx%d",
                          (int)target->width_px, (int)target->height_px, (int)view->width_px,
                          (int)view->height_px);
    for (size_t i = 0; i < input_count; i++)
        if (inputs[i].id >= RASTER_MAX_INPUT_ID || inputs[i].tile_count > RASTER_MAX_TILES)
            return errctx_set(err, ST_INVALID,
                              "input %zu has an id or a number of tiles out of range", i);
    return ST_OK;
}

/* ---- tiles in view ---- */

/* A tile of an input, before it is known whether it is seen. */
struct candidate {
    uint32_t input, tile;
};

/* What the frame owns in scratch->tiles. */
struct work {
    struct candidate *candidates;
    struct tile_job *jobs;
    uint8_t *kept;
    size_t candidate_count, job_count;
};

static enum st grow(void **buffer, size_t *bytes, size_t wanted, struct errctx *err) {
    if (*bytes >= wanted)
        return ST_OK;
    void *p = aligned_alloc(64, (wanted + 63) / 64 * 64);
    if (!p)
        return errctx_set(err, ST_NOMEM, "no memory for %zu bytes of drawing buffers", wanted);
    free(*buffer);
    *buffer = p;
    *bytes = wanted;
    return ST_OK;
}

static enum st work_make(const struct raster_input *inputs, size_t input_count,
                         struct raster_scratch *scratch, struct work *out_work,
                         struct errctx *err) {
    size_t n = 0;
    for (size_t i = 0; i < input_count; i++)
        n += inputs[i].tile_count;
    size_t each = sizeof(struct candidate) + sizeof(struct tile_job) + 1;
    if (n > SIZE_MAX / 2 / each)
        return errctx_set(err, ST_NOMEM, "%zu tiles are more than memory can hold", n);
    enum st st = grow(&scratch->tiles, &scratch->tiles_bytes, n * each + 1, err);
    if (st)
        return st;
    struct work work = {.candidate_count = n};
    work.jobs = scratch->tiles; /* the strictest alignment first */
    work.candidates = (struct candidate *)(work.jobs + n);
    work.kept = (uint8_t *)(work.candidates + n);
    struct candidate *next = work.candidates;
    for (size_t i = 0; i < input_count; i++)
        for (size_t k = 0; k < inputs[i].tile_count; k++)
            *next++ = (struct candidate){(uint32_t)i, (uint32_t)k};
    *out_work = work;
    return ST_OK;
}

/* Rejects, and closes the gaps that the rejected leave, in the order given. */
static void work_cull(const struct frame *frame, const struct raster_input *inputs, int threads,
                      struct work *work, struct raster_stats *stats) {
    int64_t n = (int64_t)work->candidate_count;
#pragma omp parallel for num_threads(threads) schedule(static) if (n > 4096)
    for (int64_t i = 0; i < n; i++) {
        struct candidate at = work->candidates[i];
        work->kept[i] = raster_cull_tile(frame, &inputs[at.input], at.tile, &work->jobs[i]) ? 1 : 0;
        work->jobs[i].input = at.input;
    }
    size_t kept = 0;
    for (int64_t i = 0; i < n; i++) {
        struct candidate at = work->candidates[i];
        int64_t valid = inputs[at.input].tiles[at.tile].valid_count;
        stats->samples_total += valid;
        if (!work->kept[i])
            continue;
        stats->samples_drawn += valid;
        if (kept != (size_t)i)
            work->jobs[kept] = work->jobs[i];
        kept++;
    }
    work->job_count = kept;
    stats->tiles_total = n;
    stats->tiles_rejected = n - (int64_t)kept;
}

/* ---- bands ---- */

/* First rows of the bands, of about the same work each: a tile's work lies evenly over its rows.
 * What the bands are does not change the picture. */
static int bands_cut(const struct work *work, int32_t height_px, int32_t rows_max, int threads,
                     int32_t first[BANDS_MAX + 1]) {
    enum { BINS = 1024 };
    static const double row_cost = 2.0; /* clearing and resolving a row of a bin, in tiles' rows */
    double load[BINS], total = 0;
    int bins = height_px < BINS ? (int)height_px : BINS;
    for (int i = 0; i < bins; i++)
        load[i] = row_cost;
    for (size_t i = 0; i < work->job_count; i++) {
        const struct tile_job *job = &work->jobs[i];
        int lo = (int)((int64_t)job->y_lo_px * bins / height_px);
        int hi = (int)((int64_t)job->y_hi_px * bins / height_px);
        lo = lo < bins ? lo : bins - 1;
        for (int k = lo; k <= hi; k++)
            load[k] += 32.0 / (hi - lo + 1);
    }
    for (int i = 0; i < bins; i++)
        total += load[i];
    int wanted = threads == 1 ? 1 : threads * BANDS_PER_THREAD;
    int fewest = (int)((height_px + rows_max - 1) / rows_max);
    wanted = wanted > fewest ? wanted : fewest;
    wanted = wanted < BANDS_MAX / 2 ? wanted : BANDS_MAX / 2;
    int count = 0;
    double share = total / wanted, sum = 0;
    first[count++] = 0;
    for (int i = 0; i < bins && count < BANDS_MAX; i++) {
        int32_t row = (int32_t)((int64_t)i * height_px / bins);
        int32_t rows = row - first[count - 1];
        if (rows > 0 && (sum >= share || rows >= rows_max)) {
            first[count++] = row;
            sum = 0;
        }
        sum += load[i];
    }
    first[count] = height_px;
    return count;
}

/* Draws the jobs first..end - 1 as far as they touch the band; returns bytes read and written. */
static int64_t band_draw(const struct frame *frame, const struct work *work, size_t first,
                         size_t end, const struct band *band) {
    int64_t bytes = 0;
    bool mesh = frame->options->primitive == RASTER_MESH;
    bool only_skins = frame->options->skins == RASTER_SKINS_ONLY;
    bool skins = mesh || frame->options->skins != RASTER_SKINS_LEAVE_OUT;
    int64_t sample_bytes = 4 + 3 + 1 + (frame->push_gain > 0.0f ? 1 : 0);
    int64_t pixel_bytes = frame->rich ? 2 * (8 + 8 + 4 + 2) : 2 * 8;
    for (size_t i = first; i < end; i++) {
        const struct tile_job *job = &work->jobs[i];
        if (job->y_hi_px < band->y0_px || job->y_lo_px >= band->y1_px)
            continue;
        int64_t tested = 0;
        if (!mesh && !only_skins)
            tested += raster_splat_tile(frame, job, band);
        if (skins)
            tested += raster_mesh_tile(frame, job, band);
        bytes += tested * pixel_bytes +
                 sample_bytes * job->tile->width_px * (int64_t)job->tile->height_px;
    }
    return bytes;
}

/* The same input by input, so that what one calls unknown yields to what another has seen. */
static int64_t band_draw_layers(const struct frame *frame, const struct work *work,
                                const struct band *layer, const struct band *all) {
    int64_t bytes = 0;
    for (size_t first = 0; first < work->job_count;) {
        size_t end = first + 1;
        while (end < work->job_count && work->jobs[end].input == work->jobs[first].input)
            end++;
        raster_band_clear(layer);
        bytes += band_draw(frame, work, first, end, layer);
        raster_band_merge(layer, all);
        first = end;
    }
    raster_band_unmark(all);
    return bytes;
}

struct plan {
    int threads, band_count;
    bool layered; /* several inputs whose unknown volumes must yield to what the others saw */
    int32_t first[BANDS_MAX + 1];
    int32_t rows_cap;
    size_t band_bytes; /* of one band's buffers, two of them if layered */
};

static enum st plan_make(const struct frame *frame, const struct work *work, int threads,
                         struct raster_scratch *scratch, struct plan *out_plan,
                         struct errctx *err) {
    const struct raster_view *view = frame->view;
    int32_t rows_max = (int32_t)(BAND_KEYS_BYTES / (8 * (int64_t)view->width_px));
    rows_max = rows_max > BAND_ROWS_MIN ? rows_max : BAND_ROWS_MIN;
    rows_max = rows_max < view->height_px ? rows_max : view->height_px;
    struct plan plan = {.threads = threads};
    plan.band_count = bands_cut(work, view->height_px, rows_max, threads, plan.first);
    int32_t rows_cap = 0;
    for (int i = 0; i < plan.band_count; i++) {
        int32_t rows = plan.first[i + 1] - plan.first[i];
        rows_cap = rows > rows_cap ? rows : rows_cap;
    }
    plan.threads = threads < plan.band_count ? threads : plan.band_count;
    enum raster_skins skins = frame->options->skins;
    plan.layered = (skins == RASTER_SKINS_UNKNOWN || skins == RASTER_SKINS_COLOUR) &&
                   work->job_count > 0 &&
                   work->jobs[0].input != work->jobs[work->job_count - 1].input;
    plan.rows_cap = rows_cap;
    plan.band_bytes = raster_band_bytes(view->width_px, rows_cap, frame->rich);
    *out_plan = plan;
    return grow(&scratch->bands, &scratch->bands_bytes,
                plan.band_bytes * (size_t)(plan.threads * (plan.layered ? 2 : 1)), err);
}

static int nearest_first(const void *a, const void *b) {
    const struct tile_job *x = a, *y = b;
    return (x->nearest < y->nearest) - (x->nearest > y->nearest);
}

/* Few tiles are large on screen: in the order of their distance most hidden pixels end at the
 * comparison of depths. The picture does not depend on it. */
static void order_jobs(struct work *work, const struct plan *plan) {
    enum { FEW = 2048 };
    if (!plan->layered && work->job_count > 1 && work->job_count <= FEW)
        qsort(work->jobs, work->job_count, sizeof *work->jobs, nearest_first);
}

static int64_t plan_run(const struct frame *frame, const struct work *work, const struct plan *plan,
                        struct raster_scratch *scratch, const struct raster_target *target) {
    const uint8_t *bg = frame->options->background_rgb;
    uint32_t background = key_rgba(bg[0], bg[1], bg[2], RASTER_ALPHA_NOTHING);
    int64_t bytes = 0;
#pragma omp parallel for num_threads(plan->threads) schedule(dynamic, 1) reduction(+ : bytes)
    for (int i = 0; i < plan->band_count; i++) {
        size_t mine = (size_t)omp_get_thread_num() * (plan->layered ? 2 : 1);
        uint8_t *memory = (uint8_t *)scratch->bands + plan->band_bytes * mine;
        struct band band =
            raster_band_make(memory, frame->view->width_px, plan->rows_cap, frame->rich);
        band.y0_px = plan->first[i];
        band.y1_px = plan->first[i + 1];
        raster_band_clear(&band);
        if (plan->layered) {
            struct band layer = raster_band_make(memory + plan->band_bytes, band.width_px,
                                                 plan->rows_cap, frame->rich);
            layer.y0_px = band.y0_px;
            layer.y1_px = band.y1_px;
            bytes += band_draw_layers(frame, work, &layer, &band);
        } else {
            bytes += band_draw(frame, work, 0, work->job_count, &band);
        }
        raster_band_resolve(&band, target, background);
    }
    int64_t pixels = (int64_t)target->width_px * target->height_px;
    return bytes + pixels * (8 + (target->rgba ? 4 : 0) + (target->depth ? 4 : 0) +
                             (target->item ? 8 : 0) + (target->count ? 2 : 0));
}

enum st raster_draw(const struct raster_input *inputs, size_t input_count,
                    const struct raster_view *view, const struct raster_options *options,
                    const struct raster_target *target, struct raster_scratch *scratch,
                    struct raster_stats *out_stats, struct errctx *err) {
    double start_s = now_s();
    enum st st = check(inputs, input_count, view, options, target, err);
    if (st)
        return st;
    struct raster_stats stats = {0};
    struct frame frame;
    raster_cull_frame(view, options, target->item || target->count, &frame);
    int threads = options->threads > 0 ? options->threads : omp_get_max_threads();
    struct work work;
    st = work_make(inputs, input_count, scratch, &work, err);
    if (st)
        return st;
    double cull_s = now_s();
    work_cull(&frame, inputs, threads, &work, &stats);
    stats.reject_s = now_s() - cull_s;
    struct plan plan;
    st = plan_make(&frame, &work, threads, scratch, &plan, err);
    if (st)
        return st;
    order_jobs(&work, &plan);
    double draw_s = now_s();
    stats.bytes_touched = plan_run(&frame, &work, &plan, scratch, target);
    double end_s = now_s();
    stats.draw_s = end_s - draw_s;
    stats.total_s = end_s - start_s;
    if (out_stats)
        *out_stats = stats;
    return ST_OK;
}
