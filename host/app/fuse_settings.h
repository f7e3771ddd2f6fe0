/* What --quality means for fusion: each figure that the three settings differ in. */
#ifndef SC_APP_FUSE_SETTINGS_H
#define SC_APP_FUSE_SETTINGS_H

#include "fusion/cull.h"
#include "fusion/layer.h"
#include "fusion/pack.h"
#include "fusion/reproject.h"
#include "fusion/resolve.h"
#include "site/calib.h"

#include <stdbool.h>

enum fuse_quality { FUSE_PREVIEW, FUSE_FIELD, FUSE_SURVEY };

struct fuse_settings {
    enum fuse_quality quality;
    double pixel_spacings; /* size of a pixel of a cube face, in sample spacings */
    int32_t face_max_px;
    double frame_scale;            /* photographs from frames: size relative to the frame */
    double splat_spacings;         /* half width of a splat, in sample spacings; at least a pixel */
    bool reproject;                /* skins by reprojection, culling: else neither */
    enum calib_status calibration; /* 0: the best there is */
    bool faces_always;             /* cube faces even where there are frames */
    size_t cache_samples;
    double sigma_m;      /* of ranges; 0: measured */
    double pose_sigma_m; /* of every station; 0: as the stations say */
    double sigma_angle_rad, sigma_system_m;
    struct layer_params layer;
    struct resolve_params resolve;
    struct reproject_params skins;
    struct cull_params cull;
    struct pack_params pack;
};

struct fuse_settings fuse_settings_make(enum fuse_quality quality);
const char *fuse_settings_name(enum fuse_quality quality);
/* False for a name that is none. */
bool fuse_settings_parse(const char *name, enum fuse_quality *out_quality);

#endif
