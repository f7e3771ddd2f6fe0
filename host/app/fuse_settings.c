#include "app/fuse_settings.h"

#include <string.h>

static const char *const names[] = {"preview", "field", "survey"};

const char *fuse_settings_name(enum fuse_quality quality) {
    return names[quality];
}

bool fuse_settings_parse(const char *name, enum fuse_quality *out_quality) {
    for (int i = 0; i < 3; i++)
        if (!strcmp(name, names[i])) {
            *out_quality = (enum fuse_quality)i;
            return true;
        }
    return false;
}

struct fuse_settings fuse_settings_make(enum fuse_quality quality) {
    struct fuse_settings s = {.quality = quality,
                              .pixel_spacings = 1.0,
                              .face_max_px = 2048,
                              .frame_scale = 1.0,
                              .splat_spacings = 1.2,
                              .reproject = true,
                              .cache_samples = 32u << 20,
                              .sigma_angle_rad = 5e-5,  /* a thirtieth of an encoder count */
                              .sigma_system_m = 0.0007, /* the detector, with the echo's strength */
                              .layer = layer_params_default(),
                              .resolve = resolve_params_default(),
                              .skins = reproject_params_default(),
                              .cull = cull_params_default(),
                              .pack = pack_params_default()};
    switch (quality) {
    case FUSE_PREVIEW: /* what the cart shows while the crew packs up */
        s.pixel_spacings = 2.0;
        s.face_max_px = 1024;
        s.frame_scale = 0.5;
        s.splat_spacings = 1.0;
        s.reproject = false;
        s.pack.error_m = 0.004;
        s.pack.confidence_step = 16;
        break;
    case FUSE_FIELD:
        break;
    case FUSE_SURVEY: /* smaller pixels than samples: edges to a fraction of the spacing */
        s.pixel_spacings = 0.7;
        s.face_max_px = 3072;
        s.skins.view_px = 2048;
        s.pack.error_m = 0.0005;
        s.pack.confidence_step = 2;
        s.pack.zstd_level = 9;
        break;
    }
    return s;
}
