/* Which axis of a foreign world points up, and the turn from it to ours (z up). */
#ifndef SC_IMPORT_FRAME_UP_H
#define SC_IMPORT_FRAME_UP_H

#include "base/pose.h"
#include "base/st.h"

#ifdef __cplusplus
extern "C" {
#endif

enum frame_up {
    FRAME_UP_Z,      /* as ours */
    FRAME_UP_Y,      /* ours = (x, -z, y) */
    FRAME_UP_MINUS_Y /* ours = (x, z, -y): a world that is the first camera's frame */
};

/* "z", "y" or "-y"; ST_INVALID. */
ST_MUST_CHECK enum st frame_up_parse(const char *text, enum frame_up *out_up, struct errctx *err);

struct mat3 frame_up_rotation(enum frame_up up); /* ours_from_theirs */

/* A pose from x y z qx qy qz qw (camera or scan to world), turned. ST_INVALID for numbers that are
 * not finite or a quaternion of length 0. */
ST_MUST_CHECK enum st frame_up_pose(const double values[7], enum frame_up up,
                                    struct pose *out_world_from_local, struct errctx *err);

/* cam level at the origin, looking along +y of a z-up world: where there is no pose. */
struct pose frame_up_level_camera(void);

#ifdef __cplusplus
}
#endif
#endif
