#include "app/fuse_report.h"

#include "app/app_site.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

int64_t fuse_report_peak_bytes(void) {
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) ? 0 : (int64_t)usage.ru_maxrss * 1024;
}

/* ---- for a person ---- */

/* How well the mirror tied the clocks; nothing of imports, which have none. */
static void print_clocks(const struct fuse_station *s) {
    const struct cart_clock_report *r = &s->clock;
    if (strcmp(s->calibration, "none") == 0)
        return;
    if (!r->head.pairs) {
        (void)printf("\n  clocks: turns and events could not be matched; placed by arrival times");
        return;
    }
    (void)printf("\n  clocks: %" PRIu64 " turns matched within %.1f us, %" PRIu64
                 " events missing, %" PRIu64 " spurious",
                 r->head.pairs, r->head.rms_ns * 1e-3, r->missing_events, r->spurious_events);
    for (int k = CART_CLOCK_AMBIGUOUS; k < CART_CLOCK_KINDS; k++)
        if (r->incidents[k] && k != CART_CLOCK_MIRROR_SLOW) /* at the end of a sweep it must */
            (void)printf("\n  clocks: %s (%" PRIu64 ")",
                         cart_clock_kind_text((enum cart_clock_kind)k), r->incidents[k]);
}

static void print_station(const struct fuse_station *s, double pixel_rad) {
    if (!s->has_samples) {
        (void)printf("%s: no samples\n", s->name);
        return;
    }
    (void)printf("%s: %" PRId64 " samples, %.2f mrad apart, noise %.1f mm%s", s->name,
                 s->survey.sample_count, 1e3 * s->survey.spacing_rad, 1e3 * s->noise.sigma_m[0],
                 s->noise.measured ? " (measured)" : " (assumed)");
    if (strcmp(s->calibration, "none") != 0)
        (void)printf(", rig as %s", s->calibration);
    print_clocks(s);
    (void)printf("\n  %zu photograph%s (%zu up to date)%s in %.1f s, after %.1f s of reading\n",
                 s->photo_count, s->photo_count == 1 ? "" : "s", s->kept_count,
                 s->frame_count == s->photo_count ? " of camera frames"
                 : s->frame_count                 ? " of camera frames and cube faces"
                                                  : " coloured by the samples",
                 s->seconds_photos, s->seconds_read);
    (void)pixel_rad;
}

static void print_photos(const struct fuse_photos *photos) {
    struct resolve_counts sum;
    memset(&sum, 0, sizeof sum);
    size_t made = 0;
    for (size_t i = 0; i < photos->count; i++) {
        const struct resolve_counts *c = &photos->list[i].counts;
        made += !photos->list[i].kept;
        sum.valid += c->valid, sum.filled += c->filled, sum.mixed += c->mixed;
        sum.no_return += c->no_return, sum.dropped += c->dropped, sum.sky += c->sky;
        sum.low_confidence += c->low_confidence, sum.refused += c->refused;
        sum.unseen += c->unseen;
    }
    if (!made)
        return;
    double all = (double)(sum.valid + sum.no_return + sum.dropped + sum.sky + sum.unseen);
    (void)printf(
        "pixels: %.1f %% surface, %.1f %% sky, %.1f %% no return, %.1f %% dropped, %.1f %% "
        "never looked at; %" PRId64 " floating clusters refused\n",
        100 * (double)sum.valid / all, 100 * (double)sum.sky / all,
        100 * (double)sum.no_return / all, 100 * (double)sum.dropped / all,
        100 * (double)sum.unseen / all, sum.refused);
}

static void print_skins(const struct fuse_skins_result *s) {
    if (s->kept)
        (void)printf("skins: up to date\n");
    else if (s->ran)
        (void)printf("skins: of %" PRId64 " cells that bridge a step %" PRId64
                     " were seen through from elsewhere (%" PRId64 " pairs of views, %.1f s)\n",
                     s->counts.candidates, s->counts.disproved, s->counts.pairs, s->seconds);
    if (s->ran && s->counts.unsure > s->counts.disproved)
        (void)printf(
            "  the stations' poses are not known well enough to say more: register them, or "
            "give --pose-sigma-mm\n");
}

/* What was chosen, and why. */
static void print_choice(const struct pack_stats *p, const struct fuse_settings *s) {
    double stored = (double)(p->sampled + p->planes), samples = (double)p->samples;
    if (!(stored > 0) || !(samples > 0))
        return;
    (void)printf("tiles: for an error of %.1f mm up to %g m (in proportion beyond):\n",
                 1e3 * s->pack.error_m, s->pack.error_range_m);
    (void)printf("  %5.1f %% are planes within their noise: four corners each\n",
                 100 * (double)p->planes / stored);
    if (p->sampled)
        (void)printf(
            "  %5.1f %% are sampled, %.1f bit a disparity before prediction; in %.0f %% of "
            "them noise allows a coarser step than the error\n",
            100 * (double)p->sampled / stored, p->level_bits_sum / (double)p->sampled,
            100 * (double)p->noise_limited / (double)p->sampled);
    (void)printf("  %.1f bit a sample: disparity %.1f, colour %.1f, flags and confidence %.1f; "
                 "coarser levels add %.0f %%\n",
                 8 * (double)p->bytes_level0 / samples, 8 * (double)p->bytes_disparity / samples,
                 8 * (double)p->bytes_colour / samples, 8 * (double)p->bytes_rest / samples,
                 100 * (double)p->bytes_coarse / (double)p->bytes_level0);
}

static void print_tiles(const struct fuse_tiles_result *t, const struct fuse_settings *s) {
    char size[APP_SITE_TEXT_MAX];
    if (t->kept) {
        (void)printf("tiles: up to date (%s)\n", app_site_bytes(t->file_bytes, size));
        return;
    }
    print_choice(&t->pack, s);
    if (t->cull.tiles)
        (void)printf("  %" PRId64 " of %" PRId64
                     " tiles are shown as well elsewhere (threshold %g) and left out; %" PRId64
                     " more stay as the frontier of the unknown\n",
                     t->cull.culled, t->cull.tiles - t->cull.empty, s->cull.threshold,
                     t->cull.frontier);
    (void)printf("  %zu photographs, %" PRId64 " samples, %s in %.1f s\n", t->photo_count,
                 t->pack.samples, app_site_bytes(t->file_bytes, size),
                 t->seconds_cull + t->seconds_pack);
}

void fuse_report_text(const struct fuse_report *r) {
    char peak[APP_SITE_TEXT_MAX];
    for (size_t i = 0; i < r->station_count; i++)
        print_station(&r->stations[i], 0);
    if (r->photos)
        print_photos(r->photos);
    if (r->skins)
        print_skins(r->skins);
    if (r->tiles)
        print_tiles(r->tiles, r->settings);
    (void)printf("%.1f s, %s of memory at the most\n", r->seconds,
                 app_site_bytes(fuse_report_peak_bytes(), peak));
}

/* ---- for a program ---- */

static void put_clocks(struct json *json, struct cJSON *station,
                       const struct cart_clock_report *r) {
    struct cJSON *o = json_object(json, station, "clocks");
    json_integer(json, o, "matched", (int64_t)r->head.pairs);
    if (r->head.pairs) {
        json_number(json, o, "residual_s", r->head.rms_ns * 1e-9);
        json_number(json, o, "residual_max_s", r->head.max_ns * 1e-9);
    }
    if (r->head.pairs > 1 && isfinite(r->head.drift_ppm)) {
        json_number(json, o, "drift_ppm", r->head.drift_ppm);
        json_number(json, o, "drift_sigma_ppm", r->head.drift_sigma_ppm);
    }
    json_integer(json, o, "missing_events", (int64_t)r->missing_events);
    json_integer(json, o, "spurious_events", (int64_t)r->spurious_events);
    json_integer(json, o, "missing_edges", (int64_t)r->missing_edges);
    json_integer(json, o, "segments", (int64_t)r->head.segments);
    json_boolean(json, o, "ambiguous", r->incidents[CART_CLOCK_AMBIGUOUS] > 0);
}

static void put_station(struct json *json, struct cJSON *list, const struct fuse_station *s) {
    struct cJSON *o = json_object(json, list, NULL);
    json_text(json, o, "name", s->name);
    json_integer(json, o, "samples", s->survey.sample_count);
    json_integer(json, o, "returns", s->survey.return_count);
    json_number(json, o, "spacing_rad", s->survey.spacing_rad);
    json_number(json, o, "range_sigma_m", s->noise.sigma_m[0]);
    json_boolean(json, o, "range_sigma_measured", s->noise.measured);
    json_text(json, o, "calibration", s->calibration);
    json_integer(json, o, "unplaced", s->rays.unplaced);
    json_integer(json, o, "outside_sweep", s->rays.outside);
    json_integer(json, o, "damaged_packets", s->damaged_packets);
    if (strcmp(s->calibration, "none") != 0)
        put_clocks(json, o, &s->clock);
    json_integer(json, o, "photographs", (int64_t)s->photo_count);
    json_integer(json, o, "up_to_date", (int64_t)s->kept_count);
    json_integer(json, o, "of_frames", (int64_t)s->frame_count);
    json_number(json, o, "seconds_reading", s->seconds_read);
    json_number(json, o, "seconds_photographs", s->seconds_photos);
}

static void put_photo(struct json *json, struct cJSON *list, const struct fuse_photo *p) {
    struct cJSON *o = json_object(json, list, NULL);
    char hex[HASH_HEX_CHARS];
    hash_to_hex(p->final_sha256, hex);
    json_text(json, o, "name", p->name);
    json_text(json, o, "sha256", hex);
    json_integer(json, o, "width_px", p->camera.width_px);
    json_integer(json, o, "height_px", p->camera.height_px);
    json_boolean(json, o, "up_to_date", p->kept);
    if (p->kept)
        return;
    json_number(json, o, "seconds", p->seconds);
    json_integer(json, o, "samples", p->samples);
    json_integer(json, o, "valid", p->counts.valid);
    json_integer(json, o, "filled", p->counts.filled);
    json_integer(json, o, "mixed", p->counts.mixed);
    json_integer(json, o, "no_return", p->counts.no_return);
    json_integer(json, o, "dropped", p->counts.dropped);
    json_integer(json, o, "sky", p->counts.sky);
    json_integer(json, o, "low_confidence", p->counts.low_confidence);
    json_integer(json, o, "refused", p->counts.refused);
    json_integer(json, o, "unseen", p->counts.unseen);
}

static void put_tiles(struct json *json, const struct fuse_tiles_result *t,
                      const struct fuse_settings *s) {
    struct cJSON *o = json_object(json, NULL, "tiles");
    char hex[HASH_HEX_CHARS];
    hash_to_hex(t->sha256, hex);
    json_text(json, o, "sha256", hex);
    json_boolean(json, o, "up_to_date", t->kept);
    json_integer(json, o, "bytes", t->file_bytes);
    json_number(json, o, "error_m", s->pack.error_m);
    json_number(json, o, "error_range_m", s->pack.error_range_m);
    json_number(json, o, "threshold", s->cull.threshold);
    if (t->kept)
        return;
    json_number(json, o, "seconds_cull", t->seconds_cull);
    json_number(json, o, "seconds_pack", t->seconds_pack);
    json_integer(json, o, "tiles", t->pack.tiles);
    json_integer(json, o, "empty", t->pack.empty);
    json_integer(json, o, "culled", t->pack.culled);
    json_integer(json, o, "kept_as_frontier", t->cull.frontier);
    json_integer(json, o, "planes", t->pack.planes);
    json_integer(json, o, "sampled", t->pack.sampled);
    json_integer(json, o, "noise_limited", t->pack.noise_limited);
    json_integer(json, o, "samples", t->pack.samples);
    json_integer(json, o, "bytes_level0", t->pack.bytes_level0);
    json_integer(json, o, "bytes_coarse", t->pack.bytes_coarse);
    json_integer(json, o, "bytes_disparity", t->pack.bytes_disparity);
    json_integer(json, o, "bytes_colour", t->pack.bytes_colour);
    json_integer(json, o, "bytes_rest", t->pack.bytes_rest);
}

enum st fuse_report_json(const struct fuse_report *r, struct errctx *err) {
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "quality", fuse_settings_name(r->settings->quality));
    struct cJSON *stations = json_array(&json, NULL, "stations");
    for (size_t i = 0; i < r->station_count; i++)
        put_station(&json, stations, &r->stations[i]);
    struct cJSON *photos = json_array(&json, NULL, "photographs");
    for (size_t i = 0; r->photos && i < r->photos->count; i++)
        put_photo(&json, photos, &r->photos->list[i]);
    if (r->skins) {
        struct cJSON *o = json_object(&json, NULL, "skins");
        json_boolean(&json, o, "ran", r->skins->ran);
        json_boolean(&json, o, "up_to_date", r->skins->kept);
        json_integer(&json, o, "candidates", r->skins->counts.candidates);
        json_integer(&json, o, "disproved", r->skins->counts.disproved);
        json_integer(&json, o, "pairs", r->skins->counts.pairs);
        json_number(&json, o, "seconds", r->skins->seconds);
    }
    if (r->tiles)
        put_tiles(&json, r->tiles, r->settings);
    json_number(&json, NULL, "seconds", r->seconds);
    struct cJSON *peak = json_object(&json, NULL, "peak_bytes");
    json_integer(&json, peak, "photographs", r->peak_bytes_photos);
    json_integer(&json, peak, "skins", r->peak_bytes_skins);
    json_integer(&json, peak, "tiles", r->peak_bytes_tiles);
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}
