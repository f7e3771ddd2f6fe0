/* The kinds of `scancart import`: one file each. */
#ifndef SC_APP_CMD_IMPORT_H
#define SC_APP_CMD_IMPORT_H

int cmd_import_photo(int argc, const char **argv);
int cmd_import_scan(int argc, const char **argv);

#endif
