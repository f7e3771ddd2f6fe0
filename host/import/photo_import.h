/* A colour image with a depth or disparity map and a camera, as a 3D photograph. */
#ifndef SC_IMPORT_PHOTO_IMPORT_H
#define SC_IMPORT_PHOTO_IMPORT_H

#include "base/camera.h"
#include "base/image.h"
#include "base/photo.h"
#include "base/pose.h"
#include "base/st.h"

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a stored number s means. d = s * scale + offset first, then: */
enum photo_import_kind {
    PHOTO_IMPORT_DEPTH,    /* Z along the optical axis, m: disparity 1 / d */
    PHOTO_IMPORT_RANGE,    /* along the pixel's ray, m: disparity |ray| / d */
    PHOTO_IMPORT_DISPARITY /* of a rectified stereo pair, px: Z = f B / d, disparity d / (f B) */
};

struct photo_import_map {
    enum photo_import_kind kind;
    double scale;  /* m or px a stored unit; 0: the default, 1e-3 (millimetres) or 1 */
    double offset; /* m or px; for disparities the difference of the principal points */
    /* The stored value that means none; NaN and values <= 0 after scaling do too. */
    double unknown;
    double baseline_m; /* DISPARITY; 0: unknown, all lengths are then in baselines */
    double step; /* stored values are whole multiples of this, in stored units; 0: not known */
    /* DISPARITY: restore what the step took away (see dequantise.h); needs a step. */
    bool dequantise;
    /* Noise beyond what the step says, one standard deviation; 0: the default, NaN: none.
     * sigma_per_m grows with the square, sigma(Z) = k Z^2, as triangulating cameras show. */
    double sigma_m;     /* DEPTH, RANGE; default 1 mm */
    double sigma_per_m; /* DEPTH, RANGE, 1/m; default 0.0015 for DEPTH, none for RANGE */
    double sigma_px;    /* DISPARITY; default 0.25 */
};

/* All views; nothing is taken over. */
struct photo_import {
    const struct image_u8 *rgb;  /* 3 channels */
    const struct image_f32 *map; /* the same size, seen by the same camera */
    struct camera camera;        /* of the image; with distortion if it has some */
    struct pose station_from_cam;
    struct photo_import_map values;
};

/* What the import decided and found. */
struct photo_import_result {
    bool relative;    /* lengths are in baselines of unknown length */
    bool undistorted; /* image and map were resampled */
    int64_t known_pixels, unknown_pixels, unseen_pixels; /* unseen: outside the distorted image */
    double nearest_m, farthest_m;                        /* Z */
    double rounding_sigma; /* rms of what the step leaves unknown, m or px as the map; 0: no step */
};

/* Makes the photograph. A map value that is unknown is PHOTO_DROPPED and NaN. With distortion,
 * image and map are resampled to a pinhole of the same focal lengths and principal point: colour by
 * bicubic interpolation, disparity (of its kind: 1/Z) bilinearly where the four neighbours agree
 * with a plane within their noise and a twentieth, else from the nearest, so that no surface
 * appears between two; a pixel that the distorted image does not show has no flags and no surface.
 * Confidence from the noise given and, for a dequantised map, from dequantise(); a stored step that
 * is not restored counts as step / sqrt(12). ST_INVALID with one line for sizes that differ, bad
 * numbers or a map without a known value; ST_NOMEM. Free with photo_destroy(). */
ST_MUST_CHECK enum st photo_import_make(const struct photo_import *in, struct photo *out_photo,
                                        struct photo_import_result *out_result, struct errctx *err);

#ifdef __cplusplus
}
#endif
#endif
