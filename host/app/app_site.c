#include "app/app_site.h"

#include <stdio.h>
#include <time.h>

void app_site_set_actor(struct site *site, const char *command) {
    char program[SITE_NAME_MAX];
    (void)snprintf(program, sizeof program, "scancart %s %s", SCANCART_VERSION, command);
    site_set_actor(site, NULL, program);
}

enum st app_site_open(const char *path, enum site_mode mode, const char *command,
                      struct site **out_site, struct errctx *err) {
    enum st st = site_open(path, mode, out_site, err);
    if (!st)
        app_site_set_actor(*out_site, command);
    return st;
}

const char *app_site_bytes(int64_t bytes, char out_text[APP_SITE_TEXT_MAX]) {
    static const char *const units[] = {"B", "kB", "MB", "GB", "TB", "PB", "EB"};
    double value = (double)bytes;
    size_t unit = 0;
    while (value >= 999.5 && unit + 1 < sizeof units / sizeof units[0]) {
        value /= 1000;
        unit++;
    }
    int digits = unit == 0 || value >= 99.95 ? 0 : value >= 9.995 ? 1 : 2;
    (void)snprintf(out_text, APP_SITE_TEXT_MAX, "%.*f %s", digits, value, units[unit]);
    return out_text;
}

const char *app_site_time(int64_t utc_ns, char out_text[APP_SITE_TEXT_MAX]) {
    time_t seconds = (time_t)(utc_ns / 1000000000);
    struct tm tm;
    if (!gmtime_r(&seconds, &tm) ||
        !strftime(out_text, APP_SITE_TEXT_MAX, "%Y-%m-%d %H:%M:%S UTC", &tm))
        (void)snprintf(out_text, APP_SITE_TEXT_MAX, "?");
    return out_text;
}
