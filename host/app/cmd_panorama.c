#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "base/json.h"
#include "base/panorama.h"
#include "base/picture.h"
#include "site/polar_chunk.h"
#include "site/station.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double deg = 180.0 / 3.14159265358979323846;

static const char about[] =
    "Draws what a station's scanner saw as one picture of equal angles: coloured by range and "
    "shaded "
    "by the angle "
    "at which the beam met each surface, or grey by returned intensity. No return, dropped and not "
    "looked at have "
    "their own colours.\n\n"
    "Example: scancart panorama mysite --station scan000 -o panorama.png";

struct request {
    const char *site, *station, *out;
    struct panorama_options options;
    bool json;
};

/* The named station, or the first that has a polar stream. */
static enum st find_station(struct site *site, const char *name, struct station *out_station,
                            struct errctx *err) {
    if (name)
        return station_find(site, name, out_station, err);
    struct stream stream;
    int64_t after_id = 0;
    for (;;) {
        size_t count = 0;
        enum st st = stream_list(site, 0, after_id, &stream, 1, &count, err);
        if (st)
            return st;
        if (count == 0)
            return errctx_set(err, ST_NOT_FOUND, "no station of this site has a scan");
        if (!strcmp(stream.kind, POLAR_CHUNK_KIND))
            return station_get(site, stream.station_id, out_station, err);
        after_id = stream.id;
    }
}

static enum st print_made(const struct request *r, const char *station,
                          const struct panorama_info *info, const struct image_u8 *image,
                          struct errctx *err) {
    if (!r->json) {
        (void)printf("%s: %d x %d pixels of station %s, %.1f x %.1f deg, %zu surfaces, %zu no "
                     "returns, %zu dropped\n",
                     r->out, image->width_px, image->height_px, station,
                     (info->left_rad - info->right_rad) * deg,
                     (info->top_rad - info->bottom_rad) * deg, info->surfaces, info->no_returns,
                     info->dropped);
        return ST_OK;
    }
    struct json json;
    json_init_object(&json);
    json_text(&json, NULL, "picture", r->out);
    json_text(&json, NULL, "station", station);
    json_integer(&json, NULL, "width_px", image->width_px);
    json_integer(&json, NULL, "height_px", image->height_px);
    json_number(&json, NULL, "left_deg", info->left_rad * deg);
    json_number(&json, NULL, "right_deg", info->right_rad * deg);
    json_number(&json, NULL, "bottom_deg", info->bottom_rad * deg);
    json_number(&json, NULL, "top_deg", info->top_rad * deg);
    json_number(&json, NULL, "near_m", info->near_m);
    json_number(&json, NULL, "far_m", info->far_m);
    json_integer(&json, NULL, "surfaces", (int64_t)info->surfaces);
    json_integer(&json, NULL, "no_returns", (int64_t)info->no_returns);
    json_integer(&json, NULL, "dropped", (int64_t)info->dropped);
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

static int run(const struct request *r) {
    struct errctx err = {0};
    struct site *site = NULL;
    struct polar_sample *samples = NULL;
    struct image_u8 image = {0};
    struct panorama_info info;
    struct station station;
    size_t count = 0;
    enum st st = app_site_open(r->site, SITE_READ, "panorama", &site, &err);
    if (!st)
        st = find_station(site, r->station, &station, &err);
    if (!st)
        st = polar_chunk_read(site, station.id, NULL, &samples, &count, NULL, &err);
    if (!st)
        st = panorama_render(samples, count, &r->options, &image, &info, &err);
    if (!st)
        st = picture_write_png(r->out, &image, &err);
    if (!st)
        st = print_made(r, station.name, &info, &image, &err);
    image_u8_destroy(&image);
    free(samples);
    (void)site_close(site, NULL);
    return st ? app_fail("panorama", &err) : APP_DONE;
}

int cmd_panorama(int argc, const char **argv) {
    char *station = NULL, *out = NULL;
    int intensity = 0, colour = 0, clay = 0, width_px = 0, no_legend = 0;
    struct request r = {0};
    const struct poptOption options[] = {
        {"out", 'o', POPT_ARG_STRING, &out, 0, "the picture to write", "PNG"},
        {"station", 0, POPT_ARG_STRING, &station, 0, "which (the first with a scan)", "TEXT"},
        {"intensity", 0, POPT_ARG_NONE, &intensity, 0, "grey by returned intensity", NULL},
        {"colour", 0, POPT_ARG_NONE, &colour, 0, "the samples' own colour", NULL},
        {"clay", 0, POPT_ARG_NONE, &clay, 0, "one colour under a fixed light", NULL},
        {"width", 0, POPT_ARG_INT, &width_px, 0, "of the picture (three pixels a sample)", "PX"},
        {"near-m", 0, POPT_ARG_DOUBLE, &r.options.near_m, 0, "start of the colour scale", "M"},
        {"far-m", 0, POPT_ARG_DOUBLE, &r.options.far_m, 0, "end of the colour scale", "M"},
        {"no-legend", 0, POPT_ARG_NONE, &no_legend, 0, "the scene alone", NULL},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "panorama",
                              .synopsis = "SITE -o PNG [--station TEXT] [options]",
                              .about = about,
                              .options = options,
                              .out_json = &r.json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    int status = app_parse_exit(st);
    if (!st) {
        r.site = poptGetArg(context);
        r.station = station;
        r.out = out;
        r.options.style = intensity ? SAMPLE_SHADE_INTENSITY
                          : colour  ? SAMPLE_SHADE_COLOUR
                          : clay    ? SAMPLE_SHADE_CLAY
                                    : SAMPLE_SHADE_RANGE;
        r.options.width_px = width_px;
        r.options.legend = !no_legend;
        if (!r.site || poptPeekArg(context))
            status = app_usage_error("panorama", "give one site");
        else if (!out)
            status = app_usage_error("panorama", "give the picture to write: -o FILE.png");
        else if (width_px < 0 || width_px > 16384)
            status = app_usage_error("panorama", "--width is not 1 to 16384");
        else
            status = run(&r);
        (void)poptFreeContext(context);
    }
    free(station);
    free(out);
    return status;
}
