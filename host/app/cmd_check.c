#include "app/app.h"
#include "app/app_site.h"
#include "app/commands.h"
#include "base/json.h"
#include "base/progress.h"
#include "site/site_check.h"

#include <inttypes.h>
#include <stdio.h>

static const char about[] =
    "Verifies a whole site: the structure of its database, the hash of every row, the chain of the "
    "raw data, the "
    "balance of what was sent, stored and lost, the record of who did what, and every file. It "
    "changes nothing "
    "and names every place that is not as it was written, the first one first.\n\n"
    "Exit status 1 if anything that was measured or made from it is damaged or missing. Warnings "
    "(a file that "
    "the site does not know, a log left by a power cut) do not fail.\n\n"
    "Example: scancart check accident-a7 && echo good";

struct state {
    struct progress bar;
    bool drawing, json_wanted;
    int64_t start_ns;
    struct json json;
    struct cJSON *findings;
};

static const char *severity_name(enum site_check_severity severity) {
    return severity == SITE_CHECK_ERROR ? "error" : "warning";
}

static void on_finding(void *context, const struct site_check_finding *finding) {
    struct state *state = context;
    if (state->drawing)
        progress_fini(&state->bar, false);
    state->drawing = false;
    if (!state->json_wanted) {
        (void)printf("%s: %s: %s\n", severity_name(finding->severity), finding->where,
                     finding->what);
        return;
    }
    struct cJSON *one = json_object(&state->json, state->findings, NULL);
    json_text(&state->json, one, "severity", severity_name(finding->severity));
    json_text(&state->json, one, "where", finding->where);
    json_text(&state->json, one, "what", finding->what);
}

static bool on_progress(void *context, int64_t done_bytes, int64_t total_bytes) {
    struct state *state = context;
    if (!state->drawing) {
        progress_init(&state->bar, stderr, "check", 1, "MB");
        if (!state->start_ns)
            state->start_ns = state->bar.start_ns;
        state->bar.start_ns = state->start_ns; /* a finding ends one bar and starts another */
        state->drawing = true;
    }
    state->bar.total = total_bytes / 1000000 + 1; /* grows when the files are counted */
    int64_t done = done_bytes / 1000000;
    progress_add(&state->bar, done - (int64_t)atomic_load(&state->bar.done));
    return true;
}

static enum st print_json(struct state *state, const struct site_check_result *result,
                          struct errctx *err) {
    struct json *json = &state->json;
    json_boolean(json, NULL, "good", result->errors == 0);
    json_integer(json, NULL, "errors", result->errors);
    json_integer(json, NULL, "warnings", result->warnings);
    json_integer(json, NULL, "rows", result->rows);
    json_integer(json, NULL, "chunks", result->chunks);
    json_integer(json, NULL, "files", result->files);
    json_integer(json, NULL, "file_bytes", result->bytes);
    json_boolean(json, NULL, "stopped_early", result->stopped_early);
    return json_write(json, stdout, err);
}

static int report(const char *path, struct state *state, const struct site_check_result *result,
                  struct errctx *err) {
    if (state->json_wanted && print_json(state, result, err))
        return app_fail("check", err);
    if (result->errors) {
        (void)errctx_set(err, ST_DAMAGED,
                         "%s is damaged in %s%" PRId64
                         " place%s, first %s: %s; keep it as it is and "
                         "take a copy from a backup",
                         path, result->stopped_early ? "at least " : "", result->errors,
                         result->errors == 1 ? "" : "s", result->first.where, result->first.what);
        return app_fail("check", err);
    }
    char bytes[APP_SITE_TEXT_MAX];
    if (!state->json_wanted)
        (void)printf("%s is good: %" PRId64 " rows, %" PRId64 " raw chunks, %" PRId64
                     " files of %s verified, %" PRId64 " warning%s\n",
                     path, result->rows, result->chunks, result->files,
                     app_site_bytes(result->bytes, bytes), result->warnings,
                     result->warnings == 1 ? "" : "s");
    return APP_DONE;
}

static int run(const char *path, bool json) {
    struct state state = {.json_wanted = json};
    struct site_check_options options = {
        .on_finding = on_finding, .on_progress = on_progress, .context = &state};
    struct site_check_result result = {0};
    struct errctx err = {0};
    json_init_object(&state.json);
    json_text(&state.json, NULL, "site", path);
    state.findings = json_array(&state.json, NULL, "findings");
    enum st st = site_check(path, &options, &result, &err);
    if (state.drawing)
        progress_fini(&state.bar, false);
    int status = st ? app_fail("check", &err) : report(path, &state, &result, &err);
    json_fini(&state.json);
    return status;
}

int cmd_check(int argc, const char **argv) {
    bool json = false;
    const struct app_usage usage = {
        .name = "check", .synopsis = "SITE [--json]", .about = about, .out_json = &json};
    return app_one_site(&usage, argc, argv, run);
}
