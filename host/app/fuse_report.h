/* What fuse and cull tell: text for a person, JSON for a program. */
#ifndef SC_APP_FUSE_REPORT_H
#define SC_APP_FUSE_REPORT_H

#include "app/fuse_skins.h"
#include "app/fuse_tiles.h"
#include "base/json.h"

struct fuse_report {
    const struct fuse_settings *settings;
    const struct fuse_station *stations;
    size_t station_count;
    const struct fuse_photos *photos;
    const struct fuse_skins_result *skins; /* NULL: not part of it */
    const struct fuse_tiles_result *tiles;
    double seconds;
    int64_t peak_bytes_photos, peak_bytes_skins,
        peak_bytes_tiles; /* of the process, after each stage */
};

/* Most memory the process ever had, bytes. */
int64_t fuse_report_peak_bytes(void);

void fuse_report_text(const struct fuse_report *report);
ST_MUST_CHECK enum st fuse_report_json(const struct fuse_report *report, struct errctx *err);

#endif
