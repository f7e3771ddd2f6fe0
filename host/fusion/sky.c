#include "fusion/sky.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

static bool is_none(const struct photo *photo, size_t i) {
    return (photo->flags[i] & PHOTO_NO_RETURN) && isnan(photo->disparity_per_m[i]);
}

static double elevation_at(const struct photo *photo, size_t i) {
    size_t width = (size_t)photo->camera.width_px;
    struct vec3 ray = camera_pinhole_ray(&photo->camera, (double)(i % width), (double)(i / width));
    struct vec3 up = vec3_unit(mat3_mulv(&photo->station_from_cam.r, ray));
    return asin(up.z);
}

/* Collects the region of `seed` into `region`; returns its size. Pixels taken are marked in `seen`.
 */
static size_t flood(const struct photo *photo, size_t seed, uint8_t *seen, uint32_t *region) {
    size_t width = (size_t)photo->camera.width_px, height = (size_t)photo->camera.height_px;
    size_t count = 0;
    region[count++] = (uint32_t)seed;
    seen[seed] = 1;
    for (size_t at = 0; at < count; at++) {
        size_t i = region[at], x = i % width, y = i / width;
        size_t next[4] = {i - 1, i + 1, i - width, i + width};
        bool inside[4] = {x > 0, x + 1 < width, y > 0, y + 1 < height};
        for (int k = 0; k < 4; k++)
            if (inside[k] && !seen[next[k]] && is_none(photo, next[k])) {
                seen[next[k]] = 1;
                region[count++] = (uint32_t)next[k];
            }
    }
    return count;
}

enum st sky_mark(struct photo *photo, double elevation_rad, struct errctx *err) {
    if (isnan(elevation_rad))
        return ST_OK;
    size_t pixels = (size_t)photo->camera.width_px * (size_t)photo->camera.height_px;
    uint8_t *seen = NULL;
    uint32_t *region = NULL;
    for (size_t i = 0; i < pixels; i++) {
        if (!is_none(photo, i) || (seen && seen[i]))
            continue;
        if (!seen) { /* most indoor photographs never need it */
            seen = calloc(pixels, 1);
            region = malloc(pixels * sizeof *region);
            if (!seen || !region) {
                free(seen);
                free(region);
                return errctx_set(err, ST_NOMEM, "no memory to find the sky");
            }
        }
        size_t count = flood(photo, i, seen, region);
        double highest = -2.0; /* below the nadir */
        if (count * 100 >= pixels)
            for (size_t k = 0; k < count; k++)
                highest = fmax(highest, elevation_at(photo, region[k]));
        if (highest < elevation_rad)
            continue;
        for (size_t k = 0; k < count; k++) {
            photo->disparity_per_m[region[k]] = 0.0f;
            photo->flags[region[k]] =
                (uint8_t)((photo->flags[region[k]] & ~PHOTO_NO_RETURN) | PHOTO_SKY);
        }
    }
    free(seen);
    free(region);
    return ST_OK;
}
