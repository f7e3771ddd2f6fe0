/* What stands and lies around the cars of the `accident` scene. */
#include "twin/accident.h"
#include "twin/noise3.h"

/* ---- trees ---- */

struct tree {
    struct shaper wood, leaf;
    struct rng rng;
    double detail;
};

static struct vec3 lean(struct rng *rng, struct vec3 dir, double amount) {
    struct vec3 side = rng_direction(rng);
    return vec3_unit(vec3_madd(dir, side, amount));
}

static void add_leaves(struct tree *t, struct vec3 at, double spread_m) {
    int count = scene_scaled(26, t->detail, 4);
    for (int i = 0; i < count; i++) {
        struct vec3 p =
            vec3_madd(at, rng_direction(&t->rng), spread_m * cbrt(rng_uniform(&t->rng)));
        struct vec3 along = vec3_unit(vec3_add(rng_direction(&t->rng), vec3_make(0, 0, -0.5)));
        struct vec3 across = vec3_unit(vec3_cross(along, rng_direction(&t->rng)));
        double length = rng_range(&t->rng, 0.05, 0.09);
        struct vec3 tip = vec3_madd(p, along, length), mid = vec3_madd(p, along, 0.45 * length);
        shape_shard(&t->leaf, p, vec3_madd(mid, across, 0.3 * length), tip);
        shape_shard(&t->leaf, p, tip, vec3_madd(mid, across, -0.3 * length));
    }
}

static void add_branch(struct tree *t, struct vec3 from, struct vec3 dir, double length_m,
                       double radius_m, int depth) {
    enum { POINTS = 6 };
    struct vec3 path[POINTS];
    double radius[POINTS];
    path[0] = from;
    radius[0] = radius_m;
    for (int i = 1; i < POINTS; i++) {
        dir = lean(&t->rng, dir, depth == 4 ? 0.06 : 0.16);
        path[i] = vec3_madd(path[i - 1], dir, length_m / (POINTS - 1));
        radius[i] = radius_m * (1 - 0.45 * i / (POINTS - 1));
    }
    shape_tube(&t->wood, path, radius, POINTS, depth >= 3 ? 14 : depth == 2 ? 8 : 5);
    if (depth <= 1)
        for (int i = 2; i < POINTS; i++)
            add_leaves(t, path[i], 0.22);
    if (depth == 0)
        return;
    int children = depth == 4 ? 5 : 4;
    for (int i = 0; i < children; i++) {
        int at = depth == 4 ? 3 + i % 3 : 1 + i % (POINTS - 1);
        struct vec3 to = vec3_unit(vec3_add(vec3_scale(dir, 0.6), rng_direction(&t->rng)));
        to.z = to.z * 0.7 + 0.25;
        add_branch(t, path[at], vec3_unit(to), length_m * rng_range(&t->rng, 0.5, 0.72),
                   radius[at] * 0.62, depth - 1);
    }
}

static void add_tree(const struct accident *a, double x, double y, uint64_t number) {
    struct tree t = {.wood = accident_part(a, a->bark, vec3_make(x, y, 0), 0),
                     .leaf = accident_part(a, a->leaf, vec3_make(x, y, 0), 0),
                     .rng = rng_stream(a->scene->seed, 100 + number),
                     .detail = a->detail};
    add_branch(&t, vec3_make(0, 0, -0.05), vec3_make(0, 0, 1), 2.6, 0.17, 4);
    for (int i = 0; i < 6; i++) { /* roots */
        double ang = accident_pi * 2 * i / 6 + rng_range(&t.rng, -0.3, 0.3);
        struct vec3 path[3] = {{0.1 * cos(ang), 0.1 * sin(ang), 0.28},
                               {0.24 * cos(ang), 0.24 * sin(ang), 0.08},
                               {0.5 * cos(ang), 0.5 * sin(ang), -0.04}};
        double radius[3] = {0.06, 0.06, 0.03};
        shape_tube(&t.wood, path, radius, 3, 8);
    }
}

/* ---- street furniture ---- */

/* A sign plate of a regular outline on a post, facing yaw. */
static void add_sign(const struct accident *a, uint16_t material, double x, double y, double yaw,
                     int sides, double turn, double inradius_m) {
    struct shaper post = accident_part(a, a->steel, vec3_make(x, y, 0), yaw);
    shape_bar(&post, vec3_make(0, 0, 0), vec3_make(0, 0, 2.6), 0.03,
              scene_scaled(20, a->detail, 8));
    enum { SIDES = 48 };
    struct vec2 outline[SIDES];
    double r = inradius_m / cos(accident_pi / sides);
    for (int i = 0; i < sides; i++) {
        double t = turn + 2 * accident_pi * (i + 0.5) / sides;
        outline[i] = (struct vec2){r * cos(t), r * sin(t)};
    }
    struct pose face = shaper_frame(vec3_make(x, y, 2.2), yaw, 0, accident_pi / 2);
    struct pose forward = shaper_frame(vec3_make(0, 0, 0.035), 0, 0, 0);
    struct shaper plate = scene_shaper(a->scene, material, pose_compose(&face, &forward));
    shape_prism(&plate, outline, sides, 0, 0.004);
    struct shaper back = scene_shaper(a->scene, a->steel, face);
    shape_prism(&back, outline, sides, 0.028, 0.034);
}

static void add_lamp_post(const struct accident *a, double x, double y) {
    static const struct vec2 pole[] = {
        {0.13, 0.0}, {0.13, 0.5}, {0.1, 0.55}, {0.075, 0.6}, {0.05, 5.6}};
    struct shaper s = accident_part(a, a->steel, vec3_make(x, y, 0), 0);
    shape_lathe(&s, pole, sizeof pole / sizeof pole[0], scene_scaled(36, a->detail, 12));
    enum { POINTS = 9 };
    struct vec3 path[POINTS];
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = accident_pi / 2 * i / (POINTS - 1);
        path[i] = vec3_make(0, -1.1 * (1 - cos(t)), 5.5 + 0.6 * sin(t));
        radius[i] = 0.05 - 0.02 * i / POINTS;
    }
    shape_tube(&s, path, radius, POINTS, 12);
    shape_box(&s, vec3_make(-0.15, -1.75, 6.05), vec3_make(0.15, -1.0, 6.17), 0.04);
    struct shaper bulb = accident_part(a, a->lamp, vec3_make(x, y, 0), 0);
    shape_box(&bulb, vec3_make(-0.1, -1.65, 6.035), vec3_make(0.1, -1.15, 6.049), 0);
    struct scene_light light = {.position_m = {x, y - 1.4, 5.98},
                                .dir = {0, -0.15, -1},
                                .radius_m = 0.14,
                                .cos_inner = 0.7,
                                .cos_outer = 0.1,
                                .rgb = {46, 30, 15}};
    light.dir = vec3_unit(light.dir);
    scene_add_light(a->scene, light);
}

/* A flood light of the crew on a tripod, aimed at a point. */
static void add_flood(const struct accident *a, struct vec3 foot, struct vec3 aim) {
    struct shaper s = accident_part(a, a->steel, foot, 0);
    for (int i = 0; i < 3; i++) {
        double t = 2 * accident_pi * i / 3 + 0.3;
        shape_bar(&s, vec3_make(0.55 * cos(t), 0.55 * sin(t), 0), vec3_make(0, 0, 0.95), 0.014, 8);
        shape_bar(&s, vec3_make(0.27 * cos(t), 0.27 * sin(t), 0.48), vec3_make(0, 0, 0.48), 0.008,
                  6);
    }
    shape_bar(&s, vec3_make(0, 0, 0.4), vec3_make(0, 0, 2.35), 0.018, 10);
    shape_bar(&s, vec3_make(-0.3, 0, 2.3), vec3_make(0.3, 0, 2.3), 0.014, 8);
    struct vec3 head = vec3_add(foot, vec3_make(0, 0, 2.35));
    struct vec3 dir = vec3_unit(vec3_sub(aim, head));
    double yaw = atan2(dir.y, dir.x), pitch = -asin(dir.z);
    for (int k = -1; k <= 1; k += 2) {
        struct vec3 at = vec3_add(head, vec3_make(-0.2 * k * sin(yaw), 0.2 * k * cos(yaw), 0));
        struct pose frame = shaper_frame(at, yaw, pitch, 0);
        struct shaper box = scene_shaper(a->scene, a->plastic, frame);
        shape_box(&box, vec3_make(-0.09, -0.14, -0.1), vec3_make(0.05, 0.14, 0.1), 0.015);
        struct shaper face = scene_shaper(a->scene, a->lamp, frame);
        shape_box(&face, vec3_make(0.05, -0.12, -0.085), vec3_make(0.056, 0.12, 0.085), 0);
    }
    struct scene_light light = {.position_m = vec3_madd(head, dir, 0.14),
                                .dir = dir,
                                .radius_m = 0.16,
                                .cos_inner = 0.72,
                                .cos_outer = 0.3,
                                .rgb = {56, 58, 62}};
    scene_add_light(a->scene, light);
}

static void add_cone(const struct accident *a, double x, double y, double tip) {
    static const struct vec2 cone[] = {{0.15, 0.03}, {0.14, 0.06}, {0.03, 0.72}, {0.0, 0.725}};
    struct pose at = shaper_frame(vec3_make(x, y, tip > 0 ? 0.16 : 0), tip * 3, tip, 0);
    struct shaper s = scene_shaper(a->scene, a->cone, at);
    shape_lathe(&s, cone, sizeof cone / sizeof cone[0], scene_scaled(40, a->detail, 12));
    struct shaper foot = scene_shaper(a->scene, a->plastic, at);
    shape_box(&foot, vec3_make(-0.19, -0.19, 0), vec3_make(0.19, 0.19, 0.03), 0.008);
}

/* A folded yellow evidence marker. */
static void add_tent(const struct accident *a, double x, double y, double yaw) {
    struct shaper s = accident_part(a, a->tent, vec3_make(x, y, 0), yaw);
    struct vec3 l0 = {-0.09, -0.06, 0}, l1 = {0.09, -0.06, 0}, r0 = {-0.09, 0.06, 0},
                r1 = {0.09, 0.06, 0};
    struct vec3 t0 = {-0.09, 0, 0.2}, t1 = {0.09, 0, 0.2};
    shape_quad(&s, l0, l1, t1, t0);
    shape_quad(&s, r1, r0, t0, t1);
}

/* ---- the dummy ---- */

static float dummy_distance(const void *ctx, struct sdf_point p) {
    (void)ctx;
    float f = sdf_ellipsoid(p, 0, 0, 1.22f, 0.13f, 0.19f, 0.25f);
    f = sdf_join(f, sdf_ellipsoid(p, 0, 0, 0.93f, 0.12f, 0.165f, 0.14f), 0.08f);
    f = sdf_join(f, sdf_limb(p, sdf_at(0, 0, 1.4f), sdf_at(0.01f, 0, 1.52f), 0.06f, 0.055f), 0.03f);
    f = sdf_join(f, sdf_ellipsoid(p, 0.015f, 0, 1.63f, 0.1f, 0.078f, 0.125f), 0.02f);
    static const struct sdf_point left[6] = {{0, 0.2f, 1.38f},      {0.06f, 0.46f, 1.2f},
                                             {0.02f, 0.62f, 1.42f}, {0, 0.1f, 0.9f},
                                             {0.16f, 0.2f, 0.48f},  {-0.06f, 0.24f, 0.08f}};
    static const struct sdf_point right[6] = {{0, -0.2f, 1.38f},      {-0.02f, -0.34f, 1.1f},
                                              {0.1f, -0.42f, 0.86f},  {0, -0.1f, 0.9f},
                                              {0.04f, -0.14f, 0.47f}, {0.0f, -0.2f, 0.06f}};
    for (int side = 0; side < 2; side++) {
        const struct sdf_point *j = side ? right : left;
        f = sdf_join(f, sdf_limb(p, j[0], j[1], 0.06f, 0.045f), 0.03f);
        f = sdf_join(f, sdf_limb(p, j[1], j[2], 0.047f, 0.034f), 0.01f);
        f = sdf_join(f, sdf_ellipsoid(p, j[2].x, j[2].y, j[2].z, 0.035f, 0.045f, 0.055f), 0.01f);
        f = sdf_join(f, sdf_limb(p, j[3], j[4], 0.095f, 0.06f), 0.03f);
        f = sdf_join(f, sdf_limb(p, j[4], j[5], 0.062f, 0.042f), 0.01f);
        float toe_x = j[5].x + 0.15f;
        f = sdf_join(f, sdf_limb(p, j[5], sdf_at(toe_x, j[5].y, j[5].z - 0.02f), 0.048f, 0.032f),
                     0.02f);
    }
    return f;
}

static void add_dummy(const struct accident *a, double x, double y, double yaw) {
    struct shaper s = scene_shaper(a->scene, a->dummy,
                                   shaper_frame(vec3_make(x, y, 0.125), yaw, -accident_pi / 2, 0));
    struct sdf_job job = {.distance = dummy_distance,
                          .min = {-0.3, -0.6, -0.05},
                          .max = {0.35, 0.8, 1.85},
                          .cell_m = 0.011 / a->detail,
                          .slack = 1.5};
    sdf_mesh(&s, &job);
}

/* ---- debris ---- */

static struct vec3 around_impact(struct rng *rng, double spread_m) {
    return vec3_make(-0.6 + spread_m * rng_normal(rng), -0.35 + spread_m * rng_normal(rng), 0.004);
}

static void add_shards(const struct accident *a, uint16_t material, int count, double size_m,
                       double spread_m, uint64_t stream) {
    struct rng rng = rng_stream(a->scene->seed, stream);
    struct shaper s = accident_part(a, material, vec3_make(0, 0, 0), 0);
    for (int i = 0; i < count; i++) {
        struct vec3 p = around_impact(&rng, spread_m), c[3];
        double size = size_m * rng_range(&rng, 0.4, 1.6), turn = rng_range(&rng, 0, 6.28);
        for (int k = 0; k < 3; k++) {
            double t = turn + 2.1 * k + rng_range(&rng, -0.4, 0.4);
            c[k] = vec3_add(
                p, vec3_make(size * cos(t), size * sin(t), size * rng_range(&rng, 0, 0.5)));
        }
        shape_shard(&s, c[0], c[1], c[2]);
    }
}

static void add_debris(const struct accident *a) {
    add_shards(a, a->lens, scene_scaled(500, a->detail, 60), 0.012, 0.75, 200);
    add_shards(a, a->plastic, scene_scaled(90, a->detail, 20), 0.05, 0.8, 201);
    add_shards(a, a->red_paint, scene_scaled(40, a->detail, 10), 0.05, 0.7, 202);
    add_shards(a, a->tail, scene_scaled(30, a->detail, 8), 0.025, 0.6, 203);
    enum { POINTS = 15 };
    struct vec3 path[POINTS]; /* the torn-off bumper */
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double u = -0.74 + 1.48 * i / (POINTS - 1);
        path[i] = vec3_make(-1.2 + 0.35 * u * u + 0.25 * u, -1.85 + u * 0.9, 0.06 + 0.14 * u * u);
        radius[i] = 0.05;
    }
    struct shaper s = accident_part(a, a->plastic, vec3_make(0, 0, 0), 0);
    shape_tube(&s, path, radius, POINTS, scene_scaled(16, a->detail, 8));
    shape_ellipsoid(&s, vec3_make(-0.75, 1.25, 0.07), vec3_make(0.11, 0.075, 0.07),
                    24); /* mirror */
    static const struct vec2 cap[] = {
        {0.19, 0.0}, {0.195, 0.015}, {0.15, 0.03}, {0.06, 0.035}, {0.001, 0.05}};
    struct shaper hub =
        scene_shaper(a->scene, a->rim, shaper_frame(vec3_make(-1.5, -2.6, 0.012), 0.4, 0.1, 0.05));
    shape_lathe(&hub, cap, sizeof cap / sizeof cap[0], 48);
    struct shaper oil = accident_part(a, a->oil, vec3_make(-0.75, -0.1, 0), 0.4);
    shape_ellipsoid(&oil, vec3_make(0, 0, 0), vec3_make(0.75, 0.34, 0.004), 48);
    shape_ellipsoid(&oil, vec3_make(-0.5, -0.55, 0), vec3_make(0.3, 0.5, 0.003), 40);
}

void accident_furnish(const struct accident *a) {
    add_tree(a, -4.6, -6.6, 0);
    add_tree(a, 2.2, -7.4, 1);
    add_tree(a, 7.6, -6.2, 2);
    add_sign(a, a->sign_limit, 3.4, 4.15, accident_pi, 36, 0, 0.3);
    add_sign(a, a->sign_warn, -5.2, 4.15, -accident_pi / 4, 3, -accident_pi / 2 - accident_pi / 3,
             0.22);
    add_sign(a, a->sign_stop, 4.9, -4.3, accident_pi * 0.8, 8, 0, 0.3);
    add_lamp_post(a, -2.6, 4.3);
    add_flood(a, vec3_make(-5.4, -2.4, 0), vec3_make(0, 0, 0.5));
    add_flood(a, vec3_make(4.3, 2.9, 0), vec3_make(0.2, 0, 0.5));
    add_cone(a, -5.9, -0.4, 0);
    add_cone(a, -5.6, 1.4, 0);
    add_cone(a, 4.8, -1.4, 0);
    add_cone(a, 4.6, 0.6, 0);
    add_cone(a, 2.9, -2.9, 1.42);
    add_tent(a, -1.7, -1.6, 0.5);
    add_tent(a, 1.9, -2.5, -0.4);
    add_tent(a, -1.35, 1.3, 1.2);
    add_dummy(a, 2.4, -1.1, 2.0);
    add_debris(a);
}
