/* `heritage`: a vaulted church. Nave of four bays between two aisles, columns with capitals, groin
 * vaults with ribs, clerestory windows through which the sun falls, niches with statues, a tomb, a
 * balustrade before the choir, a glass case, an iron gate. x runs along the nave to the east, y to
 * the north. */
#include "twin/noise3.h"
#include "twin/scene_build.h"

#include <math.h>

enum { BAYS = 4 };
static const double pi = 3.14159265358979323846;
static const double bay_m = 4.5, nave_half_m = 3.5, aisle_out_m = 6.6, west_m = -9, east_m = 9;
static const double wall_m = 0.7, column_top_m = 4.3, arcade_top_m = 6.9, spring_m = 8.4,
                    rise_m = 3.2;
static const double aisle_spring_m = 4.9, aisle_rise_m = 1.3, choir_step_m = 0.36, choir_x_m = 5.2;

struct heritage {
    struct scene *scene;
    double detail;
    uint16_t ashlar, stone, plaster, marble, floor, iron, wood, glass, bronze, gold, velvet, wax,
        flame;
};

static struct material stuff(const char *name, enum material_kind kind,
                             enum material_texture texture, const float rgb[3], const float rgb2[3],
                             float albedo_ir) {
    struct material m = {.kind = kind,
                         .texture = texture,
                         .albedo_ir = albedo_ir,
                         .f0 = 0.03f,
                         .roughness = 0.7f,
                         .bump = 0.5f,
                         .scale_m = 0.4f,
                         .seed = 7};
    for (size_t i = 0; i + 1 < sizeof m.name && name[i]; i++)
        m.name[i] = name[i];
    for (int i = 0; i < 3; i++) {
        m.rgb[i] = rgb[i];
        m.rgb2[i] = rgb2[i];
    }
    return m;
}

static void add_stone_materials(struct heritage *h) {
    static const float warm[3] = {0.56f, 0.49f, 0.39f}, joint[3] = {0.36f, 0.32f, 0.27f};
    static const float lime[3] = {0.72f, 0.68f, 0.60f}, stain[3] = {0.55f, 0.50f, 0.42f};
    static const float pale[3] = {0.66f, 0.62f, 0.55f}, vein[3] = {0.42f, 0.40f, 0.38f};
    static const float red[3] = {0.42f, 0.20f, 0.14f}, cream[3] = {0.62f, 0.56f, 0.44f};
    struct material m = stuff("ashlar", MATERIAL_MATT, TEXTURE_ASHLAR, warm, joint, 0.52f);
    m.scale_m = 0.55f;
    h->ashlar = scene_add_material(h->scene, m);
    m = stuff("sandstone", MATERIAL_MATT, TEXTURE_STONE, pale, warm, 0.58f);
    m.scale_m = 0.25f;
    h->stone = scene_add_material(h->scene, m);
    h->plaster = scene_add_material(
        h->scene, stuff("limewash", MATERIAL_MATT, TEXTURE_PLASTER, lime, stain, 0.7f));
    m = stuff("marble", MATERIAL_COATED, TEXTURE_MARBLE, pale, vein, 0.6f);
    m.f0 = 0.04f;
    m.roughness = 0.15f;
    m.bump = 0;
    h->marble = scene_add_material(h->scene, m);
    m = stuff("floor", MATERIAL_MATT, TEXTURE_FLOOR, cream, red, 0.45f);
    m.scale_m = 0.42f;
    m.roughness = 0.35f;
    m.f0 = 0.04f;
    h->floor = scene_add_material(h->scene, m);
}

static void add_other_materials(struct heritage *h) {
    static const float black[3] = {0.035f, 0.035f, 0.04f}, rust[3] = {0.14f, 0.07f, 0.04f};
    static const float oak[3] = {0.26f, 0.15f, 0.08f}, dark[3] = {0.12f, 0.07f, 0.04f};
    static const float bronze[3] = {0.44f, 0.29f, 0.14f}, green[3] = {0.20f, 0.36f, 0.29f};
    static const float gold[3] = {0.95f, 0.68f, 0.28f}, wine[3] = {0.30f, 0.03f, 0.05f};
    static const float wax[3] = {0.85f, 0.80f, 0.66f}, clear[3] = {0.95f, 0.97f, 0.96f};
    struct material m = stuff("wrought iron", MATERIAL_MATT, TEXTURE_RUST, black, rust, 0.08f);
    m.scale_m = 0.1f;
    h->iron = scene_add_material(h->scene, m);
    m = stuff("oak", MATERIAL_COATED, TEXTURE_WOOD, oak, dark, 0.4f);
    m.roughness = 0.3f;
    m.scale_m = 0.2f;
    h->wood = scene_add_material(h->scene, m);
    m = stuff("pane", MATERIAL_GLASS, TEXTURE_PLAIN, clear, clear, 0.02f);
    m.f0 = 0.05f;
    m.roughness = 0;
    m.transmission_ir = 0.84f;
    h->glass = scene_add_material(h->scene, m);
    m = stuff("bronze", MATERIAL_MATT, TEXTURE_STONE, bronze, green, 0.3f);
    m.f0 = 0.3f;
    m.roughness = 0.35f;
    m.scale_m = 0.08f;
    h->bronze = scene_add_material(h->scene, m);
    m = stuff("gilding", MATERIAL_METAL, TEXTURE_BRUSHED, gold, bronze, 0.5f);
    m.f0 = 0.8f;
    m.roughness = 0.25f;
    h->gold = scene_add_material(h->scene, m);
    h->velvet = scene_add_material(
        h->scene, stuff("velvet", MATERIAL_MATT, TEXTURE_VELVET, wine, wine, 0.25f));
    h->wax =
        scene_add_material(h->scene, stuff("wax", MATERIAL_MATT, TEXTURE_PLAIN, wax, wax, 0.75f));
    m = stuff("flame", MATERIAL_EMITTER, TEXTURE_PLAIN, wax, wax, 0.1f);
    m.emission[0] = 9;
    m.emission[1] = 5;
    m.emission[2] = 1.8f;
    h->flame = scene_add_material(h->scene, m);
}

static struct shaper part_at(const struct heritage *h, uint16_t material, double x, double y,
                             double z, double yaw) {
    return scene_shaper(h->scene, material, shaper_frame(vec3_make(x, y, z), yaw, 0, 0));
}

/* A frame whose local xy plane is upright: local x along the wall, y up, thickness along -z. */
static struct shaper upright(const struct heritage *h, uint16_t material, double x, double y,
                             double yaw) {
    return scene_shaper(h->scene, material, shaper_frame(vec3_make(x, y, 0), yaw, 0, pi / 2));
}

/* ---- walls with openings ---- */

enum { ARC_MAX = 40, OUTLINE_MAX = ARC_MAX + 12 };

/* An upright panel of `width` from z0 to z1 with a round-arched opening from `sill` to `spring` +
 * half; sill <= z0 leaves it open below. Thickness wall_m centred on the frame's plane. */
struct panel {
    double width_m, z0_m, z1_m, half_m, sill_m, spring_m;
};

static void shape_panel(const struct heritage *h, const struct shaper *s, const struct panel *p) {
    int arc = scene_scaled(ARC_MAX / 2, h->detail, 6);
    for (int side = -1; side <= 1; side += 2) {
        struct vec2 outline[OUTLINE_MAX];
        int n = 0;
        double w = side * p->width_m / 2, a = side * p->half_m;
        outline[n++] = (struct vec2){w, p->z0_m};
        if (p->sill_m > p->z0_m) {
            outline[n++] = (struct vec2){0, p->z0_m};
            outline[n++] = (struct vec2){0, p->sill_m};
            outline[n++] = (struct vec2){a, p->sill_m};
        } else {
            outline[n++] = (struct vec2){a, p->z0_m};
        }
        for (int i = 0; i <= arc; i++) {
            double t = pi / 2 * i / arc;
            if (i == 0 && p->spring_m <= p->z0_m)
                continue; /* the corner is there already */
            outline[n++] = (struct vec2){a * cos(t), p->spring_m + p->half_m * sin(t)};
        }
        outline[n++] = (struct vec2){0, p->z1_m};
        outline[n++] = (struct vec2){w, p->z1_m};
        if (side > 0) /* counter-clockwise */
            for (int i = 0; i < n / 2; i++) {
                struct vec2 swap = outline[i];
                outline[i] = outline[n - 1 - i];
                outline[n - 1 - i] = swap;
            }
        shape_prism(s, outline, n, -wall_m / 2, wall_m / 2);
    }
}

/* A moulding that follows an arch on the wall's face at depth z. */
static void shape_archivolt(const struct heritage *h, const struct shaper *s, double half_m,
                            double spring, double z_m, double radius_m) {
    enum { POINTS = 25 };
    struct vec3 path[POINTS];
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = pi * i / (POINTS - 1);
        path[i] = vec3_make(half_m * cos(t), spring + half_m * sin(t), z_m);
        radius[i] = radius_m;
    }
    shape_tube(s, path, radius, POINTS, scene_scaled(10, h->detail, 6));
}

/* ---- columns ---- */

struct shaft_ctx {
    double z0_m, z1_m, r0_m, r1_m;
    int flutes;
};

static struct vec3 shaft_at(const void *ctx, double u, double v) {
    const struct shaft_ctx *c = ctx;
    double r = c->r0_m + (c->r1_m - c->r0_m) * v + 0.012 * sin(pi * v); /* entasis */
    double ends = fmin(1, fmin(v, 1 - v) * 25);
    double flute = fabs(sin(c->flutes * pi * u));
    r -= 0.028 * ends * (1 - flute * flute * flute);
    double t = 2 * pi * u;
    return vec3_make(r * cos(t), r * sin(t), c->z0_m + (c->z1_m - c->z0_m) * v);
}

/* The bell of a capital with two rows of leaves that curl outwards. */
static struct vec3 bell_at(const void *ctx, double u, double v) {
    const struct shaft_ctx *c = ctx;
    double r = c->r0_m + (c->r1_m - c->r0_m) * v * v;
    double row = v < 0.5 ? v / 0.5 : (v - 0.5) / 0.5;
    double phase = v < 0.5 ? 0 : 0.5;
    double leaf = pow(fabs(cos(pi * (8 * u + phase))), 0.6);
    double vein = 1 - 0.25 * fabs(sin(pi * 5 * (8 * u + phase)));
    r += 0.055 * leaf * vein * pow(row, 2.2) * (1 - 0.75 * noise3_smooth(0.9f, 1.0f, (float)row));
    double t = 2 * pi * u, square = 1 + 0.08 * v * v * cos(4 * t + pi);
    return vec3_make(r * square * cos(t), r * square * sin(t), c->z0_m + (c->z1_m - c->z0_m) * v);
}

static void add_column(const struct heritage *h, double x, double y) {
    static const struct vec2 base[] = {{0.46, 0.18}, {0.48, 0.20}, {0.50, 0.24}, {0.50, 0.28},
                                       {0.47, 0.32}, {0.42, 0.34}, {0.40, 0.37}, {0.40, 0.40},
                                       {0.44, 0.43}, {0.45, 0.46}, {0.43, 0.49}, {0.37, 0.51}};
    static const struct vec2 neck[] = {
        {0.33, 3.52}, {0.36, 3.54}, {0.37, 3.57}, {0.36, 3.60}, {0.33, 3.62}};
    int around = scene_scaled(240, h->detail, 48);
    struct shaper s = part_at(h, h->stone, x, y, 0, 0.1 * x + y);
    shape_box(&s, vec3_make(-0.55, -0.55, 0), vec3_make(0.55, 0.55, 0.18), 0.015);
    shape_lathe(&s, base, sizeof base / sizeof base[0], scene_scaled(96, h->detail, 24));
    shape_lathe(&s, neck, sizeof neck / sizeof neck[0], scene_scaled(96, h->detail, 24));
    struct shaft_ctx shaft = {0.51, 3.53, 0.36, 0.325, 20};
    shape_grid(&s, shaft_at, &shaft, around, scene_scaled(48, h->detail, 12), SHAPE_CLOSED_U);
    struct shaft_ctx bell = {3.61, 4.12, 0.33, 0.47, 0};
    shape_grid(&s, bell_at, &bell, around, scene_scaled(60, h->detail, 16), SHAPE_CLOSED_U);
    struct shaper square = part_at(h, h->stone, x, y, 0, 0);
    shape_box(&square, vec3_make(-0.58, -0.58, 4.10), vec3_make(0.58, 0.58, 4.2), 0.03);
    shape_box(&square, vec3_make(-0.52, -0.52, 4.2), vec3_make(0.52, 0.52, column_top_m), 0.01);
}

/* ---- vaults ---- */

struct vault_ctx {
    double width_m, depth_m, spring_m, rise_m;
};

/* Two elliptic barrels crossing over a bay, the higher one counts. */
static struct vec3 groin_at(const void *ctx, double u, double v) {
    const struct vault_ctx *c = ctx;
    double x = 2 * u - 1, y = 2 * v - 1;
    double hx = sqrt(fmax(0, 1 - x * x)), hy = sqrt(fmax(0, 1 - y * y));
    return vec3_make(x * c->width_m / 2, -y * c->depth_m / 2,
                     c->spring_m + c->rise_m * fmax(hx, hy));
}

static struct vec3 barrel_at(const void *ctx, double u, double v) {
    const struct vault_ctx *c = ctx;
    double t = pi * v;
    return vec3_make((u - 0.5) * c->width_m, -cos(t) * c->depth_m / 2,
                     c->spring_m + c->rise_m * sin(t));
}

/* A rib from corner to corner of a bay; dx, dy are +-1, 0 for a transverse arch. */
static void add_rib(const struct heritage *h, const struct shaper *s, double x, double dx_m,
                    double dy_m) {
    enum { POINTS = 33 };
    struct vec3 path[POINTS];
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = -cos(pi * i / (POINTS - 1));
        path[i] = vec3_make(x + t * dx_m, t * dy_m, spring_m + rise_m * sqrt(fmax(0, 1 - t * t)));
        radius[i] = dx_m == 0 ? 0.17 : 0.10;
    }
    shape_tube(s, path, radius, POINTS, scene_scaled(14, h->detail, 6));
}

static void add_vaults(const struct heritage *h) {
    struct vault_ctx nave = {bay_m, 2 * nave_half_m, spring_m, rise_m};
    struct vault_ctx aisle = {BAYS * bay_m, aisle_out_m - nave_half_m, aisle_spring_m,
                              aisle_rise_m};
    int cells = scene_scaled(64, h->detail, 16);
    struct shaper ribs = part_at(h, h->stone, 0, 0, 0, 0);
    for (int i = 0; i < BAYS; i++) {
        double x = west_m + (i + 0.5) * bay_m;
        struct shaper s = part_at(h, h->plaster, x, 0, 0, 0);
        shape_grid(&s, groin_at, &nave, cells, cells, SHAPE_FLAT);
        add_rib(h, &ribs, x, bay_m / 2, nave_half_m);
        add_rib(h, &ribs, x, bay_m / 2, -nave_half_m);
        struct shaper boss = part_at(h, h->gold, x, 0, spring_m + rise_m - 0.12, 0);
        shape_ellipsoid(&boss, vec3_make(0, 0, 0), vec3_make(0.26, 0.26, 0.14),
                        scene_scaled(32, h->detail, 12));
    }
    for (int i = 0; i <= BAYS; i++)
        add_rib(h, &ribs, west_m + i * bay_m, 0, nave_half_m);
    for (int side = -1; side <= 1; side += 2) {
        struct shaper s = part_at(h, h->plaster, 0, side * (aisle_out_m + nave_half_m) / 2, 0, 0);
        shape_grid(&s, barrel_at, &aisle, cells, cells, 0);
    }
}

/* ---- statues ---- */

struct figure {
    uint32_t seed;
    float raise; /* of the right hand, 0 at the chest .. 1 above the head */
    float turn;  /* of the head */
    int staff;
};

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

static void add_statue(const struct heritage *h, const struct figure *f, uint16_t material,
                       double x, double y, double z, double yaw) {
    struct shaper s = part_at(h, material, x, y, z, yaw);
    struct sdf_job job = {.distance = figure_distance,
                          .ctx = f,
                          .min = {-0.45, -0.48, -0.1},
                          .max = {0.5, 0.48, 2.1},
                          .cell_m = 0.012 / h->detail,
                          .slack = 1.6};
    sdf_mesh(&s, &job);
}

/* ---- niches in the outer walls ---- */

struct niche_ctx {
    double half_m, sill_m, spring_m;
};

/* u around from one edge to the other, v up: a half cylinder, then a quarter sphere. */
static struct vec3 niche_at(const void *ctx, double u, double v) {
    const struct niche_ctx *c = ctx;
    double t = pi * u,
           wall = (c->spring_m - c->sill_m) / (c->spring_m - c->sill_m + pi / 2 * c->half_m);
    if (v <= wall)
        return vec3_make(c->half_m * cos(t), c->sill_m + (c->spring_m - c->sill_m) * v / wall,
                         -c->half_m * sin(t));
    double e = pi / 2 * (v - wall) / (1 - wall);
    double shell = 1 + 0.035 * sin(e) * cos(18 * t) * cos(e); /* scalloped like a shell */
    return vec3_make(c->half_m * cos(t) * cos(e) * shell, c->spring_m + c->half_m * sin(e) * shell,
                     -c->half_m * sin(t) * cos(e) * shell);
}

/* One bay of the outer wall at y = side * aisle_out_m with a niche and a statue in it. */
static void add_niche_bay(const struct heritage *h, int bay, int side) {
    double x = west_m + (bay + 0.5) * bay_m, y = side * (aisle_out_m + wall_m / 2);
    double yaw = side > 0 ? 0 : pi; /* the frame's +z faces the aisle */
    struct shaper wall = upright(h, h->ashlar, x, y, yaw);
    struct panel panel = {bay_m, 0, aisle_spring_m + aisle_rise_m, 0.62, 0.95, 2.75};
    shape_panel(h, &wall, &panel);
    struct shaper inside = upright(h, h->plaster, x, y - side * wall_m / 2, yaw);
    struct niche_ctx niche = {0.62, 0.95, 2.75};
    shape_grid(&inside, niche_at, &niche, scene_scaled(72, h->detail, 16),
               scene_scaled(64, h->detail, 16), 0);
    struct shaper trim = upright(h, h->stone, x, y, yaw);
    shape_archivolt(h, &trim, 0.68, 2.75, wall_m / 2, 0.06);
    shape_bar(&trim, vec3_make(-0.68, 0.95, wall_m / 2), vec3_make(-0.68, 2.75, wall_m / 2), 0.06,
              scene_scaled(16, h->detail, 6));
    shape_bar(&trim, vec3_make(0.68, 0.95, wall_m / 2), vec3_make(0.68, 2.75, wall_m / 2), 0.06,
              scene_scaled(16, h->detail, 6));
    struct shaper sill = part_at(h, h->stone, x, y - side * wall_m / 2, 0, yaw);
    shape_box(&sill, vec3_make(-0.85, -0.16, 0.83), vec3_make(0.85, 0.7, 0.95), 0.02);
    uint32_t seed = (uint32_t)(bay * 2 + (side > 0));
    struct figure f = {.seed = (uint32_t)h->scene->seed * 16 + seed,
                       .raise = (float)(seed * 3 % 5) / 5,
                       .turn = 0.5f * ((float)(seed * 7 % 5) / 2 - 1),
                       .staff = seed % 3 == 1};
    add_statue(h, &f, seed % 4 == 2 ? h->bronze : h->marble, x, y + side * (-wall_m / 2 + 0.12),
               1.0, side > 0 ? -pi / 2 : pi / 2);
}

/* ---- shell of the building ---- */

static void add_clerestory(const struct heritage *h) {
    for (int side = -1; side <= 1; side += 2)
        for (int i = 0; i < BAYS; i++) {
            double x = west_m + (i + 0.5) * bay_m, y = side * nave_half_m;
            struct shaper arcade = upright(h, h->ashlar, x, y, 0);
            struct panel arch = {bay_m,           column_top_m, arcade_top_m,
                                 bay_m / 2 - 0.5, column_top_m, column_top_m};
            shape_panel(h, &arcade, &arch);
            struct panel window = {bay_m, arcade_top_m, spring_m + rise_m, 0.75, 7.4, 9.0};
            shape_panel(h, &arcade, &window);
            struct shaper trim = upright(h, h->stone, x, y, 0);
            for (int face = -1; face <= 1; face += 2) {
                shape_archivolt(h, &trim, bay_m / 2 - 0.5, column_top_m, face * wall_m / 2, 0.07);
                shape_archivolt(h, &trim, 0.82, 9.0, face * wall_m / 2, 0.06);
            }
            /* string course, mullions and glazing bars */
            shape_bar(&trim, vec3_make(-bay_m / 2, arcade_top_m, -side * wall_m / 2),
                      vec3_make(bay_m / 2, arcade_top_m, -side * wall_m / 2), 0.07, 12);
            shape_bar(&trim, vec3_make(0, 7.4, 0), vec3_make(0, 9.75, 0), 0.055, 10);
            struct shaper bars = upright(h, h->iron, x, y, 0);
            for (int k = 1; k < 5; k++)
                shape_bar(&bars, vec3_make(-0.75, 7.4 + 0.36 * k, 0),
                          vec3_make(0.75, 7.4 + 0.36 * k, 0), 0.012, 6);
        }
}

static void add_end_walls(const struct heritage *h) {
    double top_m = spring_m + rise_m + 0.3;
    /* west: a portal with a wooden door; east: three blind bays behind the altar */
    struct shaper west = upright(h, h->ashlar, west_m - wall_m / 2, 0, pi / 2);
    struct panel portal = {2 * nave_half_m, 0, top_m, 1.15, 0, 2.4};
    shape_panel(h, &west, &portal);
    struct shaper door = part_at(h, h->wood, west_m - 0.25, 0, 0, 0);
    for (int i = 0; i < 9; i++)
        shape_box(&door, vec3_make(-0.09, -1.15 + 0.256 * i, 0),
                  vec3_make(0.0, -1.15 + 0.256 * (i + 1) - 0.012, 3.6), 0.008);
    struct shaper hinge = part_at(h, h->iron, west_m - 0.24, 0, 0, 0);
    for (int i = 0; i < 3; i++)
        shape_box(&hinge, vec3_make(0, -1.1, 0.5 + 1.1 * i), vec3_make(0.015, 1.1, 0.57 + 1.1 * i),
                  0.005);
    struct shaper trim = upright(h, h->stone, west_m - wall_m / 2, 0, pi / 2);
    for (int k = 0; k < 3; k++)
        shape_archivolt(h, &trim, 1.2 + 0.14 * k, 2.4, wall_m / 2 + 0.05 - 0.04 * k, 0.06);
    struct shaper east = upright(h, h->plaster, east_m + wall_m / 2, 0, pi / 2);
    struct panel blind = {2 * nave_half_m, 0, top_m, 1.0, 6.2, 8.2}; /* an east window */
    shape_panel(h, &east, &blind);
    for (int side = -1; side <= 1; side += 2)
        for (int end = -1; end <= 1; end += 2) {
            double y = side * (aisle_out_m + nave_half_m) / 2, width = aisle_out_m - nave_half_m;
            struct shaper s = upright(h, h->ashlar, end * (east_m + wall_m / 2), y, pi / 2);
            if (side > 0 && end > 0) { /* arch to the chapel behind the gate */
                struct panel arch = {width, 0, aisle_spring_m + aisle_rise_m, 1.05, 0, 2.5};
                shape_panel(h, &s, &arch);
            } else {
                struct vec2 solid[4] = {{-width / 2, 0},
                                        {width / 2, 0},
                                        {width / 2, aisle_spring_m + aisle_rise_m},
                                        {-width / 2, aisle_spring_m + aisle_rise_m}};
                shape_prism(&s, solid, 4, -wall_m / 2, wall_m / 2);
            }
        }
}

static void add_floor(const struct heritage *h) {
    struct shaper s = part_at(h, h->floor, 0, 0, 0, 0);
    double x0 = west_m - wall_m, x1 = east_m + 4, y = aisle_out_m + wall_m;
    shape_quad(&s, vec3_make(x0, -y, 0), vec3_make(x1, -y, 0), vec3_make(x1, y, 0),
               vec3_make(x0, y, 0));
    struct shaper step = part_at(h, h->marble, 0, 0, 0, 0);
    double w = nave_half_m - 0.6;
    shape_box(&step, vec3_make(choir_x_m - 0.35, -w, 0), vec3_make(east_m, w, choir_step_m / 2),
              0.012);
    shape_box(&step, vec3_make(choir_x_m, -w, 0), vec3_make(east_m, w, choir_step_m), 0.012);
}

/* ---- furniture ---- */

static void add_balustrade(const struct heritage *h) {
    static const struct vec2 baluster[] = {
        {0.075, 0.10}, {0.08, 0.12}, {0.06, 0.15},  {0.05, 0.18},  {0.07, 0.26},
        {0.088, 0.34}, {0.08, 0.44}, {0.055, 0.55}, {0.042, 0.66}, {0.045, 0.70},
        {0.065, 0.73}, {0.06, 0.76}, {0.05, 0.78},  {0.075, 0.82}};
    int around = scene_scaled(36, h->detail, 12);
    for (int side = -1; side <= 1; side += 2) {
        double y0 = side * 0.8, y1 = side * (nave_half_m - 0.65);
        double x = choir_x_m + 0.25;
        struct shaper s = part_at(h, h->marble, x, 0, choir_step_m, 0);
        double lo = fmin(y0, y1), hi = fmax(y0, y1);
        shape_box(&s, vec3_make(-0.13, lo, 0), vec3_make(0.13, hi, 0.1), 0.01);
        shape_box(&s, vec3_make(-0.15, lo - 0.02, 0.82), vec3_make(0.15, hi + 0.02, 0.95), 0.025);
        shape_box(&s, vec3_make(-0.17, y0 - 0.17, 0), vec3_make(0.17, y0 + 0.17, 1.02), 0.02);
        shape_ellipsoid(&s, vec3_make(0, y0, 1.15), vec3_make(0.14, 0.14, 0.14), around);
        for (int i = 0; i < 9; i++) {
            double y = y0 + (y1 - y0) * (i + 0.9) / 9.4;
            struct shaper post = part_at(h, h->marble, x, y, choir_step_m, 0);
            shape_lathe(&post, baluster, sizeof baluster / sizeof baluster[0], around);
            shape_box(&post, vec3_make(-0.08, -0.08, 0.09), vec3_make(0.08, 0.08, 0.11), 0);
        }
    }
}

static void add_altar(const struct heritage *h) {
    struct shaper stone = part_at(h, h->marble, 7.6, 0, choir_step_m, 0);
    shape_box(&stone, vec3_make(-0.5, -1.2, 0), vec3_make(0.5, 1.2, 0.12), 0.01);
    shape_box(&stone, vec3_make(-0.38, -1.05, 0.12), vec3_make(0.38, 1.05, 0.94), 0.015);
    shape_box(&stone, vec3_make(-0.48, -1.25, 0.94), vec3_make(0.48, 1.25, 1.04), 0.02);
    struct shaper cloth = part_at(h, h->velvet, 7.6, 0, choir_step_m, 0);
    shape_box(&cloth, vec3_make(-0.505, -0.6, 0.45), vec3_make(0.505, 0.6, 1.055), 0.01);
    struct shaper gold = part_at(h, h->gold, 7.75, 0, choir_step_m + 1.05, 0);
    shape_box(&gold, vec3_make(-0.03, -0.03, 0), vec3_make(0.03, 0.03, 0.95), 0.005);
    shape_box(&gold, vec3_make(-0.03, -0.26, 0.6), vec3_make(0.03, 0.26, 0.66), 0.005);
    static const struct vec2 stick[] = {{0.09, 0.0},   {0.1, 0.02},   {0.03, 0.06}, {0.025, 0.2},
                                        {0.045, 0.23}, {0.025, 0.26}, {0.02, 0.44}, {0.06, 0.47}};
    for (int side = -1; side <= 1; side += 2)
        for (int k = 0; k < 2; k++) {
            double y = side * (0.65 + 0.32 * k);
            struct shaper s = part_at(h, h->gold, 7.65, y, choir_step_m + 1.04, 0);
            shape_lathe(&s, stick, sizeof stick / sizeof stick[0], scene_scaled(32, h->detail, 10));
            struct shaper wax = part_at(h, h->wax, 7.65, y, choir_step_m + 1.5, 0);
            shape_bar(&wax, vec3_make(0, 0, 0), vec3_make(0, 0, 0.28 - 0.06 * k), 0.02, 16);
            struct shaper flame = part_at(h, h->flame, 7.65, y, choir_step_m + 1.82 - 0.06 * k, 0);
            shape_ellipsoid(&flame, vec3_make(0, 0, 0), vec3_make(0.009, 0.009, 0.028), 12);
        }
}

/* A stone tomb in the south aisle with a sleeping figure on it. */
static void add_tomb(const struct heritage *h) {
    struct shaper s = part_at(h, h->stone, -2.25, -5.4, 0, 0);
    shape_box(&s, vec3_make(-1.15, -0.5, 0), vec3_make(1.15, 0.5, 0.16), 0.02);
    shape_box(&s, vec3_make(-1.02, -0.4, 0.16), vec3_make(1.02, 0.4, 0.78), 0.01);
    shape_box(&s, vec3_make(-1.12, -0.48, 0.78), vec3_make(1.12, 0.48, 0.9), 0.025);
    for (int i = 0; i < 5; i++) { /* blind arcade along the side */
        struct shaper shield = part_at(h, h->marble, -2.25 - 0.8 + 0.4 * i, -5.4 + 0.4, 0.47, 0);
        shape_ellipsoid(&shield, vec3_make(0, 0, 0), vec3_make(0.13, 0.035, 0.18),
                        scene_scaled(32, h->detail, 12));
    }
    static const struct figure sleeper = {.seed = 91, .raise = 0.05f, .turn = 0.1f};
    struct pose lying = shaper_frame(vec3_make(-2.25 + 0.85, -5.4, 1.06), pi, -pi / 2, 0);
    lying.t_m.x = -2.25 - 0.85;
    struct shaper body = scene_shaper(h->scene, h->marble, shaper_frame(lying.t_m, pi, -pi / 2, 0));
    struct sdf_job job = {.distance = figure_distance,
                          .ctx = &sleeper,
                          .min = {-0.45, -0.48, -0.1},
                          .max = {0.5, 0.48, 1.85},
                          .cell_m = 0.012 / h->detail,
                          .slack = 1.6};
    sdf_mesh(&body, &job);
}

static void add_glass_case(const struct heritage *h) {
    double x = -6.7, y = 5.1, z0 = 0.85, z1 = 1.7, a = 0.42;
    struct shaper base = part_at(h, h->wood, x, y, 0, 0);
    shape_box(&base, vec3_make(-a - 0.04, -a - 0.04, 0), vec3_make(a + 0.04, a + 0.04, 0.1), 0.01);
    shape_box(&base, vec3_make(-a, -a, 0.1), vec3_make(a, a, z0 - 0.05), 0.01);
    shape_box(&base, vec3_make(-a - 0.03, -a - 0.03, z0 - 0.05), vec3_make(a + 0.03, a + 0.03, z0),
              0.01);
    struct shaper cloth = part_at(h, h->velvet, x, y, z0, 0);
    shape_box(&cloth, vec3_make(-0.3, -0.3, 0), vec3_make(0.3, 0.3, 0.03), 0.008);
    struct shaper pane = part_at(h, h->glass, x, y, 0, 0);
    struct vec3 lo[4] = {{-a, -a, z0}, {a, -a, z0}, {a, a, z0}, {-a, a, z0}};
    for (int i = 0; i < 4; i++) {
        struct vec3 p = lo[i], q = lo[(i + 1) % 4];
        shape_quad(&pane, p, q, vec3_make(q.x, q.y, z1), vec3_make(p.x, p.y, z1));
    }
    shape_quad(&pane, vec3_make(-a, -a, z1), vec3_make(a, -a, z1), vec3_make(a, a, z1),
               vec3_make(-a, a, z1));
    struct shaper frame = part_at(h, h->bronze, x, y, 0, 0);
    for (int i = 0; i < 4; i++) {
        struct vec3 p = lo[i], q = lo[(i + 1) % 4];
        shape_bar(&frame, p, vec3_make(p.x, p.y, z1), 0.01, 8);
        shape_bar(&frame, vec3_make(p.x, p.y, z1), vec3_make(q.x, q.y, z1), 0.01, 8);
    }
    static const struct vec2 vase[] = {{0.001, 0.03},  {0.09, 0.03},  {0.095, 0.05}, {0.05, 0.08},
                                       {0.06, 0.12},   {0.13, 0.22},  {0.16, 0.32},  {0.14, 0.42},
                                       {0.07, 0.5},    {0.055, 0.56}, {0.07, 0.62},  {0.1, 0.66},
                                       {0.085, 0.655}, {0.05, 0.58}};
    struct shaper gold = part_at(h, h->gold, x, y, z0, 0);
    shape_lathe(&gold, vase, sizeof vase / sizeof vase[0], scene_scaled(72, h->detail, 20));
}

/* A wrought-iron gate in the arch at the east end of the north aisle, one leaf ajar. */
static void add_gate_leaf(const struct heritage *h, double y, double yaw, double width_m) {
    struct shaper s = part_at(h, h->iron, east_m + wall_m / 2, y, 0, yaw);
    double top = 2.35;
    shape_box(&s, vec3_make(0, -0.015, 0.08), vec3_make(width_m, 0.015, 0.13), 0.004);
    shape_box(&s, vec3_make(0, -0.015, 1.1), vec3_make(width_m, 0.015, 1.14), 0.004);
    shape_box(&s, vec3_make(0, -0.015, top - 0.05), vec3_make(width_m, 0.015, top), 0.004);
    int bars = 8;
    for (int i = 0; i <= bars; i++) {
        double x = width_m * i / bars;
        shape_bar(&s, vec3_make(x, 0, 0.06), vec3_make(x, 0, top + 0.2), i % bars ? 0.011 : 0.018,
                  8);
        shape_ellipsoid(&s, vec3_make(x, 0, top + 0.25), vec3_make(0.022, 0.012, 0.07), 10);
    }
    for (int i = 0; i < bars; i++) { /* scrolls in pairs between the bars */
        enum { POINTS = 28 };
        struct vec3 path[POINTS];
        double radius[POINTS];
        double cx = width_m * (i + 0.5) / bars, turn = i % 2 ? 1 : -1;
        for (int k = 0; k < POINTS; k++) {
            double t = 3.6 * pi * k / (POINTS - 1), r = 0.048 * (1 - 0.8 * k / (POINTS - 1));
            path[k] = vec3_make(cx + turn * r * cos(t), 0, 1.28 + r * sin(t) + 0.03 * sin(t / 3.6));
            radius[k] = 0.006;
        }
        shape_tube(&s, path, radius, POINTS, 6);
        for (int k = 0; k < POINTS; k++)
            path[k].z += 0.78;
        shape_tube(&s, path, radius, POINTS, 6);
    }
}

static void add_chapel(const struct heritage *h) {
    double y = (aisle_out_m + nave_half_m) / 2, x0 = east_m + wall_m, x1 = x0 + 2.8, w = 1.5;
    struct shaper s = part_at(h, h->plaster, 0, 0, 0, 0);
    shape_quad(&s, vec3_make(x1, y + w, 0), vec3_make(x1, y - w, 0), vec3_make(x1, y - w, 4),
               vec3_make(x1, y + w, 4));
    shape_quad(&s, vec3_make(x0, y + w, 0), vec3_make(x1, y + w, 0), vec3_make(x1, y + w, 4),
               vec3_make(x0, y + w, 4));
    shape_quad(&s, vec3_make(x1, y - w, 0), vec3_make(x0, y - w, 0), vec3_make(x0, y - w, 4),
               vec3_make(x1, y - w, 4));
    shape_quad(&s, vec3_make(x0, y - w, 4), vec3_make(x0, y + w, 4), vec3_make(x1, y + w, 4),
               vec3_make(x1, y - w, 4));
    static const struct figure saint = {.seed = 33, .raise = 0.9f, .turn = -0.2f, .staff = 1};
    struct shaper plinth = part_at(h, h->marble, x0 + 1.7, y, 0, 0);
    shape_box(&plinth, vec3_make(-0.4, -0.4, 0), vec3_make(0.4, 0.4, 0.7), 0.02);
    add_statue(h, &saint, h->bronze, x0 + 1.7, y, 0.77, pi);
    add_gate_leaf(h, y - 1.05, pi / 2, 1.03);
    add_gate_leaf(h, y + 1.05, -pi / 2 + 0.75, 1.03);
}

static void add_pews(const struct heritage *h) {
    for (int side = -1; side <= 1; side += 2)
        for (int row = 0; row < 4; row++) {
            double x = -5.4 + 1.15 * row + 0.03 * side * row, y = side * 1.75;
            struct shaper s = part_at(h, h->wood, x, y, 0, 0.015 * (row - side));
            double w = 0.95;
            for (int end = -1; end <= 1; end += 2) {
                double a = end * w, b = end * (w - 0.06);
                shape_box(&s, vec3_make(-0.28, fmin(a, b), 0), vec3_make(0.24, fmax(a, b), 0.5),
                          0.01);
                shape_box(&s, vec3_make(-0.32, fmin(a, b), 0.45), vec3_make(-0.2, fmax(a, b), 1.0),
                          0.02);
            }
            shape_box(&s, vec3_make(-0.24, -w, 0.42), vec3_make(0.2, w, 0.46), 0.008);
            shape_box(&s, vec3_make(-0.29, -w, 0.6), vec3_make(-0.25, w, 0.94), 0.008);
            shape_box(&s, vec3_make(-0.42, -w, 0.72), vec3_make(-0.28, w, 0.75), 0.006);
        }
}

/* A ring of candles on chains over each second bay, and the light that it gives. */
static void add_chandelier(const struct heritage *h, double x, double z) {
    enum { ARMS = 10, POINTS = 41 };
    struct shaper iron = part_at(h, h->iron, x, 0, z, 0);
    struct vec3 path[POINTS];
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = 2 * pi * i / (POINTS - 1);
        path[i] = vec3_make(0.6 * cos(t), 0.6 * sin(t), 0);
        radius[i] = 0.016;
    }
    shape_tube(&iron, path, radius, POINTS, 8);
    for (int i = 0; i < ARMS; i++) {
        double t = 2 * pi * i / ARMS, cx = 0.6 * cos(t), cy = 0.6 * sin(t);
        if (i % 2 == 0)
            shape_bar(&iron, vec3_make(cx, cy, 0), vec3_make(0, 0, 1.2), 0.007, 6);
        struct shaper wax = part_at(h, h->wax, x + cx, cy, z, 0);
        shape_bar(&wax, vec3_make(0, 0, 0.01), vec3_make(0, 0, 0.17), 0.016, 10);
        struct shaper flame = part_at(h, h->flame, x + cx, cy, z + 0.2, 0);
        shape_ellipsoid(&flame, vec3_make(0, 0, 0), vec3_make(0.009, 0.009, 0.026), 10);
    }
    shape_bar(&iron, vec3_make(0, 0, 1.2), vec3_make(0, 0, spring_m + rise_m - z), 0.009, 6);
    struct scene_light glow = {.position_m = {x, 0, z + 0.45},
                               .dir = {0, 0, -1},
                               .radius_m = 0.4,
                               .cos_inner = -1,
                               .cos_outer = -1,
                               .rgb = {11, 7.2, 3.6}};
    scene_add_light(h->scene, glow);
}

static void add_lights(const struct heritage *h) {
    add_chandelier(h, -4.5, 4.6);
    add_chandelier(h, 1.5, 4.6);
    struct scene_light altar = {.position_m = {6.6, 0, 3.2},
                                .dir = {0.6, 0, -0.8},
                                .radius_m = 0.25,
                                .cos_inner = 0.3,
                                .cos_outer = -0.2,
                                .rgb = {9, 6.2, 3.4}};
    scene_add_light(h->scene, altar);
    for (int side = -1; side <= 1; side += 2)
        for (int k = 0; k < 2; k++) { /* lamps of the aisles */
            struct scene_light lamp = {.position_m = {-4.5 + 9.0 * k, side * 5.0, 4.1},
                                       .dir = {0, 0, -1},
                                       .radius_m = 0.15,
                                       .cos_inner = -1,
                                       .cos_outer = -1,
                                       .rgb = {4.5, 3.3, 2.0}};
            scene_add_light(h->scene, lamp);
        }
    struct scene_sky sky = {.zenith = {0.35, 0.55, 1.0},
                            .horizon = {0.85, 0.95, 1.1},
                            .ground = {0.25, 0.23, 0.2},
                            .sun_rgb = {11, 9.6, 7.6},
                            .sun_angle_rad = 0.0047};
    sky.sun_dir = vec3_unit(vec3_make(-0.25, -0.62, 0.74));
    h->scene->sky = sky;
}

void scene_heritage(struct scene *scene, double detail) {
    struct heritage h = {.scene = scene, .detail = detail};
    add_stone_materials(&h);
    add_other_materials(&h);
    add_floor(&h);
    for (int side = -1; side <= 1; side += 2) {
        for (int i = 0; i <= BAYS; i++)
            add_column(&h, west_m + i * bay_m, side * nave_half_m);
        for (int i = 0; i < BAYS; i++)
            add_niche_bay(&h, i, side);
    }
    add_clerestory(&h);
    add_end_walls(&h);
    add_vaults(&h);
    add_balustrade(&h);
    add_altar(&h);
    add_tomb(&h);
    add_glass_case(&h);
    add_chapel(&h);
    add_pews(&h);
    add_lights(&h);
    scene->max_range_m = 15;
    scene->ambient = 0.15;
    scene->exposure = 1.0;
    scene_add_stand(scene, "nave west", -7.6, 0, 0);
    scene_add_stand(scene, "before the choir", 3.6, 0.2, pi);
    scene_add_stand(scene, "north aisle", 2.2, 4.9, pi);
}
