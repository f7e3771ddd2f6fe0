#include "import/frame_up.h"

#include <string.h>

enum st frame_up_parse(const char *text, enum frame_up *out_up, struct errctx *err) {
    static const char *const names[] = {"z", "y", "-y"};
    for (int i = 0; i < 3; i++)
        if (!strcmp(text, names[i])) {
            *out_up = (enum frame_up)i;
            return ST_OK;
        }
    return errctx_set(err, ST_INVALID,
                      "'%.40s' is not z, y or -y: which axis of the poses' world is up?", text);
}

struct mat3 frame_up_rotation(enum frame_up up) {
    static const struct mat3 from_y = {{1, 0, 0, 0, 0, -1, 0, 1, 0}};
    static const struct mat3 from_minus_y = {{1, 0, 0, 0, 0, 1, 0, -1, 0}};
    return up == FRAME_UP_Y ? from_y : up == FRAME_UP_MINUS_Y ? from_minus_y : mat3_identity();
}

enum st frame_up_pose(const double values[7], enum frame_up up, struct pose *out_world_from_local,
                      struct errctx *err) {
    struct mat3 r;
    for (int i = 0; i < 7; i++)
        if (!isfinite(values[i]))
            return errctx_set(err, ST_INVALID, "number %d of the pose is not finite", i + 1);
    if (pose_rotation_from_quat(values[3], values[4], values[5], values[6], &r))
        return errctx_set(err, ST_INVALID, "the pose's quaternion has no length");
    const struct mat3 turn = frame_up_rotation(up);
    out_world_from_local->r = mat3_mul(&turn, &r);
    out_world_from_local->t_m = mat3_mulv(&turn, vec3_make(values[0], values[1], values[2]));
    return ST_OK;
}

struct pose frame_up_level_camera(void) {
    const struct pose pose = {{{1, 0, 0, 0, 0, 1, 0, -1, 0}}, {0, 0, 0}};
    return pose;
}
