/* Statues of the `heritage` scene: draped figures as a signed distance. */
#include "twin/heritage.h"
#include "twin/noise3.h"

static float figure_distance(const void *ctx, struct sdf_point p) {
    const struct figure *f = ctx;
    float angle = atan2f(p.y, p.x), low = noise3_smooth(1.15f, 0.25f, p.z);
    float robe = sdf_limb(p, sdf_at(0, 0, 0.05f), sdf_at(0.015f, 0, 1.05f), 0.27f, 0.165f);
    robe = fmaxf(robe, -p.z + 0.0f);
    robe += 0.016f * low *
            sinf(13 * angle + 5 * noise3_gradient(p.x * 3, p.y * 3, p.z * 1.3f, f->seed));
    robe += 0.012f * noise3_gradient(p.x * 9, p.y * 9, p.z * 3, f->seed + 1);
    float chest = sdf_ellipsoid(p, 0.01f, 0, 1.18f, 0.13f, 0.2f, 0.24f);
    float body = sdf_join(robe, chest, 0.12f);
    /* cloak: a shell that hangs from the shoulders, open in front */
    float cloak = sdf_limb(p, sdf_at(-0.06f, 0, 0.35f), sdf_at(-0.03f, 0, 1.32f), 0.27f, 0.19f);
    cloak = fmaxf(fabsf(cloak) - 0.016f, p.x - 0.06f - 0.05f * sinf(7 * p.z + (float)f->seed));
    cloak += 0.012f * sinf(17 * angle + 4 * p.z);
    body = sdf_join(body, cloak, 0.03f);
    struct sdf_point shoulder_r = sdf_at(0.0f, -0.19f, 1.3f),
                     shoulder_l = sdf_at(0.0f, 0.19f, 1.3f);
    struct sdf_point elbow_r = sdf_at(0.08f, -0.3f, 1.05f + 0.15f * f->raise);
    struct sdf_point hand_r = sdf_at(0.27f, -0.16f - 0.08f * f->raise, 1.12f + 0.5f * f->raise);
    struct sdf_point elbow_l = sdf_at(0.05f, 0.29f, 1.04f), hand_l = sdf_at(0.24f, 0.05f, 1.12f);
    float arms = fminf(sdf_limb(p, shoulder_r, elbow_r, 0.075f, 0.08f),
                       sdf_limb(p, elbow_r, hand_r, 0.075f, 0.036f));
    arms = fminf(arms, sdf_limb(p, shoulder_l, elbow_l, 0.075f, 0.08f));
    arms = fminf(arms, sdf_limb(p, elbow_l, hand_l, 0.075f, 0.036f));
    arms = fminf(arms, fminf(sdf_ellipsoid(p, hand_r.x, hand_r.y, hand_r.z, 0.05f, 0.035f, 0.055f),
                             sdf_ellipsoid(p, hand_l.x, hand_l.y, hand_l.z, 0.05f, 0.04f, 0.045f)));
    body = sdf_join(body, arms, 0.05f);
    /* head: skull, jaw, nose, hair, in a frame turned about z */
    float c = cosf(f->turn), s = sinf(f->turn);
    struct sdf_point q = sdf_at(c * p.x + s * p.y, -s * p.x + c * p.y, p.z);
    float head = sdf_ellipsoid(q, 0.015f, 0, 1.58f, 0.1f, 0.083f, 0.125f);
    head = sdf_join(head, sdf_ellipsoid(q, 0.055f, 0, 1.51f, 0.055f, 0.05f, 0.06f), 0.03f);
    head = sdf_join(
        head, sdf_limb(q, sdf_at(0.11f, 0, 1.6f), sdf_at(0.128f, 0, 1.555f), 0.01f, 0.017f), 0.02f);
    head = sdf_cut(head, sdf_ball(q, 0.125f, 0.036f, 1.6f, 0.022f), 0.02f);
    head = sdf_cut(head, sdf_ball(q, 0.125f, -0.036f, 1.6f, 0.022f), 0.02f);
    float hair = sdf_ellipsoid(q, -0.02f, 0, 1.57f, 0.105f, 0.098f, 0.145f);
    hair = fmaxf(hair, q.x - 0.055f) +
           0.012f * noise3_gradient(q.x * 25, q.y * 25, q.z * 10, f->seed + 2);
    head = sdf_join(head, hair, 0.015f);
    head = sdf_join(head, sdf_limb(p, sdf_at(0, 0, 1.3f), sdf_at(0.01f, 0, 1.5f), 0.065f, 0.055f),
                    0.05f);
    body = sdf_join(body, head, 0.02f);
    if (f->staff) {
        struct sdf_point foot = sdf_at(0.3f, hand_r.y, 0), top = sdf_at(0.25f, hand_r.y, 1.95f);
        body = fminf(body, sdf_limb(p, foot, top, 0.017f, 0.015f));
        body = fminf(body, sdf_ball(p, top.x, top.y, top.z, 0.045f));
    }
    float plinth = sdf_box(sdf_at(p.x - 0.04f, p.y, p.z + 0.02f), 0.33f, 0.33f, 0.05f, 0.01f);
    return fminf(body, plinth);
}

void heritage_statue(const struct heritage *h, const struct figure *f, uint16_t material,
                     struct pose world_from_figure) {
    struct shaper s = scene_shaper(h->scene, material, world_from_figure);
    struct sdf_job job = {.distance = figure_distance,
                          .ctx = f,
                          .min = {-0.45, -0.48, -0.1},
                          .max = {0.5, 0.48, 2.1},
                          .cell_m = 0.012 / h->detail,
                          .slack = 1.6};
    sdf_mesh(&s, &job);
}
