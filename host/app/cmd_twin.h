/* The parts of `scancart twin`. */
#ifndef SC_APP_CMD_TWIN_H
#define SC_APP_CMD_TWIN_H

#include "base/st.h"
#include "twin/scene.h"

#include <stdbool.h>

/* Each gets argv[0] = its name ("twin scan") and returns an enum app_exit. */
int cmd_twin_list(int argc, const char **argv);
int cmd_twin_scan(int argc, const char **argv);
int cmd_twin_truth(int argc, const char **argv);
int cmd_twin_config(int argc, const char **argv);

/* A scene by name, or from a file ending in .obj or .ply. */
ST_MUST_CHECK enum st cmd_twin_scene(const char *name, long seed, double detail,
                                     struct scene **out_scene, struct errctx *err);

#endif
