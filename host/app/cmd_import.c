#include "app/cmd_import.h"
#include "app/app.h"
#include "app/commands.h"

#include <stdio.h>
#include <string.h>

static const char help[] =
    "Usage: scancart import KIND SITE ...\n\n"
    "Takes in what other instruments measured. The files are kept as they came, named by their "
    "hash; what is made\nof them says from which files, with which parameters and by which "
    "program. "
    "An import that fails leaves the\nsite as it was.\n\n"
    "Kinds:\n"
    "  photo   colour images with depth or disparity maps, as 3D photographs\n"
    "  scan    laser scans (3DTK .3d, PLY range images), as stations\n\n"
    "`scancart import KIND --help` explains a kind with examples.\n";

int cmd_import(int argc, const char **argv) {
    if (argc >= 2 && !strcmp(argv[1], "photo"))
        return cmd_import_photo(argc - 1, argv + 1);
    if (argc >= 2 && !strcmp(argv[1], "scan"))
        return cmd_import_scan(argc - 1, argv + 1);
    if (argc >= 2 && (!strcmp(argv[1], "--help") || !strcmp(argv[1], "-h"))) {
        (void)printf("%s", help);
        return APP_DONE;
    }
    return argc < 2 ? app_usage_error("import", "what to import: photo or scan?")
                    : app_usage_error("import", "no kind '%s': photo or scan?", argv[1]);
}
