/* Furniture of the `heritage` scene. */
#include "twin/heritage.h"

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
    heritage_statue(
        h, &sleeper, h->marble,
        shaper_frame(vec3_make(-2.25 - 0.85, -5.4, 1.06), heritage_pi, -heritage_pi / 2, 0));
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
            double t = 3.6 * heritage_pi * k / (POINTS - 1),
                   r = 0.048 * (1 - 0.8 * k / (POINTS - 1));
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
    heritage_statue(h, &saint, h->bronze,
                    shaper_frame(vec3_make(x0 + 1.7, y, 0.77), heritage_pi, 0, 0));
    add_gate_leaf(h, y - 1.05, heritage_pi / 2, 1.03);
    add_gate_leaf(h, y + 1.05, -heritage_pi / 2 + 0.75, 1.03);
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
        double t = 2 * heritage_pi * i / (POINTS - 1);
        path[i] = vec3_make(0.6 * cos(t), 0.6 * sin(t), 0);
        radius[i] = 0.016;
    }
    shape_tube(&iron, path, radius, POINTS, 8);
    for (int i = 0; i < ARMS; i++) {
        double t = 2 * heritage_pi * i / ARMS, cx = 0.6 * cos(t), cy = 0.6 * sin(t);
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

void heritage_furnish(const struct heritage *h) {
    add_balustrade(h);
    add_altar(h);
    add_tomb(h);
    add_glass_case(h);
    add_chapel(h);
    add_pews(h);
    add_chandelier(h, -4.5, 4.6);
    add_chandelier(h, 1.5, 4.6);
}
