/* Layers: a tile's samples in colours that show one of their properties. */
#ifndef SC_RENDER_VIEW_LAYER_H
#define SC_RENDER_VIEW_LAYER_H

#include "base/photo.h"

#ifdef __cplusplus
extern "C" {
#endif

enum view_layer {
    VIEW_LAYER_COLOUR,
    VIEW_LAYER_INTENSITY,  /* brightness of the photograph (BT.601); of a scan without a camera
                              that is what the laser returned */
    VIEW_LAYER_RANGE,      /* near (warm) to far (cold), by the logarithm from 0.5 to 50 m */
    VIEW_LAYER_CONFIDENCE, /* standard deviation of the range: 1 mm (green) to 100 mm (red), grey
                              where it is not known */
    VIEW_LAYER_NORMALS     /* world directions: x red, y green, z blue */
};
enum { VIEW_LAYERS = 5 };

const char *view_layer_name(enum view_layer layer);

/* Colours [height][width][3] of a tile with its apron, rows without gaps; `rgb` are the samples'
 * own. Cost: some 20 operations a sample. */
void view_layer_shade(enum view_layer layer, const struct tile *tile, const uint8_t *rgb,
                      int32_t width_px, int32_t height_px, uint8_t *out_rgb);

#ifdef __cplusplus
}
#endif
#endif
