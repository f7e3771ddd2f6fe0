#include "app/cmd_twin.h"

#include "app/app.h"
#include "app/commands.h"
#include "base/json.h"
#include "twin/faults.h"
#include "twin/twin_config.h"

#include <stdio.h>
#include <string.h>

static const struct app_command parts[] = {
    {"list", "the scenes, their stands, and the faults", cmd_twin_list},
    {"scan", "scan a scene into a site", cmd_twin_scan},
    {"truth", "what a ray really meets; how far a scan is from it", cmd_twin_truth},
    {"config", "print all parameters of the simulated cart as YAML", cmd_twin_config},
};

static void print_help(FILE *out) {
    (void)fprintf(
        out, "Usage: scancart twin PART [options]\n\n"
             "The twin is a simulated cart: it scans scenes that are known exactly.\n\nParts:\n");
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++)
        (void)fprintf(out, "  %-8s %s\n", parts[i].name, parts[i].summary);
    (void)fprintf(
        out, "\n`scancart twin PART --help` explains a part with an example.\n"
             "Example: scancart twin scan accident my-site --quality preview --pictures shown\n");
}

int cmd_twin(int argc, const char **argv) {
    if (argc < 2) {
        print_help(stderr);
        return APP_USAGE;
    }
    if (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h")) {
        print_help(stdout);
        return APP_DONE;
    }
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++)
        if (!strcmp(argv[1], parts[i].name))
            return parts[i].run(argc - 1, argv + 1);
    return app_usage_error("twin", "there is no part '%s'", argv[1]);
}

enum st cmd_twin_scene(const char *name, long seed, double detail, struct scene **out_scene,
                       struct errctx *err) {
    size_t length = strlen(name);
    const char *end = length > 4 ? name + length - 4 : "";
    if (!strcmp(end, ".obj") || !strcmp(end, ".ply") || !strcmp(end, ".OBJ") ||
        !strcmp(end, ".PLY"))
        return scene_load(name, out_scene, err);
    return scene_create(name, (uint64_t)seed, detail, out_scene, err);
}

static void list_text(void) {
    size_t count = 0;
    const struct scene_kind *kinds = scene_kinds(&count);
    (void)printf("Scenes:\n");
    for (size_t i = 0; i < count; i++)
        (void)printf("  %-12s %s\n", kinds[i].name, kinds[i].summary);
    (void)printf("  FILE.obj     a mesh of your own, metres, z up (also .ply)\n\n"
                 "Faults (--fault NAME@START[+DURATION][=VALUE], seconds of cart time):\n");
    for (int i = 0; i < FAULTS_KINDS; i++) {
        const struct faults_info *f = faults_info_of((enum faults_kind)i);
        (void)printf("  %-16s %s%s%s%s\n", f->name, f->what, f->value ? " (value: " : "",
                     f->value ? f->value : "", f->value ? ")" : "");
    }
}

static enum st list_json(struct errctx *err) {
    struct json json;
    json_init_object(&json);
    size_t count = 0;
    const struct scene_kind *kinds = scene_kinds(&count);
    struct cJSON *scenes = json_array(&json, NULL, "scenes");
    for (size_t i = 0; i < count; i++) {
        struct cJSON *o = json_object(&json, scenes, NULL);
        json_text(&json, o, "name", kinds[i].name);
        json_text(&json, o, "summary", kinds[i].summary);
    }
    struct cJSON *faults = json_array(&json, NULL, "faults");
    for (int i = 0; i < FAULTS_KINDS; i++) {
        const struct faults_info *f = faults_info_of((enum faults_kind)i);
        struct cJSON *o = json_object(&json, faults, NULL);
        json_text(&json, o, "name", f->name);
        json_text(&json, o, "what", f->what);
        json_text(&json, o, "value", f->value);
        json_number(&json, o, "default", f->fallback);
    }
    enum st st = json_write(&json, stdout, err);
    json_fini(&json);
    return st;
}

int cmd_twin_list(int argc, const char **argv) {
    bool json = false;
    struct app_usage usage = {.name = "twin list",
                              .synopsis = "[--json]",
                              .about =
                                  "Lists the scenes that the simulated cart can stand in, and the "
                                  "faults that can be let loose.\n\nExample: scancart twin list",
                              .out_json = &json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    (void)poptFreeContext(context);
    struct errctx err = {0};
    if (!json)
        list_text();
    return json && list_json(&err) ? app_fail("twin list", &err) : APP_DONE;
}

int cmd_twin_config(int argc, const char **argv) {
    char *file = NULL;
    const struct poptOption options[] = {{"config", 'c', POPT_ARG_STRING, &file, 0,
                                          "start from this file instead of the defaults", "FILE"},
                                         POPT_TABLEEND};
    struct app_usage usage = {
        .name = "twin config",
        .synopsis = "[--config FILE]",
        .about =
            "Prints all parameters of the simulated cart as YAML: what it is thought to be "
            "(nominal) beside what it is (true), with their meaning. Save it, change it, and give "
            "it to `scancart twin scan --config`.\n\nExample: scancart twin config > my-cart.yaml",
        .options = options};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    struct errctx err = {0};
    struct twin_config config = twin_config_default();
    st = file ? twin_config_load(file, &config, &err) : ST_OK;
    if (!st)
        st = twin_config_write(&config, stdout, &err);
    (void)poptFreeContext(context);
    app_free_options(options);
    return st ? app_fail("twin config", &err) : APP_DONE;
}
