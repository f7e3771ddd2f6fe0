/* The subcommands: one file each, cmd_NAME.c. */
#ifndef SC_APP_COMMANDS_H
#define SC_APP_COMMANDS_H

int cmd_capture(int argc, const char **argv);
int cmd_check(int argc, const char **argv);
int cmd_cull(int argc, const char **argv);
int cmd_fuse(int argc, const char **argv);
int cmd_import(int argc, const char **argv);
int cmd_info(int argc, const char **argv);
int cmd_new(int argc, const char **argv);
int cmd_controller(int argc, const char **argv);
int cmd_panorama(int argc, const char **argv);
int cmd_sheet(int argc, const char **argv);
int cmd_shot(int argc, const char **argv);
int cmd_twin(int argc, const char **argv);
int cmd_fly(int argc, const char **argv);
int cmd_view(int argc, const char **argv);
int cmd_version(int argc, const char **argv);

#endif
