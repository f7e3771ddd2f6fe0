/* Panoramas of a simulated sweep as a person would look at them: range, intensity, and where pixels
 * are mixed. Samples are gathered while the sweep runs, each into the pixel of its true direction.
 */
#ifndef SC_TWIN_TWIN_PICTURE_H
#define SC_TWIN_TWIN_PICTURE_H

#include "base/image.h"
#include "base/st.h"
#include "twin/cart.h"

struct twin_picture {
    int32_t width_px, height_px;
    double top_rad,
        step_rad;   /* elevation of the upper edge, angle of a pixel; azimuth falls from pi */
    float *range_m; /* [height][width]; NaN: no range */
    float *intensity;
    uint8_t *state; /* enum twin_picture_state */
};

enum twin_picture_state {
    TWIN_PICTURE_UNSEEN,
    TWIN_PICTURE_NO_RETURN,
    TWIN_PICTURE_DROPPED,
    TWIN_PICTURE_RANGE,
    TWIN_PICTURE_MIXED
};

/* 360 degrees wide, from elevation bottom to top. ST_NOMEM. */
ST_MUST_CHECK enum st twin_picture_create(struct twin_picture *picture, int32_t width_px,
                                          double bottom_rad, double top_rad);
void twin_picture_destroy(struct twin_picture *picture); /* takes zeroed */

/* Puts a sample where its beam went, seen from the cart (station frame). The nearest range stays.
 */
void twin_picture_add(struct twin_picture *picture, const struct cart_shot *shot,
                      const struct pose *world_from_station);

enum twin_picture_style {
    TWIN_PICTURE_STYLE_RANGE,
    TWIN_PICTURE_STYLE_INTENSITY,
    TWIN_PICTURE_STYLE_MIXED
};

/* Draws it into a new RGB image. Small gaps between samples are closed from their neighbours. */
ST_MUST_CHECK enum st twin_picture_draw(const struct twin_picture *picture,
                                        enum twin_picture_style style, struct image_u8 *out_image);

#endif
