/* The cars of the `accident` scene: a body as a signed distance, deformed where it was hit; panes
 * cut out of the same surface; wheels, lamps, bumpers and seats as shapes. */
#include "twin/accident.h"
#include "twin/noise3.h"

static float sq(float x) {
    return x * x;
}
static float bell(float x, float width) {
    return expf(-sq(x / width));
}

/* ---- body ---- */

/* A point of the undamaged car for a point of the damaged one. */
static struct sdf_point undamaged(const struct car_damage *d, struct sdf_point p) {
    struct sdf_point q = p;
    if (d->front_m > 0 && p.x > 0.4f) {
        float left = 0.45f + 0.55f * noise3_smooth(-0.7f, 0.6f, p.y);
        float crush = d->front_m * noise3_smooth(0.55f, 1.85f, p.x) * left;
        crush *= 1 + 0.35f * noise3_gradient(p.y * 3, p.z * 4, 1.5f, d->seed);
        q.x += crush;
        float k = crush / d->front_m;
        q.z -=
            0.13f * left * bell(p.x - 1.12f, 0.22f) * noise3_smooth(0.6f, 0.85f, p.z); /* bonnet */
        q.z += 0.05f * k * noise3_gradient(p.x * 7, p.y * 4, p.z * 3, d->seed + 1);
        q.y += 0.06f * k * noise3_gradient(p.x * 5, p.y * 3, p.z * 6, d->seed + 2);
    }
    if (d->side_m > 0 && p.y > 0) {
        float dent = d->side_m * bell(p.x - d->side_x_m, 0.6f) * bell(p.z - 0.58f, 0.38f) *
                     noise3_smooth(0.2f, 0.7f, p.y);
        q.y += dent * (1 + 0.4f * noise3_ridged(p.x * 3, p.z * 3, 0.5f, 3, d->seed + 3) - 0.2f);
        q.x += 0.25f * dent * noise3_gradient(p.x * 6, p.z * 6, 2, d->seed + 4);
    }
    return q;
}

static float cabin_side(struct sdf_point q) {
    return fabsf(q.y) - (0.77f - 0.42f * (q.z - 0.9f));
}
static float windscreen(struct sdf_point q) {
    return (q.x - 0.95f + 0.10f * sq(q.y / 0.7f)) * 0.539f + (q.z - 0.92f) * 0.842f;
}
static float rear_window(struct sdf_point q) {
    return -(q.x + 1.55f - 0.08f * sq(q.y / 0.7f)) * 0.583f + (q.z - 0.95f) * 0.813f;
}
static float roof_height(struct sdf_point q) {
    return 1.42f - 0.05f * sq((q.x + 0.25f) / 0.9f) - 0.045f * sq(q.y / 0.6f);
}

static float lower_body(struct sdf_point q) {
    float ay = fabsf(q.y);
    float w = 0.865f - 0.11f * sq(sq(q.x / 2.15f)) - 0.055f * sq((q.z - 0.55f) / 0.32f) +
              0.012f * bell(q.z - 0.72f, 0.035f);
    float hood =
        0.94f - 0.15f * noise3_smooth(0.8f, 2.2f, q.x) - 0.07f * noise3_smooth(-1.3f, -2.1f, q.x);
    hood += -0.05f * sq(ay / 0.85f) + 0.012f * bell(ay - 0.42f, 0.05f);
    float bottom = 0.19f + 0.11f * noise3_smooth(1.7f, 2.1f, fabsf(q.x)) - q.z;
    float front = q.x - (2.12f - 0.17f * sq(ay / 0.85f) - 0.09f * sq((q.z - 0.5f) / 0.28f));
    float rear = -q.x - (2.10f - 0.12f * sq(ay / 0.85f) - 0.10f * sq((q.z - 0.55f) / 0.3f));
    float box = sdf_meet(sdf_meet(ay - w, q.z - hood, 0.10f),
                         sdf_meet(fmaxf(front, rear), bottom, 0.06f), 0.09f);
    for (int end = -1; end <= 1; end += 2) { /* wheel arches with a lip */
        float r = sdf_length(q.x - 1.3f * (float)end, 0, q.z - 0.31f);
        box -= 0.018f * bell(r - 0.385f, 0.025f) * noise3_smooth(0.7f, 0.8f, ay);
        box = sdf_cut(box, fmaxf(r - 0.36f, 0.52f - ay), 0.015f);
    }
    return box;
}

/* Door and bonnet gaps, grille and air intake. */
static float gaps(struct sdf_point q, float f) {
    static const float door_x[3] = {0.80f, -0.12f, -1.02f};
    float ay = fabsf(q.y), g = 0;
    for (int i = 0; i < 3; i++)
        g = fmaxf(g, bell(q.x - door_x[i] - 0.06f * (q.z - 0.6f), 0.006f) *
                         noise3_smooth(0.26f, 0.3f, q.z) * noise3_smooth(0.6f, 0.7f, ay));
    g = fmaxf(g, bell(q.z - 0.29f, 0.006f) * noise3_smooth(1.05f, 1.0f, q.x) *
                     noise3_smooth(-1.05f, -1.0f, q.x) * noise3_smooth(0.6f, 0.7f, ay));
    g = fmaxf(g, bell(q.x - 0.86f, 0.008f) * noise3_smooth(0.78f, 0.85f, q.z));
    g = fmaxf(g, bell(q.x + 1.62f, 0.008f) * noise3_smooth(0.78f, 0.85f, q.z));
    g = fmaxf(g, bell(ay - 0.7f, 0.007f) * noise3_smooth(0.86f, 0.88f, q.x) *
                     noise3_smooth(0.7f, 0.76f, q.z));
    f += 0.011f * g;
    float grille = sdf_box(sdf_at(q.x - 2.1f, q.y, q.z - 0.58f), 0.10f, 0.34f, 0.055f, 0.02f);
    float intake = sdf_box(sdf_at(q.x - 2.08f, q.y, q.z - 0.33f), 0.12f, 0.5f, 0.045f, 0.02f);
    return sdf_cut(f, fminf(grille, intake), 0.01f);
}

static float body_distance(const void *ctx, struct sdf_point p) {
    const struct car_damage *d = ctx;
    struct sdf_point q = undamaged(d, p);
    float cabin = sdf_meet(fmaxf(sdf_meet(cabin_side(q), q.z - roof_height(q), 0.09f), 0.8f - q.z),
                           sdf_meet(windscreen(q), rear_window(q), 0.06f), 0.05f);
    return gaps(q, sdf_join(lower_body(q), cabin, 0.05f));
}

/* Negative where the surface is a pane: the two screens and the side windows between their pillars.
 */
static float pane(const struct car_damage *d, struct sdf_point p) {
    struct sdf_point q = undamaged(d, p);
    float below_roof = roof_height(q) - q.z, side = cabin_side(q);
    float screen = windscreen(q), rear = rear_window(q);
    float height = fmaxf(0.985f - q.z, 0.06f - below_roof);
    float front_pane = fmaxf(-(screen + 0.035f), side + 0.075f);
    float rear_pane = fmaxf(-(rear + 0.035f), side + 0.085f);
    float pillars = fmaxf(0.035f - fabsf(q.x + 0.12f), 0.03f - fabsf(q.x + 1.02f));
    float side_pane = fmaxf(fmaxf(-(side + 0.05f), screen + 0.09f), fmaxf(rear + 0.1f, pillars));
    side_pane = fmaxf(side_pane, 0.075f - below_roof);
    return fmaxf(height, fminf(side_pane, fminf(front_pane, rear_pane)));
}

static float outside_panes(const void *ctx, struct sdf_point p) {
    return -pane(ctx, p);
}

/* The rubber around a pane, 16 mm wide. */
static float seals(const void *ctx, struct sdf_point p) {
    float f = pane(ctx, p);
    return fmaxf(f, -0.016f - f);
}

static float inside_seals(const void *ctx, struct sdf_point p) {
    const struct car_damage *d = ctx;
    float lost = d->lost_left_glass ? fmaxf(0.45f - p.y, fmaxf(p.x - 0.8f, -1.1f - p.x)) : 1;
    return fmaxf(pane(d, p) + 0.016f, -lost);
}

static void add_body(const struct accident *a, const struct car_damage *d, uint16_t paint,
                     struct pose world_from_car) {
    struct sdf_job job = {.distance = body_distance,
                          .clip = outside_panes,
                          .ctx = d,
                          .min = {-2.25, -1.0, 0.1},
                          .max = {2.25, 1.0, 1.55},
                          .cell_m = 0.012 / a->detail,
                          .slack = 2.2};
    struct shaper metal = scene_shaper(a->scene, paint, world_from_car);
    sdf_mesh(&metal, &job);
    job.clip = seals;
    struct shaper rubber = scene_shaper(a->scene, a->plastic, world_from_car);
    sdf_mesh(&rubber, &job);
    job.clip = inside_seals;
    job.cell_m = 0.025 / a->detail;
    struct shaper panes = scene_shaper(a->scene, a->car_glass, world_from_car);
    sdf_mesh(&panes, &job);
}

/* ---- wheels ---- */

static void add_wheel(const struct accident *a, struct pose world_from_car, double x, double y,
                      double steer) {
    static const struct vec2 tyre[] = {
        {0.205, -0.085}, {0.235, -0.1},  {0.275, -0.102}, {0.302, -0.085}, {0.310, -0.05},
        {0.310, 0.05},   {0.302, 0.085}, {0.275, 0.102},  {0.235, 0.1},    {0.205, 0.085}};
    static const struct vec2 rim[] = {{0.21, -0.085}, {0.195, -0.07}, {0.185, 0.0},
                                      {0.19, 0.07},   {0.205, 0.088}, {0.212, 0.085}};
    static const struct vec2 hub[] = {{0.001, 0.055}, {0.05, 0.05}, {0.06, 0.035}, {0.062, 0.0}};
    static const struct vec2 disc[] = {{0.14, -0.02}, {0.14, -0.012}, {0.06, -0.012}};
    struct pose wheel = shaper_frame(vec3_make(x, y, 0.31), steer, 0, 0);
    struct pose world_from_wheel = pose_compose(&world_from_car, &wheel);
    /* lathes turn about z: lay that axis along y, the outside to the side the wheel is on */
    struct pose lying =
        shaper_frame(vec3_make(0, 0, 0), 0, 0, y > 0 ? -accident_pi / 2 : accident_pi / 2);
    int around = scene_scaled(120, a->detail, 32);
    struct shaper s = scene_shaper(a->scene, a->tyre, world_from_wheel), t = shaper_at(&s, lying);
    shape_lathe(&t, tyre, sizeof tyre / sizeof tyre[0], around);
    s = scene_shaper(a->scene, a->rim, world_from_wheel);
    t = shaper_at(&s, lying);
    shape_lathe(&t, rim, sizeof rim / sizeof rim[0], around);
    shape_lathe(&t, hub, sizeof hub / sizeof hub[0], around / 2);
    shape_lathe(&t, disc, sizeof disc / sizeof disc[0], around / 2);
    for (int i = 0; i < 5; i++)
        for (int k = -1; k <= 1; k += 2) {
            struct shaper spoke =
                shaper_at(&t, shaper_frame(vec3_make(0, 0, 0), 2 * accident_pi * i / 5, 0.16, 0));
            shape_box(&spoke, vec3_make(0.04, k > 0 ? 0.008 : -0.036, 0.03),
                      vec3_make(0.195, k > 0 ? 0.036 : -0.008, 0.055), 0.006);
        }
}

/* ---- everything else on a car ---- */

static void add_bumpers(const struct accident *a, const struct car_damage *d,
                        struct pose world_from_car) {
    enum { POINTS = 15 };
    struct shaper s = scene_shaper(a->scene, a->plastic, world_from_car);
    for (int end = -1; end <= 1; end += 2) {
        struct vec3 path[POINTS];
        double radius[POINTS];
        for (int i = 0; i < POINTS; i++) {
            double y = -0.74 + 1.48 * i / (POINTS - 1), x = 2.1 - 0.2 * (y / 0.85) * (y / 0.85);
            path[i] = vec3_make(end * x, y, 0.43);
            radius[i] = 0.055;
        }
        if (end < 0 || d->front_m == 0) /* a crushed front lost its bumper: see the debris */
            shape_tube(&s, path, radius, POINTS, scene_scaled(16, a->detail, 8));
    }
    struct shaper dark = scene_shaper(a->scene, a->plastic, world_from_car);
    for (int i = 0; i < 5; i++) {
        double back = (double)d->front_m * 0.75;
        shape_box(&dark, vec3_make(1.98 - back, -0.33, 0.535 + 0.02 * i),
                  vec3_make(2.0 - back, 0.33, 0.543 + 0.02 * i), 0);
    }
}

static void add_lamps(const struct accident *a, const struct car_damage *d,
                      struct pose world_from_car) {
    int around = scene_scaled(40, a->detail, 12);
    for (int side = -1; side <= 1; side += 2) {
        double back = (double)d->front_m * (side > 0 ? 0.98 : 0.5);
        if (d->front_m == 0 || side < 0) { /* the struck corner's lamp is gone */
            struct shaper lens = scene_shaper(a->scene, a->lens, world_from_car);
            shape_ellipsoid(&lens, vec3_make(1.95 - back, side * 0.58, 0.62),
                            vec3_make(0.1, 0.17, 0.075), around);
        }
        struct shaper tail = scene_shaper(a->scene, a->tail, world_from_car);
        shape_ellipsoid(&tail, vec3_make(-2.0, side * 0.6, 0.7), vec3_make(0.06, 0.15, 0.07),
                        around);
        if (side < 0 || !d->lost_left_mirror) {
            struct shaper mirror = scene_shaper(a->scene, a->plastic, world_from_car);
            shape_ellipsoid(&mirror, vec3_make(0.62, side * 0.96, 0.97),
                            vec3_make(0.07, 0.11, 0.075), around);
            shape_bar(&mirror, vec3_make(0.66, side * 0.74, 0.93),
                      vec3_make(0.64, side * 0.9, 0.95), 0.025, 10);
            struct shaper face = scene_shaper(a->scene, a->chrome, world_from_car);
            shape_box(&face, vec3_make(0.555, side * 0.96 - 0.075, 0.925),
                      vec3_make(0.565, side * 0.96 + 0.075, 1.015), 0.002);
        }
    }
    struct pose rear =
        shaper_frame(vec3_make(-2.075, 0, 0.62), -accident_pi / 2, 0, accident_pi / 2);
    struct shaper plate = scene_shaper(a->scene, a->plate, pose_compose(&world_from_car, &rear));
    shape_box(&plate, vec3_make(-0.26, -0.055, 0), vec3_make(0.26, 0.055, 0.008), 0);
    struct shaper chrome = scene_shaper(a->scene, a->chrome, world_from_car);
    for (int side = -1; side <= 1; side += 2)
        for (int k = 0; k < 2; k++)
            shape_bar(&chrome, vec3_make(-0.05 - 0.9 * k, side * 0.872, 0.76),
                      vec3_make(0.1 - 0.9 * k, side * 0.872, 0.77), 0.012, 8);
}

static void add_interior(const struct accident *a, struct pose world_from_car) {
    struct shaper s = scene_shaper(a->scene, a->seat, world_from_car);
    for (int side = -1; side <= 1; side += 2) {
        double y = side * 0.36;
        shape_box(&s, vec3_make(-0.22, y - 0.24, 0.36), vec3_make(0.32, y + 0.24, 0.55), 0.05);
        struct shaper back = shaper_at(&s, shaper_frame(vec3_make(-0.26, y, 0.5), 0, -0.32, 0));
        shape_box(&back, vec3_make(-0.08, -0.23, 0), vec3_make(0.06, 0.23, 0.6), 0.05);
        shape_box(&back, vec3_make(-0.05, -0.12, 0.66), vec3_make(0.05, 0.12, 0.84), 0.04);
    }
    shape_box(&s, vec3_make(-1.15, -0.6, 0.36), vec3_make(-0.7, 0.6, 0.56), 0.05);
    struct shaper bench = shaper_at(&s, shaper_frame(vec3_make(-1.2, 0, 0.5), 0, -0.4, 0));
    shape_box(&bench, vec3_make(-0.08, -0.6, 0), vec3_make(0.06, 0.6, 0.55), 0.05);
    struct shaper dash = scene_shaper(a->scene, a->plastic, world_from_car);
    shape_box(&dash, vec3_make(0.62, -0.68, 0.5), vec3_make(0.95, 0.68, 0.93), 0.05);
    enum { POINTS = 33 };
    struct vec3 path[POINTS];
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = 2 * accident_pi * i / (POINTS - 1);
        path[i] = vec3_make(0.46 + 0.09 * sin(t), 0.36 + 0.18 * cos(t), 0.86 + 0.16 * sin(t));
        radius[i] = 0.014;
    }
    shape_tube(&dash, path, radius, POINTS, 8);
    shape_bar(&dash, vec3_make(0.46, 0.36, 0.86), vec3_make(0.7, 0.36, 0.74), 0.025, 8);
    shape_bar(&dash, vec3_make(0.46, 0.19, 0.86), vec3_make(0.46, 0.53, 0.86), 0.012, 8);
}

void accident_car(const struct accident *a, const struct car_damage *damage, uint16_t paint,
                  struct pose world_from_car, double steer_rad) {
    add_body(a, damage, paint, world_from_car);
    for (int side = -1; side <= 1; side += 2) {
        double back = side > 0 ? 0.55 * (double)damage->front_m : 0;
        add_wheel(a, world_from_car, 1.3 - back, side * 0.755, steer_rad + 0.4 * back);
        add_wheel(a, world_from_car, -1.3, side * 0.755, 0);
    }
    add_bumpers(a, damage, world_from_car);
    add_lamps(a, damage, world_from_car);
    add_interior(a, world_from_car);
}
