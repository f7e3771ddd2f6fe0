#include "fusion/cluster.h"

#include <math.h>
#include <string.h>

/* Square root of 2, rounded up: two samples of equal noise differ by that much more than one. */
static const float both_sides = 1.4143f;

static float absf(float x) {
    return x < 0.0f ? -x : x;
}

static void layer_open(struct cluster_layer *layer, const struct cluster_entry *e) {
    layer->weight = e->weight;
    layer->var_sum = e->weight * e->weight * e->sigma_per_m * e->sigma_per_m;
    layer->disparity_per_m = e->disparity_per_m;
    layer->du_px = e->du_px;
    layer->dv_px = e->dv_px;
    for (int c = 0; c < 3; c++)
        layer->rgb[c] = (uint16_t)(e->rgb[c] << 8);
    layer->count = (uint16_t)(1u | (e->own ? CLUSTER_OWN : 0u));
}

static void layer_join(struct cluster_layer *layer, const struct cluster_entry *e) {
    layer->weight += e->weight;
    float share = e->weight / layer->weight;
    layer->var_sum += e->weight * e->weight * e->sigma_per_m * e->sigma_per_m;
    layer->disparity_per_m += share * (e->disparity_per_m - layer->disparity_per_m);
    layer->du_px += share * (e->du_px - layer->du_px);
    layer->dv_px += share * (e->dv_px - layer->dv_px);
    for (int c = 0; c < 3; c++) {
        float mean = (float)layer->rgb[c];
        layer->rgb[c] = (uint16_t)(mean + share * ((float)(e->rgb[c] << 8) - mean) + 0.5f);
    }
    if ((layer->count & CLUSTER_COUNT_MAX) < CLUSTER_COUNT_MAX)
        layer->count++;
    if (e->own)
        layer->count |= CLUSTER_OWN;
}

void cluster_add(struct cluster_pixel *pixel, const struct cluster_entry *entry,
                 const struct cluster_rule *rule) {
    float noise = both_sides * rule->sigmas * entry->sigma_per_m;
    float slope = rule->slope_per_px * entry->disparity_per_m;
    /* The nearest layer; but what is well within a heavier one's noise belongs there, or noise would
     * split a surface in two halves. */
    struct cluster_layer *best = NULL, *core = NULL;
    float best_misfit = INFINITY;
    for (uint32_t i = 0; i < pixel->layer_count; i++) {
        struct cluster_layer *layer = pixel->layers + i;
        float away_px = absf(entry->du_px - layer->du_px) + absf(entry->dv_px - layer->dv_px);
        float misfit = absf(entry->disparity_per_m - layer->disparity_per_m);
        float room = noise + slope * away_px;
        if (!(misfit <= room))
            continue;
        if (misfit < best_misfit) {
            best = layer;
            best_misfit = misfit;
        }
        if (misfit <= 0.75f * room && (!core || layer->weight > core->weight))
            core = layer;
    }
    if (core && core->weight > best->weight)
        best = core;
    if (best) {
        layer_join(best, entry);
        return;
    }
    if (pixel->layer_count < CLUSTER_LAYERS) {
        layer_open(pixel->layers + pixel->layer_count++, entry);
        return;
    }
    struct cluster_layer *lightest = pixel->layers;
    for (int i = 1; i < CLUSTER_LAYERS; i++)
        if (pixel->layers[i].weight < lightest->weight)
            lightest = pixel->layers + i;
    if (entry->weight > lightest->weight) {
        pixel->lost_weight += lightest->weight;
        layer_open(lightest, entry);
    } else {
        pixel->lost_weight += entry->weight;
    }
}

float cluster_sigma(const struct cluster_layer *layer) {
    return sqrtf(layer->var_sum) / layer->weight;
}

/* Typical sigma of one sample of the layer: var_sum / weight^2 = sigma^2 / n_eff, and n_eff is near
 * the count for samples near the pixel; the bound sigma^2 <= var_mean * count is what is used. */
static float sample_sigma(const struct cluster_layer *layer) {
    return cluster_sigma(layer) * sqrtf((float)(layer->count & CLUSTER_COUNT_MAX));
}

static bool agree(const struct cluster_layer *a, const struct cluster_layer *b,
                  const struct cluster_rule *rule, float gu, float gv) {
    float du = b->du_px - a->du_px, dv = b->dv_px - a->dv_px;
    float sa = sample_sigma(a), sb = sample_sigma(b);
    float noise = rule->sigmas * (sa > sb ? sa : sb);
    float step = b->disparity_per_m - a->disparity_per_m;
    if (isnan(gu) || isnan(gv)) {
        float nearer =
            a->disparity_per_m > b->disparity_per_m ? a->disparity_per_m : b->disparity_per_m;
        return absf(step) <= noise + rule->slope_per_px * nearer * (absf(du) + absf(dv));
    }
    return absf(step - gu * du - gv * dv) <= noise;
}

static void layer_merge(struct cluster_layer *a, const struct cluster_layer *b) {
    float weight = a->weight + b->weight, share = b->weight / weight;
    a->weight = weight;
    a->var_sum += b->var_sum;
    a->disparity_per_m += share * (b->disparity_per_m - a->disparity_per_m);
    a->du_px += share * (b->du_px - a->du_px);
    a->dv_px += share * (b->dv_px - a->dv_px);
    for (int c = 0; c < 3; c++)
        a->rgb[c] =
            (uint16_t)((float)a->rgb[c] + share * ((float)b->rgb[c] - (float)a->rgb[c]) + 0.5f);
    uint32_t count = (a->count & CLUSTER_COUNT_MAX) + (uint32_t)(b->count & CLUSTER_COUNT_MAX);
    if (count > CLUSTER_COUNT_MAX)
        count = CLUSTER_COUNT_MAX;
    a->count = (uint16_t)(count | ((a->count | b->count) & CLUSTER_OWN));
}

static bool before(const struct cluster_layer *a, const struct cluster_layer *b) {
    if (a->weight != b->weight)
        return a->weight > b->weight;
    return a->disparity_per_m > b->disparity_per_m;
}

static void sort_layers(struct cluster_pixel *pixel) {
    for (uint32_t i = 1; i < pixel->layer_count; i++) {
        struct cluster_layer layer = pixel->layers[i];
        uint32_t j = i;
        for (; j > 0 && before(&layer, pixel->layers + j - 1); j--)
            pixel->layers[j] = pixel->layers[j - 1];
        pixel->layers[j] = layer;
    }
}

void cluster_merge(struct cluster_pixel *pixel, const struct cluster_rule *rule, float gu_per_m_px,
                   float gv_per_m_px) {
    if (pixel->layer_count < 2)
        return;
    sort_layers(pixel);
    for (uint32_t i = 0; i + 1 < pixel->layer_count; i++) {
        for (uint32_t j = i + 1; j < pixel->layer_count;) {
            if (!agree(pixel->layers + i, pixel->layers + j, rule, gu_per_m_px, gv_per_m_px)) {
                j++;
                continue;
            }
            layer_merge(pixel->layers + i, pixel->layers + j);
            pixel->layer_count--;
            memmove(pixel->layers + j, pixel->layers + j + 1,
                    (pixel->layer_count - j) * sizeof pixel->layers[0]);
            j = i + 1; /* the mean has moved: look again */
        }
    }
    sort_layers(pixel);
}
