/* Colour for samples that have none: the shape itself, lit by a sky and a low sun. */
#ifndef SC_FUSION_SHADE_H
#define SC_FUSION_SHADE_H

#include "base/photo.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Fills rgb of every pixel with a disparity: a bright sky, and a sun that is fixed in the world, so
 * that a surface has one colour in all photographs; tinted by which way it faces (up: warm, down:
 * cool), so that floors, walls and ceilings tell apart. Sky gets a dark blue, nothing else a
 * colour. Normals are means over 5 x 5 pixels of one surface. */
void shade_photo(struct photo *photo, const struct mat3 *world_from_station_r);

#ifdef __cplusplus
}
#endif
#endif
