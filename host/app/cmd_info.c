#include "app/app.h"
#include "app/app_info.h"
#include "app/app_site.h"
#include "app/commands.h"

static const char about[] =
    "Tells what a site holds: where it lies, its stations with their poses, what each device sent "
    "and how much of "
    "it is missing, camera frames, 3D photographs, calibrations, jobs, and the last entry in the "
    "record of who "
    "did what. Reads the headers only; 'scancart check' verifies the content.\n\n"
    "Example: scancart info accident-a7 --json";

static int run(const char *path, bool json) {
    struct errctx err = {0};
    struct site *site = NULL;
    enum st st = app_site_open(path, SITE_READ, "info", &site, &err);
    if (!st)
        st = json ? app_info_json(site, &err) : app_info_text(site, &err);
    (void)site_close(site, NULL);
    return st ? app_fail("info", &err) : APP_DONE;
}

int cmd_info(int argc, const char **argv) {
    bool json = false;
    const struct app_usage usage = {
        .name = "info", .synopsis = "SITE [--json]", .about = about, .out_json = &json};
    return app_one_site(&usage, argc, argv, run);
}
