#include "app/app.h"
#include "app/commands.h"

#include <stdio.h>

int cmd_version(int argc, const char **argv) {
    bool json = false;
    struct app_usage usage = {.name = "version",
                              .synopsis = "[--json]",
                              .about = "Prints the version of the program.\n"
                                       "Example: scancart version",
                              .out_json = &json};
    poptContext context = NULL;
    enum st st = app_parse(&usage, argc, argv, &context);
    if (st)
        return app_parse_exit(st);
    (void)printf(json ? "{\"version\": \"%s\"}\n" : "scancart %s\n", SCANCART_VERSION);
    (void)poptFreeContext(context);
    return APP_DONE;
}
