/* What every subcommand of the program shares: options, the one place where errors are printed,
 * JSON or text output. */
#ifndef SC_APP_APP_H
#define SC_APP_APP_H

#include "base/st.h"

#include <popt.h>
#include <stdbool.h>
#include <stddef.h>

/* Exit status of the program. */
enum app_exit { APP_DONE = 0, APP_FAILED = 1, APP_USAGE = 2 };

/* One subcommand: `run` gets argv[0] = the subcommand's name and returns an enum app_exit. */
struct app_command {
    const char *name;
    const char *summary; /* one line for `scancart --help` */
    int (*run)(int argc, const char **argv);
};

/* Parses `argv` with a popt table (without help entries: they are added, with --json if out_json is
 * not NULL). `synopsis` is what follows "scancart NAME", `about` a paragraph with at least one
 * example; both are printed by --help. Returns ST_OK and the context from which positional
 * arguments are taken with poptGetArg() (free with poptFreeContext()); ST_CANCELLED after --help
 * (exit APP_DONE); ST_INVALID after a usage error already printed (exit APP_USAGE). */
struct app_usage {
    const char *name, *synopsis, *about;
    const struct poptOption *options; /* ends with POPT_TABLEEND; may be NULL */
    bool *out_json;                   /* NULL: the command has no --json */
};
ST_MUST_CHECK enum st app_parse(const struct app_usage *usage, int argc, const char **argv,
                                poptContext *out_context);

/* Frees what popt allocated for the strings and lists of a table and sets them to NULL. */
void app_free_options(const struct poptOption *table);

/* A whole subcommand that takes one site and no option but --json: parses, then calls run() with
 * the site's path. Returns the exit status. */
int app_one_site(const struct app_usage *usage, int argc, const char **argv,
                 int (*run)(const char *path, bool json));

/* Copies an option's text (NULL: none, "") into a field. APP_USAGE, with the error printed, if it
 * does not fit. */
int app_take_text(const char *name, const char *text, char *out_field, size_t size);

/* The exit status for a status of app_parse(). */
int app_parse_exit(enum st st);

/* Prints "scancart NAME: text" on stderr and returns APP_FAILED; the only place errors are printed.
 */
int app_fail(const char *name, const struct errctx *err);

/* Prints a usage error and returns APP_USAGE. */
int app_usage_error(const char *name, const char *fmt, ...) ST_PRINTF(2, 3);

#endif
