/* The scancart program: picks the subcommand. */
#include "app/app.h"
#include "app/commands.h"

#include <stdio.h>
#include <string.h>

/* In the order of a day's work; the list printed by --help. */
static const struct app_command commands[] = {
    {"new", "make an empty site", cmd_new},
    {"import", "take in photographs with depth, and laser scans", cmd_import},
    {"capture", "scan a station with the cart, or its twin", cmd_capture},
    {"panorama", "picture of a scan as seen from its stand", cmd_panorama},
    {"fuse", "make 3D photographs and tiles of what was scanned", cmd_fuse},
    {"cull", "pack the tiles again, leaving out more or less", cmd_cull},
    {"info", "what a site holds", cmd_info},
    {"check", "verify a whole site", cmd_check},
    {"controller", "the cart's controller: status, homing, moves, faults", cmd_controller},
    {"shot", "draw a site from anywhere", cmd_shot},
    {"sheet", "pictures with captions on one sheet", cmd_sheet},
    {"twin", "the simulated cart: scenes, scans, truth", cmd_twin},
    {"fly", "a flight through a site as pictures or a film", cmd_fly},
    {"view", "walk through a site on screen", cmd_view},
    {"version", "print the version", cmd_version},
};

static void print_help(FILE *out) {
    (void)fprintf(out, "scancart: software of a 3D acquisition cart with an onboard viewer\n\n"
                       "Usage: scancart COMMAND [options]\n\nCommands:\n");
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        (void)fprintf(out, "  %-12s %s\n", commands[i].name, commands[i].summary);
    (void)fprintf(out, "\n`scancart COMMAND --help` explains a command with an example.\n"
                       "Exit status: 0 done, 1 failed, 2 wrong usage.\n");
}

enum { MAX_ARGUMENTS = 4096 };

int main(int argc, char **argv) {
    static const char *arguments[MAX_ARGUMENTS + 1];
    if (argc > MAX_ARGUMENTS) {
        (void)fprintf(stderr, "scancart: more than %d arguments\n", MAX_ARGUMENTS);
        return APP_USAGE;
    }
    for (int i = 1; i < argc; i++)
        arguments[i - 1] = argv[i];
    if (argc < 2) {
        print_help(stderr);
        return APP_USAGE;
    }
    if (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h") || !strcmp(argv[1], "help")) {
        print_help(stdout);
        return APP_DONE;
    }
    const char *name = !strcmp(argv[1], "--version") ? "version" : argv[1];
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
        if (!strcmp(name, commands[i].name))
            return commands[i].run(argc - 1, arguments);
    (void)fprintf(stderr, "scancart: no command '%s' (see scancart --help)\n", argv[1]);
    return APP_USAGE;
}
