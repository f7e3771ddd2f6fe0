/* `heritage`: a vaulted church. Nave of four bays between two aisles, columns with capitals, groin
 * vaults with ribs, clerestory windows through which the sun falls, niches with statues, a tomb, a
 * balustrade before the choir, a glass case, an iron gate. */
#include "twin/heritage.h"
#include "twin/noise3.h"

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
            double t = heritage_pi / 2 * i / arc;
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
        double t = heritage_pi * i / (POINTS - 1);
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
    double r = c->r0_m + (c->r1_m - c->r0_m) * v + 0.012 * sin(heritage_pi * v); /* entasis */
    double ends = fmin(1, fmin(v, 1 - v) * 25);
    double flute = fabs(sin(c->flutes * heritage_pi * u));
    r -= 0.028 * ends * (1 - flute * flute * flute);
    double t = 2 * heritage_pi * u;
    return vec3_make(r * cos(t), r * sin(t), c->z0_m + (c->z1_m - c->z0_m) * v);
}

/* The bell of a capital with two rows of leaves that curl outwards. */
static struct vec3 bell_at(const void *ctx, double u, double v) {
    const struct shaft_ctx *c = ctx;
    double r = c->r0_m + (c->r1_m - c->r0_m) * v * v;
    double row = v < 0.5 ? v / 0.5 : (v - 0.5) / 0.5;
    double phase = v < 0.5 ? 0 : 0.5;
    double leaf = pow(fabs(cos(heritage_pi * (8 * u + phase))), 0.6);
    double vein = 1 - 0.25 * fabs(sin(heritage_pi * 5 * (8 * u + phase)));
    r += 0.055 * leaf * vein * pow(row, 2.2) *
         (1 - 0.75 * (double)noise3_smooth(0.9f, 1.0f, (float)row));
    double t = 2 * heritage_pi * u, square = 1 + 0.08 * v * v * cos(4 * t + heritage_pi);
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

/* Half a barrel that rises from the outer wall to the nave; depth_m is signed, towards the nave. */
static struct vec3 half_barrel_at(const void *ctx, double u, double v) {
    const struct vault_ctx *c = ctx;
    double t = heritage_pi / 2 * v;
    return vec3_make((u - 0.5) * c->width_m, (0.5 - cos(t)) * c->depth_m,
                     c->spring_m + c->rise_m * sin(t));
}

/* A rib from corner to corner of a bay; dx, dy are +-1, 0 for a transverse arch. */
static void add_rib(const struct heritage *h, const struct shaper *s, double x, double dx_m,
                    double dy_m) {
    enum { POINTS = 33 };
    struct vec3 path[POINTS];
    double radius[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = -cos(heritage_pi * i / (POINTS - 1));
        path[i] = vec3_make(x + t * dx_m, t * dy_m, spring_m + rise_m * sqrt(fmax(0, 1 - t * t)));
        radius[i] = dx_m == 0 ? 0.17 : 0.10;
    }
    shape_tube(s, path, radius, POINTS, scene_scaled(14, h->detail, 6));
}

static void add_vaults(const struct heritage *h) {
    struct vault_ctx nave = {bay_m, 2 * nave_half_m, spring_m, rise_m};
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
        struct vault_ctx aisle = {BAYS * bay_m, -side * (aisle_out_m - nave_half_m), aisle_spring_m,
                                  aisle_rise_m};
        struct shaper s = part_at(h, h->plaster, 0, side * (aisle_out_m + nave_half_m) / 2, 0, 0);
        shape_grid(&s, half_barrel_at, &aisle, cells, cells, 0);
    }
}

/* ---- niches in the outer walls ---- */

struct niche_ctx {
    double half_m, sill_m, spring_m;
};

/* u around from one edge to the other, v up: a half cylinder, then a quarter sphere. */
static struct vec3 niche_at(const void *ctx, double u, double v) {
    const struct niche_ctx *c = ctx;
    double t = heritage_pi * u, wall = (c->spring_m - c->sill_m) /
                                       (c->spring_m - c->sill_m + heritage_pi / 2 * c->half_m);
    if (v <= wall)
        return vec3_make(c->half_m * cos(t), c->sill_m + (c->spring_m - c->sill_m) * v / wall,
                         -c->half_m * sin(t));
    double e = heritage_pi / 2 * (v - wall) / (1 - wall);
    double shell = 1 + 0.035 * sin(e) * cos(18 * t) * cos(e); /* scalloped like a shell */
    return vec3_make(c->half_m * cos(t) * cos(e) * shell, c->spring_m + c->half_m * sin(e) * shell,
                     -c->half_m * sin(t) * cos(e) * shell);
}

/* One bay of the outer wall at y = side * aisle_out_m with a niche and a statue in it. */
static void add_niche_bay(const struct heritage *h, int bay, int side) {
    double x = west_m + (bay + 0.5) * bay_m, y = side * (aisle_out_m + wall_m / 2);
    double yaw = side > 0 ? 0 : heritage_pi; /* the frame's +z faces the aisle */
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
    heritage_statue(h, &f, seed % 4 == 2 ? h->bronze : h->marble,
                    shaper_frame(vec3_make(x, y + side * (-wall_m / 2 + 0.12), 1.0),
                                 side > 0 ? -heritage_pi / 2 : heritage_pi / 2, 0, 0));
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
    struct shaper west = upright(h, h->ashlar, west_m - wall_m / 2, 0, heritage_pi / 2);
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
    struct shaper trim = upright(h, h->stone, west_m - wall_m / 2, 0, heritage_pi / 2);
    for (int k = 0; k < 3; k++)
        shape_archivolt(h, &trim, 1.2 + 0.14 * k, 2.4, wall_m / 2 + 0.05 - 0.04 * k, 0.06);
    struct shaper east = upright(h, h->plaster, east_m + wall_m / 2, 0, heritage_pi / 2);
    struct panel blind = {2 * nave_half_m, 0, top_m, 1.0, 6.2, 8.2}; /* an east window */
    shape_panel(h, &east, &blind);
    for (int side = -1; side <= 1; side += 2)
        for (int end = -1; end <= 1; end += 2) {
            double y = side * (aisle_out_m + nave_half_m) / 2, width = aisle_out_m - nave_half_m;
            struct shaper s =
                upright(h, h->ashlar, end * (east_m + wall_m / 2), y, heritage_pi / 2);
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

static void add_lights(const struct heritage *h) {
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
    heritage_furnish(&h);
    add_lights(&h);
    scene->max_range_m = 15;
    scene->ambient = 0.15;
    scene->exposure = 1.0;
    scene_add_stand(scene, "nave west", -7.6, 0, 0);
    scene_add_stand(scene, "before the choir", 3.6, 0.2, heritage_pi);
    scene_add_stand(scene, "north aisle", 2.2, 4.9, heritage_pi);
}
