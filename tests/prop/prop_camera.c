/* The camera model over random cameras: derivatives, round trips, and a domain in which it is never
 * wrong. */
#include "base/camera.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/prop.h"

#include <math.h>

enum { CASES = 3000, POINTS = 8 };

static uint64_t seed;

/* From no distortion to more than lenses have; a third without tangential terms. */
static struct camera random_camera(struct rng *rng) {
    double f = exp(rng_range(rng, log(100.0), log(6000.0)));
    struct camera cam = {.width_px = 16 + (int32_t)rng_below(rng, 6000),
                         .height_px = 16 + (int32_t)rng_below(rng, 4000),
                         .fx_px = f,
                         .fy_px = f * rng_range(rng, 0.8, 1.25)};
    cam.cx_px = 0.5 * cam.width_px + rng_range(rng, -50, 50);
    cam.cy_px = 0.5 * cam.height_px + rng_range(rng, -50, 50);
    double strength = pow(10.0, rng_range(rng, -4.0, 0.0));
    cam.k1 = strength * rng_normal(rng) * 0.5;
    cam.k2 = strength * rng_normal(rng) * 0.3;
    cam.k3 = rng_below(rng, 2) ? 0.0 : strength * rng_normal(rng) * 0.1;
    if (rng_below(rng, 3)) {
        cam.p1 = strength * rng_normal(rng) * 0.02;
        cam.p2 = strength * rng_normal(rng) * 0.02;
    }
    return cam;
}

/* Largest radius to test: the domain's, or that of an 80 degree half angle. */
static double test_radius(const struct camera *cam) {
    return fmin(sqrt(camera_s_max(cam)), tan(80 * 3.14159265358979 / 180));
}

/* A point in front of the camera whose ray has radius r. */
static struct vec3 point_at_radius(struct rng *rng, double r) {
    double a = rng_range(rng, -3.14159265358979, 3.14159265358979);
    double z = exp(rng_range(rng, log(0.05), log(100.0)));
    return vec3_make(r * cos(a) * z, r * sin(a) * z, z);
}

static void projection_jacobian_matches_central_differences(void **state) {
    (void)state;
    const double tolerance =
        1e-6; /* of the focal length over depth: truncation h^2, rounding eps/h */
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed, i);
        struct camera cam = random_camera(&rng);
        struct vec3 p = point_at_radius(&rng, test_radius(&cam) * 0.99 * sqrt(rng_uniform(&rng)));
        struct vec2 q;
        double j[6];
        assert_int_equal(camera_project(&cam, p, &q, j), ST_OK);
        double h = 1e-5 * p.z;
        double scale = 0;
        for (int k = 0; k < 6; k++)
            scale = fmax(scale, fabs(j[k]));
        for (int axis = 0; axis < 3; axis++) {
            struct vec3 step = vec3_make(axis == 0 ? h : 0, axis == 1 ? h : 0, axis == 2 ? h : 0);
            struct vec2 a, b;
            if (camera_project(&cam, vec3_sub(p, step), &a, NULL) ||
                camera_project(&cam, vec3_add(p, step), &b, NULL))
                continue; /* a neighbour is beyond the edge */
            double du = (b.x - a.x) / (2 * h), dv = (b.y - a.y) / (2 * h);
            double size = fmax(scale, cam.fx_px / p.z);
            if (fabs(du - j[axis]) > tolerance * size || fabs(dv - j[3 + axis]) > tolerance * size)
                fail_msg("case %llu axis %d: %.9g %.9g, differences %.9g %.9g",
                         (unsigned long long)i, axis, j[axis], j[3 + axis], du, dv);
        }
    }
}

static void unprojection_jacobian_matches_central_differences(void **state) {
    (void)state;
    const double tolerance = 1e-5; /* relative; stays clear of the edge, where derivatives grow */
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x10, i);
        struct camera cam = random_camera(&rng);
        struct vec3 p = point_at_radius(&rng, test_radius(&cam) * 0.8 * sqrt(rng_uniform(&rng)));
        struct vec2 q;
        struct vec3 ray;
        double j[4];
        assert_int_equal(camera_project(&cam, p, &q, NULL), ST_OK);
        assert_int_equal(camera_unproject(&cam, q, &ray, j), ST_OK);
        double h = 1e-5 * cam.fx_px;
        double size = fmax(fmax(fabs(j[0]), fabs(j[3])), fmax(fabs(j[1]), fabs(j[2])));
        for (int axis = 0; axis < 2; axis++) {
            struct vec2 qa = {q.x - (axis == 0 ? h : 0), q.y - (axis == 1 ? h : 0)};
            struct vec2 qb = {q.x + (axis == 0 ? h : 0), q.y + (axis == 1 ? h : 0)};
            struct vec3 a, b;
            assert_int_equal(camera_unproject(&cam, qa, &a, NULL), ST_OK);
            assert_int_equal(camera_unproject(&cam, qb, &b, NULL), ST_OK);
            double dx = (b.x - a.x) / (2 * h), dy = (b.y - a.y) / (2 * h);
            if (fabs(dx - j[axis]) > tolerance * size || fabs(dy - j[2 + axis]) > tolerance * size)
                fail_msg("case %llu axis %d: %.9g %.9g, differences %.9g %.9g",
                         (unsigned long long)i, axis, j[axis], j[2 + axis], dx, dy);
        }
    }
}

/* Whole domain, edge included: the pixel comes back, and so does the ray. */
static void projects_back_to_the_same_pixel_and_ray(void **state) {
    (void)state;
    const double pixel_tolerance_px = 1e-9;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x20, i);
        struct camera cam = random_camera(&rng);
        for (int k = 0; k < POINTS; k++) {
            double share = k == 0 ? 1.0 - 1e-9 : sqrt(rng_uniform(&rng));
            double r = test_radius(&cam) * share;
            struct vec3 p = point_at_radius(&rng, r);
            struct vec2 q, again;
            struct vec3 ray;
            assert_int_equal(camera_project(&cam, p, &q, NULL), ST_OK);
            if (camera_unproject(&cam, q, &ray, NULL))
                fail_msg("case %llu: refuses the pixel of a ray at %.12g of the radius",
                         (unsigned long long)i, share);
            assert_int_equal(camera_project(&cam, ray, &again, NULL), ST_OK);
            /* far outside the picture a pixel coordinate itself has no 1e-9 left */
            double tolerance = pixel_tolerance_px * fmax(1.0, hypot(q.x, q.y) * 1e-5);
            if (hypot(again.x - q.x, again.y - q.y) > tolerance)
                fail_msg("case %llu: pixel off by %.3g", (unsigned long long)i,
                         hypot(again.x - q.x, again.y - q.y));
            double ray_error = hypot(ray.x - p.x / p.z, ray.y - p.y / p.z);
            /* at the edge the map is flat: an error e there moves the ray by sqrt(e) */
            double ray_tolerance = (share < 0.95 ? 1e-9 : 1e-4) * fmax(1.0, r);
            if (ray_error > ray_tolerance)
                fail_msg("case %llu: another ray, off by %.3g at %.9g of the radius %.6g",
                         (unsigned long long)i, ray_error, share, r);
        }
    }
}

static void refuses_rays_beyond_the_domain(void **state) {
    (void)state;
    int bounded = 0;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x30, i);
        struct camera cam = random_camera(&rng);
        double s_max = camera_s_max(&cam);
        if (!isfinite(s_max))
            continue;
        bounded++;
        double beyond = sqrt(s_max) * (1 + pow(10.0, rng_range(&rng, -9, 1)));
        struct vec2 q;
        assert_int_equal(camera_project(&cam, point_at_radius(&rng, beyond), &q, NULL), ST_DOMAIN);
    }
    assert_true(bounded > CASES / 10);
}

/* Any pixel, inside the picture or far out: either no ray, or one of the domain that projects
 * there. */
static void never_returns_a_wrong_ray(void **state) {
    (void)state;
    int answered = 0, refused = 0;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x40, i);
        struct camera cam = random_camera(&rng);
        for (int k = 0; k < POINTS; k++) {
            double reach = pow(10.0, rng_range(&rng, -2, 2)) * cam.fx_px;
            struct vec2 q = {cam.cx_px + reach * rng_normal(&rng),
                             cam.cy_px + reach * rng_normal(&rng)};
            struct vec2 again;
            struct vec3 ray = {NAN, NAN, NAN};
            if (camera_unproject(&cam, q, &ray, NULL)) {
                assert_true(isnan(ray.x)); /* nothing written */
                refused++;
                continue;
            }
            answered++;
            assert_true(ray.x * ray.x + ray.y * ray.y <= camera_s_max(&cam) * (1 + 1e-15));
            assert_int_equal(camera_project(&cam, ray, &again, NULL), ST_OK);
            assert_true(hypot(again.x - q.x, again.y - q.y) <= 1e-9 * fmax(1.0, reach * 1e-4));
        }
    }
    assert_true(answered > CASES && refused > CASES / 10);
}

/* The domain is where the map is certain to be one-to-one, and without tangential terms not
 * smaller. */
static void domain_ends_where_the_radial_map_stops_growing(void **state) {
    (void)state;
    for (uint64_t i = 0; i < CASES; i++) {
        struct rng rng = rng_stream(seed ^ 0x50, i);
        struct camera cam = random_camera(&rng);
        cam.p1 = cam.p2 = 0.0;
        double s_max = camera_s_max(&cam);
        double end = isfinite(s_max) ? s_max : 1e4;
        enum { STEPS = 400 };
        for (int k = 0; k < STEPS; k++) {
            double s = end * k / STEPS;
            double slope = 1 + s * (3 * cam.k1 + s * (5 * cam.k2 + s * 7 * cam.k3));
            if (!(slope > 0))
                fail_msg("case %llu: falls at s %.9g before s_max %.9g", (unsigned long long)i, s,
                         s_max);
        }
        if (isfinite(s_max)) {
            double s = s_max;
            double size =
                1 + s * (3 * fabs(cam.k1) + s * (5 * fabs(cam.k2) + s * 7 * fabs(cam.k3)));
            double slope = 1 + s * (3 * cam.k1 + s * (5 * cam.k2 + s * 7 * cam.k3));
            assert_true(fabs(slope) <= 1e-12 * size);
        }
    }
}

int main(void) {
    seed = prop_seed();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(projection_jacobian_matches_central_differences),
        cmocka_unit_test(unprojection_jacobian_matches_central_differences),
        cmocka_unit_test(projects_back_to_the_same_pixel_and_ray),
        cmocka_unit_test(refuses_rays_beyond_the_domain),
        cmocka_unit_test(never_returns_a_wrong_ray),
        cmocka_unit_test(domain_ends_where_the_radial_map_stops_growing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
