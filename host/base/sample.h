/* A range sample with its direction: what an import decodes a foreign scan into and what the rig model makes
 * of a head sample. */
#ifndef SC_BASE_SAMPLE_H
#define SC_BASE_SAMPLE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum sample_flag {
    SAMPLE_NO_RETURN = 1u << 0, /* the beam met nothing in range; range_m is NaN */
    SAMPLE_DROPPED = 1u << 1,   /* nothing usable; range_m is NaN */
    SAMPLE_INTENSITY = 1u << 2, /* intensity is meaningful */
    SAMPLE_COLOUR = 1u << 3     /* rgb is meaningful */
};

/* Direction in the station frame: x = cos(el) cos(az), y = cos(el) sin(az), z = sin(el), scaled by range
 * and added to the stream's origin. 40 bytes, the layout of a "polar" chunk (little-endian). */
struct polar_sample {
    double azimuth_rad;   /* -pi..pi */
    double elevation_rad; /* -pi/2..pi/2 */
    float range_m;        /* NaN where there is none */
    float intensity;      /* 0..1 */
    uint32_t row, column; /* place in the instrument's own grid */
    uint8_t flags;        /* enum sample_flag */
    uint8_t rgb[3];
    uint32_t reserved;    /* 0 */
};

#ifdef __cplusplus
}
#endif
#endif
