/* The layered list of one pixel: which surfaces the samples that touch it belong to.
 *
 * Nyland et al. 1999, section 4.3: each pixel keeps the samples that touch it with their weights;
 * clustering the list by disparity keeps the two sides of a silhouette apart, and the weighted mean
 * of the heaviest cluster becomes the pixel's disparity. Here the list is clustered as it grows, so
 * that its memory is bounded whatever the number of samples: a sample joins the layer whose mean it
 * agrees with, or opens one, or replaces the lightest. The outcome depends on the order of the
 * samples, which is the stream's, never on threads.
 *
 * Two samples agree if their disparities differ by less than
 *   k sigma + delta * slope * |offset between them in pixels|
 * : noise, plus what a surface inclined to the view changes between two places of one pixel,
 * |d delta / du| = delta tan(theta) / f, so slope = tan(theta_max) / f. */
#ifndef SC_FUSION_CLUSTER_H
#define SC_FUSION_CLUSTER_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CLUSTER_LAYERS = 4 }; /* near, far, what floats between them, one more */

/* One layer: sums over the samples that agreed. k is the weight of a sample at the pixel, 0..1. */
struct cluster_layer {
    float weight;          /* sum k */
    float var_sum;         /* sum k^2 sigma^2, so the mean's variance is var_sum / weight^2 */
    float disparity_per_m; /* mean, weighted with k */
    float du_px, dv_px;    /* mean place of the samples relative to the pixel's centre */
    uint16_t rgb[3];       /* mean, 8.8 fixed point */
    uint16_t count; /* samples, saturates at 32767; bit 15: one lies inside the pixel itself */
};
enum { CLUSTER_OWN = 1u << 15, CLUSTER_COUNT_MAX = 32767 };

struct cluster_pixel {
    float none_weight;    /* sum k of samples without return */
    float dropped_weight; /* sum k of dropped samples */
    float lost_weight;    /* sum k of layers that were replaced for lack of room */
    uint32_t layer_count;
    struct cluster_layer layers[CLUSTER_LAYERS];
};

/* One sample at one pixel. */
struct cluster_entry {
    float weight; /* k > 0 */
    float disparity_per_m, sigma_per_m;
    float du_px, dv_px;
    uint8_t rgb[3];
    bool own; /* the sample lies inside the pixel, not only near it */
};

struct cluster_rule {
    float sigmas;       /* k of the threshold */
    float slope_per_px; /* tan(theta_max) / f */
};

/* Adds one sample. Cost: one comparison a layer. */
void cluster_add(struct cluster_pixel *pixel, const struct cluster_entry *entry,
                 const struct cluster_rule *rule);

/* Joins layers that agree with each other (noise may have opened two for one surface) by the rule,
 * given the surface's gradient (d disparity / d px), and sorts what is left by weight, heaviest
 * first; equal weights: nearest first. Slope allowance is replaced by the gradient where it is not
 * NaN. */
void cluster_merge(struct cluster_pixel *pixel, const struct cluster_rule *rule, float gu_per_m_px,
                   float gv_per_m_px);

/* Standard deviation of a layer's mean from its samples alone, 1/m. */
float cluster_sigma(const struct cluster_layer *layer);

#ifdef __cplusplus
}
#endif
#endif
