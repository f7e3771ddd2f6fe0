#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "base/json.h"
#include "site/site.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char about[] =
    "Makes an empty site: the folder that takes all that is measured at one place, and all that is "
    "made from "
    "it. The folder must not exist yet, or be empty.\n\n"
    "A georeference is kept apart from the coordinates of the scans: --epsg names the coordinate "
    "system of the "
    "offset, --offset the coordinates of the world origin in it (east,north,height in metres).\n\n"
    "Example: scancart new accident-a7 --name \"A7 km 112\" --epsg 25832 --offset 565000,5930000,0";

/* "east,north,height" */
static int parse_offset(const char *text, struct vec3 *out_offset_m) {
    double v[3];
    for (int i = 0; i < 3; i++) {
        char *end = NULL;
        v[i] = strtod(text, &end);
        if (end == text || *end != (i < 2 ? ',' : '\0'))
            return -1;
        text = end + 1;
    }
    *out_offset_m = vec3_make(v[0], v[1], v[2]);
    return 0;
}

static enum st print_made(const struct site_info *info, const char *path, bool json,
                          struct errctx *err) {
    if (!json) {
        (void)printf("%s: an empty site named \"%s\"\n", path, info->name);
        return ST_OK;
    }
    struct json out;
    json_init_object(&out);
    json_text(&out, NULL, "site", path);
    json_text(&out, NULL, "name", info->name);
    json_integer(&out, NULL, "schema_version", info->schema_version);
    enum st st = json_write(&out, stdout, err);
    json_fini(&out);
    return st;
}

static enum st run(const char *path, const struct site_info *wanted, bool json,
                   struct errctx *err) {
    struct site *site = NULL;
    struct site_info info;
    enum st st = site_create(path, wanted, &site, err);
    if (st)
        return st;
    app_site_set_actor(site, "new");
    st = site_get_info(site, &info, err);
    enum st closed = site_close(site, st ? NULL : err);
    if (!st)
        st = closed;
    return st ? st : print_made(&info, path, json, err);
}

int cmd_new(int argc, const char **argv) {
    char *name = NULL, *offset = NULL;
    int epsg = 0;
    bool json = false;
    const struct poptOption options[] = {
        {"name", 'n', POPT_ARG_STRING, &name, 0, "name of the site (the folder's)", "TEXT"},
        {"epsg", 0, POPT_ARG_INT, &epsg, 0, "coordinate system of the offset", "CODE"},
        {"offset", 0, POPT_ARG_STRING, &offset, 0, "world origin in that system, metres", "E,N,H"},
        POPT_TABLEEND};
    struct app_usage usage = {.name = "new",
                              .synopsis =
                                  "SITE [--name TEXT] [--epsg CODE --offset E,N,H] [--json]",
                              .about = about,
                              .options = options,
                              .out_json = &json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    const char *path = poptGetArg(context);
    struct site_info wanted = {.georef = {.epsg = epsg}};
    int status;
    struct errctx err = {0};
    if (!path || poptPeekArg(context))
        status = app_usage_error("new", "give one folder");
    else if (name && (!*name || !site_name_is_valid(name)))
        status = app_usage_error("new", "'%s' cannot be a name", name);
    else if (offset && parse_offset(offset, &wanted.georef.offset_m))
        status = app_usage_error("new", "--offset '%s' is not EAST,NORTH,HEIGHT", offset);
    else {
        if (name)
            (void)snprintf(wanted.name, sizeof wanted.name, "%s", name);
        status = run(path, &wanted, json, &err) ? app_fail("new", &err) : APP_DONE;
    }
    (void)poptFreeContext(context);
    free(name);
    free(offset);
    return status;
}
