/* Mixed pixels: clusters of samples whose beam an edge has split, and which lie between surfaces.
 *
 * A surface is borne out by its neighbours; what floats between two is not, except along the edge,
 * where a scan line may run and split every beam in the same way. So the neighbourhood is asked how
 * many share the candidate's plane, from how many of eight directions a surface leads up to it, and
 * whether something nearer is beside it: in front of everything a thin thing may stand alone,
 * behind an edge nothing does. */
#include "fusion/resolve_work.h"

#include <stdlib.h>
#include <string.h>

/* Quick test on the 3 x 3 neighbourhood: do the four lines through the pixel bend? */
static bool smooth_here(const struct resolve_work *w, int32_t x, int32_t y) {
    static const int32_t lines[4][2] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
    const struct candidate *me = neighbour(w, x, y);
    float slope = 0.1f * w->rule.slope_per_px * me->disparity_per_m;
    for (int k = 0; k < 4; k++) {
        const struct candidate *a = neighbour(w, x - lines[k][0], y - lines[k][1]);
        const struct candidate *b = neighbour(w, x + lines[k][0], y + lines[k][1]);
        if (!a || !b)
            return false;
        float off = a->disparity_per_m + b->disparity_per_m - 2.0f * me->disparity_per_m;
        float var = a->sigma_per_m * a->sigma_per_m + b->sigma_per_m * b->sigma_per_m +
                    4.0f * me->sigma_per_m * me->sigma_per_m;
        if (fabsf(off) > (float)w->params->agree_sigmas * sqrtf(var) + slope)
            return false;
    }
    return true;
}

/* Where neighbour c lies along a direction, and how much its disparity differs from the
 * candidate's, less what the surface's gradient explains across that direction. */
static float along(const struct candidate *me, const struct candidate *c,
                   const int32_t direction[2], float *out_step) {
    float u = c->u_px - me->u_px, v = c->v_px - me->v_px;
    float dx = (float)direction[0], dy = (float)direction[1], t = u * dx + v * dy;
    float part = t / (dx * dx + dy * dy);
    *out_step = c->disparity_per_m - me->disparity_per_m - me->gu * (u - part * dx) -
                me->gv * (v - part * dy);
    return t;
}

/* In how many of eight directions a surface leads up to the candidate: what lies one and two strip
 * widths away foretells it, on a straight line in disparity. */
static int directions_supported(const struct resolve_work *w, int32_t x, int32_t y) {
    static const int32_t directions[8][2] = {{1, 0},  {1, 1},   {0, 1},  {-1, 1},
                                             {-1, 0}, {-1, -1}, {0, -1}, {1, -1}};
    const struct candidate *me = neighbour(w, x, y);
    float bend = 0.03f * w->rule.slope_per_px * me->disparity_per_m * (float)w->strip;
    int supported = 0;
    for (int k = 0; k < 8; k++) {
        int32_t dx = directions[k][0] * w->strip, dy = directions[k][1] * w->strip;
        const struct candidate *a = neighbour(w, x + dx, y + dy);
        const struct candidate *b = neighbour(w, x + 2 * dx, y + 2 * dy);
        if (!a || !b)
            continue;
        float da, ta = along(me, a, directions[k], &da);
        float db, tb = along(me, b, directions[k], &db);
        if (!(tb - ta > 0.25f * (float)w->strip))
            continue;
        float wa = tb / (tb - ta), wb = -ta / (tb - ta);
        float off = -wa * da - wb * db;
        float var = me->sigma_per_m * me->sigma_per_m + wa * wa * a->sigma_per_m * a->sigma_per_m +
                    wb * wb * b->sigma_per_m * b->sigma_per_m;
        float slack =
            bend + 0.3f * fabsf((db - da) / (tb - ta)); /* rough ground at a grazing angle */
        supported += fabsf(off) <= (float)w->params->agree_sigmas * sqrtf(var) + slack;
    }
    return supported;
}

/* What surface lies on one side of the candidate, up to a strip's width away: bit 0 one clearly
 * nearer, bit 1 one clearly farther. What is no surface itself (leaves, grass) says nothing about
 * edges. */
static unsigned side_of(const struct resolve_work *w, int32_t x, int32_t y, int32_t dx,
                        int32_t dy) {
    const struct candidate *me = neighbour(w, x, y);
    unsigned found = 0;
    for (int32_t k = 1; k <= w->strip + 1; k++) {
        int32_t u = x + k * dx, v = y + k * dy;
        const struct candidate *c = neighbour(w, u, v);
        if (!c || w->support[(size_t)v * (size_t)w->width + (size_t)u] < 2)
            continue;
        float step = c->disparity_per_m - me->disparity_per_m, room = noise_of(w, me, c);
        found |= step > room ? 1u : step < -room ? 2u : 0u;
    }
    return found;
}

/* Whether the candidate lies across an edge: nearer on one side, farther on the other. */
static bool between(const struct resolve_work *w, int32_t x, int32_t y) {
    static const int32_t lines[4][2] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
    for (int k = 0; k < 4; k++) {
        unsigned a = side_of(w, x, y, lines[k][0], lines[k][1]);
        unsigned b = side_of(w, x, y, -lines[k][0], -lines[k][1]);
        if ((a & 1u && b & 2u) || (a & 2u && b & 1u))
            return true;
    }
    return false;
}

/* What the neighbourhood says of a candidate. */
struct evidence {
    int of;      /* pixels looked at */
    int there;   /* of those, with a candidate */
    int agree;   /* of those, on the candidate's own plane */
    bool beside; /* a surface clearly nearer is among them */
};

static struct evidence evidence_of(const struct resolve_work *w, int32_t x, int32_t y) {
    const struct candidate *me = neighbour(w, x, y);
    float slope = w->rule.slope_per_px * me->disparity_per_m;
    int32_t reach = w->strip < 2 ? 2 : w->strip;
    struct evidence e = {.of = (int)((2 * reach + 1) * (2 * reach + 1) - 1)};
    for (int32_t v = y - reach; v <= y + reach; v++)
        for (int32_t u = x - reach; u <= x + reach; u++) {
            const struct candidate *c = u != x || v != y ? neighbour(w, u, v) : NULL;
            if (!c)
                continue;
            e.there++;
            float du = c->u_px - me->u_px, dv = c->v_px - me->v_px;
            float room = slope * (fabsf(du) + fabsf(dv)), noise = noise_of(w, me, c);
            float step = c->disparity_per_m - me->disparity_per_m;
            float off = step - me->gu * du - me->gv * dv;
            e.agree += fabsf(off) <= noise + 0.4f * room;
            e.beside |=
                step > noise + room && w->support[(size_t)v * (size_t)w->width + (size_t)u] >= 3;
        }
    return e;
}

/* Whether the candidate has less than half of what the pixel's samples weigh. */
static bool is_minority(const struct resolve_work *w, size_t i) {
    const struct cluster_pixel *pixel = w->image->px + i;
    float all = pixel->lost_weight;
    for (uint32_t k = 0; k < pixel->layer_count; k++)
        all += pixel->layers[k].weight;
    return resolve_heaviest(w, i)->weight < 0.5f * all;
}

/* Whether three candidates lie on a line in disparity: one surface, however steep. */
static bool in_line(const struct resolve_work *w, const struct candidate *a,
                    const struct candidate *b, const struct candidate *c, bool vertical) {
    if (!a || !b || !c)
        return false;
    float t = vertical ? c->v_px - a->v_px : c->u_px - a->u_px;
    float s = vertical ? b->v_px - a->v_px : b->u_px - a->u_px;
    if (!(fabsf(t) > 1.0f))
        return false;
    float part = s / t, slope = (c->disparity_per_m - a->disparity_per_m) / t;
    float off = b->disparity_per_m - a->disparity_per_m - slope * s;
    float var = b->sigma_per_m * b->sigma_per_m +
                (1.0f - part) * (1.0f - part) * a->sigma_per_m * a->sigma_per_m +
                part * part * c->sigma_per_m * c->sigma_per_m;
    /* Two tenths of a pixel of the slope itself: places are known no better. */
    return fabsf(off) <= (float)w->params->agree_sigmas * sqrtf(var) + 0.2f * fabsf(slope);
}

/* Whether the surface of the candidate at (x, y) goes on at its neighbour (u, v): within the room
 * for slopes, on the candidate's plane, or on a line with the next pixel at either end. */
static bool goes_on(const struct resolve_work *w, int32_t x, int32_t y, int32_t u, int32_t v) {
    const struct candidate *me = neighbour(w, x, y), *c = neighbour(w, u, v);
    float du = c->u_px - me->u_px, dv = c->v_px - me->v_px;
    float room = w->rule.slope_per_px * me->disparity_per_m * (fabsf(du) + fabsf(dv));
    float noise = noise_of(w, me, c), step = c->disparity_per_m - me->disparity_per_m;
    return fabsf(step) <= noise + room ||
           fabsf(step - me->gu * du - me->gv * dv) <= noise + 0.4f * room ||
           in_line(w, me, c, neighbour(w, 2 * u - x, 2 * v - y), u == x) ||
           in_line(w, neighbour(w, 2 * x - u, 2 * y - v), me, c, u == x);
}

/* Samples on one side only, more than 0.2 px from the centre on average, none in the pixel, and
 * beyond it another surface or the sky. */
bool mixed_overhangs(const struct resolve_work *w, int32_t x, int32_t y) {
    const struct cluster_layer *layer =
        resolve_heaviest(w, (size_t)y * (size_t)w->width + (size_t)x);
    if (!layer || layer->count & CLUSTER_OWN)
        return false;
    float off_px[2] = {layer->du_px, layer->dv_px};
    for (int k = 0; k < 2; k++) {
        if (!(fabsf(off_px[k]) > 0.2f))
            continue;
        int32_t step = off_px[k] > 0.0f ? -1 : 1;
        int32_t u = x + (k ? 0 : step), v = y + (k ? step : 0);
        if (u < 0 || v < 0 || u >= w->width || v >= w->height)
            continue;
        const struct cluster_pixel *beyond =
            w->image->px + ((size_t)v * (size_t)w->width + (size_t)u);
        if (neighbour(w, u, v) ? !goes_on(w, x, y, u, v) : beyond->none_weight > 0.0f)
            return true;
    }
    return false;
}

/* What is refused. Where a surface leads up to the candidate from two sides at most (a split beam's
 * cluster has the two along the edge, a straight border of a surface three or more, a corner
 * three):
 * - a range that hardly any neighbour shares and most contradict;
 * - what has a nearer surface beside it;
 * - what few neighbours share and most of the pixel's own samples contradict;
 * - what lies between a nearer and a farther surface (also by steps of a few sigma, which the
 *   second line takes for slopes), unless two thirds of the neighbours bear it out.
 * And what is known from beyond the pixel only, and faintly, where its surface ends. */
static bool floats(const struct resolve_work *w, int32_t x, int32_t y) {
    size_t i = (size_t)y * (size_t)w->width + (size_t)x;
    uint8_t support = w->support[i];
    if (support == 8)
        return false;
    struct evidence e = evidence_of(w, x, y);
    double share = (double)e.agree / e.of;
    if (support <= 2 &&
        ((share < 0.1 && 2 * e.agree < e.there) || e.beside || (share < 0.5 && is_minority(w, i)) ||
         (share < 2.0 / 3.0 && between(w, x, y))))
        return true;
    return resolve_heaviest(w, i)->weight < 0.6f && mixed_overhangs(w, x, y);
}

/* One round over the dirty pixels: each judges by the candidates as they were, so order and threads
 * do not matter. Returns how many were refused and leaves in `dirty` what has to be judged again.
 */
static int64_t refuse_round(struct resolve_work *w, uint8_t *dirty, uint8_t *verdict) {
    size_t width = (size_t)w->width;
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < w->height; y++) {
        size_t row = (size_t)y * width;
        for (int32_t x = -1; (x = resolve_next_mark(dirty + row, x + 1, w->width)) < w->width;) {
            int supported = !neighbour(w, x, y)    ? 0
                            : smooth_here(w, x, y) ? 8
                                                   : directions_supported(w, x, y);
            w->support[row + (size_t)x] = (uint8_t)supported;
        }
    }
#pragma omp parallel for schedule(dynamic, 8)
    for (int32_t y = 0; y < w->height; y++) {
        size_t row = (size_t)y * width;
        for (int32_t x = -1; (x = resolve_next_mark(dirty + row, x + 1, w->width)) < w->width;)
            verdict[row + (size_t)x] = neighbour(w, x, y) && floats(w, x, y);
    }
    int64_t refused = 0;
    memset(dirty, 0, width * (size_t)w->height);
    for (int32_t y = 0; y < w->height; y++) {
        uint8_t *row = verdict + (size_t)y * width;
        for (int32_t x = -1; (x = resolve_next_mark(row, x + 1, w->width)) < w->width;) {
            size_t i = (size_t)y * width + (size_t)x;
            row[x] = 0;
            w->refused[i]++;
            resolve_choose(w, i);
            resolve_mark_around(w, dirty, x, y);
            refused++;
        }
    }
    return refused;
}

enum st mixed_refuse(struct resolve_work *w, int64_t *out_refused) {
    enum { ROUNDS = 64 }; /* each undoes what the one before bore out; some 20 are used */
    size_t pixels = (size_t)w->width * (size_t)w->height;
    uint8_t *dirty = malloc(pixels), *verdict = calloc(pixels, 1);
    enum st st = dirty && verdict ? ST_OK : ST_NOMEM;
    if (!st) {
        memset(dirty, 1, pixels);
        for (int round = 0; round < ROUNDS; round++) {
            int64_t refused = refuse_round(w, dirty, verdict);
            *out_refused += refused;
            if (!refused)
                break;
            resolve_gradients(w, dirty);
        }
    }
    free(dirty);
    free(verdict);
    return st;
}
