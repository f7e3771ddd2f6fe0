#include "app/app.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int app_fail(const char *name, const struct errctx *err) {
    (void)fflush(stdout);
    (void)fprintf(stderr, "scancart %s: %s\n", name, err->text[0] ? err->text : st_name(err->st));
    return APP_FAILED;
}

int app_usage_error(const char *name, const char *fmt, ...) {
    va_list args;
    va_start(args, fmt);
    (void)fprintf(stderr, "scancart %s: ", name);
    (void)vfprintf(stderr, fmt, args);
    (void)fprintf(stderr, " (see scancart %s --help)\n", name);
    va_end(args);
    return APP_USAGE;
}

void app_free_options(const struct poptOption *table) {
    for (const struct poptOption *o = table; o->longName || o->shortName || o->arg; o++) {
        unsigned kind = o->argInfo & POPT_ARG_MASK;
        if (kind == POPT_ARG_STRING) {
            char **text = o->arg;
            free(*text);
            *text = NULL;
        } else if (kind == POPT_ARG_ARGV) {
            char ***list = o->arg;
            for (char **text = *list; text && *text; text++)
                free(*text);
            free(*list);
            *list = NULL;
        }
    }
}

int app_parse_exit(enum st st) {
    return st == ST_CANCELLED ? APP_DONE : APP_USAGE;
}

enum st app_parse(const struct app_usage *usage, int argc, const char **argv,
                  poptContext *out_context) {
    int json = 0, help = 0;
    struct poptOption none[] = {POPT_TABLEEND};
    struct poptOption with_json[] = {
        {"json", 0, POPT_ARG_NONE, &json, 0, "print the result as JSON", NULL},
        {"help", 'h', POPT_ARG_NONE, &help, 0, "show this help", NULL},
        POPT_TABLEEND};
    struct poptOption *common = usage->out_json ? with_json : with_json + 1;
    struct poptOption table[] = {{NULL, 0, POPT_ARG_INCLUDE_TABLE, NULL, 0, NULL, NULL},
                                 {NULL, 0, POPT_ARG_INCLUDE_TABLE, NULL, 0, NULL, NULL},
                                 POPT_TABLEEND};
    union { /* popt's table wants a plain pointer to a table that it does not change */
        const struct poptOption *in;
        struct poptOption *out;
    } options = {.in = usage->options ? usage->options : none};
    table[0].arg = options.out;
    table[1].arg = common;

    static char program[64]; /* popt keeps the pointer */
    (void)snprintf(program, sizeof program, "scancart %s", usage->name);
    argv[0] = program; /* shown by --help */
    poptContext context = poptGetContext("scancart", argc, argv, table, 0);
    if (!context) {
        (void)app_usage_error(usage->name, "out of memory");
        return ST_INVALID;
    }
    int rc = poptGetNextOpt(context);
    if (rc < -1) {
        (void)app_usage_error(usage->name, "%s: %s", poptBadOption(context, POPT_BADOPTION_NOALIAS),
                              poptStrerror(rc));
        (void)poptFreeContext(context);
        return ST_INVALID;
    }
    if (help) {
        char synopsis[4096];
        (void)snprintf(synopsis, sizeof synopsis, "%s\n\n%s\n\nOptions:", usage->synopsis,
                       usage->about);
        poptSetOtherOptionHelp(context, synopsis);
        poptPrintHelp(context, stdout, 0);
        (void)poptFreeContext(context);
        return ST_CANCELLED;
    }
    if (usage->out_json)
        *usage->out_json = json != 0;
    *out_context = context;
    return ST_OK;
}

int app_one_site(const struct app_usage *usage, int argc, const char **argv,
                 int (*run)(const char *path, bool json)) {
    poptContext context = NULL;
    const enum st st = app_parse(usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    const char *path = poptGetArg(context);
    const int status = !path || poptPeekArg(context) ? app_usage_error(usage->name, "give one site")
                                                     : run(path, *usage->out_json);
    (void)poptFreeContext(context);
    return status;
}

int app_take_text(const char *name, const char *text, char *out_field, size_t size) {
    if (text && strlen(text) >= size)
        return app_usage_error(name, "'%.40s...' is too long", text);
    (void)snprintf(out_field, size, "%s", text ? text : "");
    return APP_DONE;
}
