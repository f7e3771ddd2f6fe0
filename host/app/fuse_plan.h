/* Which photographs a station gets: one a camera frame with a pose; else six cube faces, or one
 * view where the samples all look the same way. */
#ifndef SC_APP_FUSE_PLAN_H
#define SC_APP_FUSE_PLAN_H

#include "app/fuse_photo.h"

/* Adds them, not yet made, to `photos`. */
ST_MUST_CHECK enum st fuse_plan_station(struct site *site, const struct station *station,
                                        const struct fuse_source *source,
                                        const struct face_survey *survey,
                                        const struct fuse_settings *settings,
                                        struct fuse_photos *photos, struct errctx *err);

/* How well a station's pose is known: from its covariance; else as the settings say; else by where
 * it is from. A guess (nominal) is not good enough to compare stations by. */
void fuse_plan_pose_sigma(const struct station_pose *pose, const struct fuse_settings *settings,
                          double *out_sigma_m, double *out_sigma_rad);

#endif
