/* Coded tiles: what comes back, and what is refused. */
#include "base/photo.h"
#include "base/rng.h"
#include "base/tile_code.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

static void fill(struct tile_samples *s, int32_t width, int32_t height, double sigma,
                 uint64_t seed) {
    struct rng rng = rng_make(seed);
    memset(s, 0, sizeof *s);
    s->width = width;
    s->height = height;
    for (int32_t i = 0; i < width * height; i++) {
        int32_t u = i % width, v = i / width;
        s->disparity_per_m[i] = (float)(0.2 + 3e-4 * u - 2e-4 * v + sigma * rng_normal(&rng));
        s->confidence[i] = photo_confidence_from_sigma(sigma > 0 ? sigma : 1e-6);
        for (int c = 0; c < 3; c++)
            s->rgb[3 * i + c] = (uint8_t)(100 + 20 * c + u + (int)rng_below(&rng, 6u));
    }
}

static void recode(const struct tile_samples *s, const struct tile_code_options *o,
                   struct tile_samples *out, struct tile_code_stats *stats) {
    uint8_t bytes[TILE_CODE_MAX_BYTES];
    size_t size = 0;
    enum tile_code_kind kind;
    assert_int_equal(tile_code_encode(s, o, bytes, &size, stats), ST_OK);
    assert_int_equal(tile_code_decode(bytes, size, out, &kind), ST_OK);
    assert_int_equal(kind, stats->kind);
    assert_int_equal(out->width, s->width);
    assert_int_equal(out->height, s->height);
}

static void keeps_colours_and_flags_exactly(void **state) {
    (void)state;
    struct tile_samples s, back;
    struct tile_code_stats stats;
    fill(&s, 33, 33, 1e-4, 1);
    struct rng rng = rng_make(2);
    for (int i = 0; i < 33 * 33; i++) {
        for (int c = 0; c < 3; c++)
            s.rgb[3 * i + c] = (uint8_t)rng_u64(&rng);
        s.flags[i] = (uint8_t)(rng_u64(&rng) & (PHOTO_FILLED | PHOTO_SKIN | PHOTO_MIXED));
    }
    struct tile_code_options o = tile_code_options_default(1e-5);
    recode(&s, &o, &back, &stats);
    assert_memory_equal(s.rgb, back.rgb, sizeof s.rgb);
    assert_memory_equal(s.flags, back.flags, sizeof s.flags);
}

static void errs_by_half_a_step_at_most(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct tile_samples s, back;
        struct tile_code_stats stats;
        struct rng rng = rng_make(seed);
        fill(&s, 1 + (int32_t)rng_below(&rng, 33), 1 + (int32_t)rng_below(&rng, 33), 1e-3, seed);
        double step = 1e-6 * pow(10.0, 3.0 * rng_uniform(&rng));
        int32_t count = s.width * s.height;
        for (int32_t i = 0; i < count; i += 7)
            s.disparity_per_m[i] = i % 2 ? NAN : (float)rng_range(&rng, 1e-3, 20.0);
        struct tile_code_options o = tile_code_options_default(step);
        o.plane = 0;
        recode(&s, &o, &back, &stats);
        for (int32_t i = 0; i < count; i++) {
            if (isnan(s.disparity_per_m[i])) {
                assert_true(isnan(back.disparity_per_m[i]));
                continue;
            }
            double off = fabs((double)back.disparity_per_m[i] - (double)s.disparity_per_m[i]);
            /* float rounding of values up to 20 1/m */
            assert_true(off <= 0.5 * step * 1.0001 + 2e-6);
            assert_true(off <= stats.error_max_per_m);
        }
    }
}

static void keeps_disparities_exactly_when_asked(void **state) {
    (void)state;
    struct tile_samples s, back;
    struct tile_code_stats stats;
    fill(&s, 32, 17, 0.05, 3);
    s.disparity_per_m[5] = NAN;
    struct tile_code_options o = tile_code_options_default(0.0);
    o.plane = 0;
    o.confidence_step = 1;
    recode(&s, &o, &back, &stats);
    for (int i = 0; i < 32 * 17; i++)
        if (i != 5)
            assert_memory_equal(&s.disparity_per_m[i], &back.disparity_per_m[i], sizeof(float));
    assert_true(isnan(back.disparity_per_m[5]));
    assert_memory_equal(s.confidence, back.confidence, 32 * 17);
}

static void never_claims_more_confidence(void **state) {
    (void)state;
    struct tile_samples s, back;
    struct tile_code_stats stats;
    fill(&s, 33, 33, 1e-4, 4);
    for (int i = 0; i < 33 * 33; i++)
        s.confidence[i] = (uint8_t)i;
    struct tile_code_options o = tile_code_options_default(1e-5);
    recode(&s, &o, &back, &stats);
    for (int i = 0; i < 33 * 33; i++) {
        assert_true(back.confidence[i] <= s.confidence[i]);
        assert_true(back.confidence[i] + o.confidence_step > s.confidence[i]);
    }
}

static void a_noisy_plane_becomes_a_plane(void **state) {
    (void)state;
    struct tile_samples s, back;
    struct tile_code_stats stats;
    fill(&s, 33, 33, 1e-4, 5);
    struct tile_code_options o = tile_code_options_default(1e-5);
    recode(&s, &o, &back, &stats);
    assert_int_equal(stats.kind, TILE_CODE_PLANE);
    for (int i = 0; i < 33 * 33; i++) {
        double truth = 0.2 + 3e-4 * (i % 33) - 2e-4 * (i / 33);
        /* 1089 samples determine the plane to a tenth of a sigma everywhere on the tile */
        assert_true(fabs((double)back.disparity_per_m[i] - truth) < 2e-5);
    }
}

static void what_is_no_plane_stays_sampled(void **state) {
    (void)state;
    struct tile_code_options o = tile_code_options_default(1e-5);
    for (int what = 0; what < 5; what++) {
        struct tile_samples s, back;
        struct tile_code_stats stats;
        fill(&s, 33, 33, 1e-4, 6);
        for (int i = 0; i < 33 * 33; i++) {
            int u = i % 33 - 16, v = i / 33 - 16;
            if (what == 0)
                s.disparity_per_m[i] += 2e-6f * (float)(u * u + v * v); /* bent by 5 sigma */
            if (what == 1 && u > 8)
                s.disparity_per_m[i] += 1e-3f;
        }
        if (what == 2)
            s.disparity_per_m[500] = NAN;
        if (what == 3)
            s.flags[500] = PHOTO_SKIN;
        if (what == 4)
            s.disparity_per_m[500] += 8e-4f; /* one wire of 8 sigma */
        recode(&s, &o, &back, &stats);
        assert_int_equal(stats.kind, TILE_CODE_SAMPLED);
    }
}

static void sky_stays_at_infinity(void **state) {
    (void)state;
    struct tile_samples s, back;
    struct tile_code_stats stats;
    fill(&s, 33, 33, 1e-4, 7);
    for (int i = 0; i < 300; i++) {
        s.disparity_per_m[i] = 0.0f;
        s.flags[i] = PHOTO_SKY;
    }
    struct tile_code_options o = tile_code_options_default(1e-5);
    recode(&s, &o, &back, &stats);
    for (int i = 0; i < 300; i++)
        assert_true(back.disparity_per_m[i] == 0.0f);
    assert_true(back.disparity_per_m[300] > 0.1f);
}

static void holds_contact_and_a_kilometre_in_one_tile(void **state) {
    (void)state;
    struct tile_samples s, back;
    struct tile_code_stats stats;
    fill(&s, 33, 33, 1e-4, 8);
    for (int i = 0; i < 33 * 33; i++)
        s.disparity_per_m[i] = i % 2 ? 20.0f : 1e-3f;
    struct tile_code_options o = tile_code_options_default(1e-9); /* 20e9 levels: exact instead */
    recode(&s, &o, &back, &stats);
    assert_memory_equal(s.disparity_per_m, back.disparity_per_m, sizeof s.disparity_per_m);
}

static void refuses_senseless_input(void **state) {
    (void)state;
    uint8_t bytes[TILE_CODE_MAX_BYTES];
    size_t size;
    struct tile_samples s;
    struct tile_code_options o = tile_code_options_default(1e-5);
    fill(&s, 33, 33, 1e-4, 9);
    s.width = 34;
    assert_int_equal(tile_code_encode(&s, &o, bytes, &size, NULL), ST_INVALID);
    s.width = 33;
    s.disparity_per_m[0] = -1.0f;
    assert_int_equal(tile_code_encode(&s, &o, bytes, &size, NULL), ST_INVALID);
    s.disparity_per_m[0] = INFINITY;
    assert_int_equal(tile_code_encode(&s, &o, bytes, &size, NULL), ST_INVALID);
    s.disparity_per_m[0] = 0.1f;
    o.step_per_m = -1.0;
    assert_int_equal(tile_code_encode(&s, &o, bytes, &size, NULL), ST_INVALID);
}

static void refuses_damaged_bytes_or_gives_sane_samples(void **state) {
    (void)state;
    uint8_t bytes[TILE_CODE_MAX_BYTES];
    size_t size;
    struct tile_samples s, back;
    struct tile_code_options o = tile_code_options_default(1e-5);
    fill(&s, 33, 33, 1e-4, 10);
    o.plane = 0;
    assert_int_equal(tile_code_encode(&s, &o, bytes, &size, NULL), ST_OK);
    for (size_t cut = 0; cut < size; cut += 13)
        assert_int_equal(tile_code_decode(bytes, cut, &back, NULL), ST_FORMAT);
    for (size_t at = 0; at < size; at += 3) {
        uint8_t was = bytes[at];
        bytes[at] ^= 0x41;
        if (!tile_code_decode(bytes, size, &back, NULL))
            for (int32_t i = 0; i < back.width * back.height; i++) {
                float d = back.disparity_per_m[i];
                assert_true(isnan(d) || (d >= 0.0f && isfinite(d)));
            }
        bytes[at] = was;
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keeps_colours_and_flags_exactly),
        cmocka_unit_test(errs_by_half_a_step_at_most),
        cmocka_unit_test(keeps_disparities_exactly_when_asked),
        cmocka_unit_test(never_claims_more_confidence),
        cmocka_unit_test(a_noisy_plane_becomes_a_plane),
        cmocka_unit_test(what_is_no_plane_stays_sampled),
        cmocka_unit_test(sky_stays_at_infinity),
        cmocka_unit_test(holds_contact_and_a_kilometre_in_one_tile),
        cmocka_unit_test(refuses_senseless_input),
        cmocka_unit_test(refuses_damaged_bytes_or_gives_sane_samples),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
