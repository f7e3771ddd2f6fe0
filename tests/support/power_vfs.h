/* An SQLite VFS over the real one that can take the power away: it knows for each file what was
 * flushed and what was only written, and can fail a write. While it is installed, every database
 * opened in the process goes through it. One process, one thread. */
#ifndef SC_TESTS_POWER_VFS_H
#define SC_TESTS_POWER_VFS_H

#include "base/rng.h"

#include <stdbool.h>
#include <stdint.h>

/* Makes it the default; forgets everything it knew. Existing files count as flushed when they are
 * opened. */
void power_vfs_install(void);
/* The system's own is the default again. */
void power_vfs_remove(void);

/* Writes, truncations and flushes so far. */
int64_t power_vfs_operations(void);

/* The operation with this number (from 1) and the following `count - 1` ones fail, as on a full or
 * broken disk. 0: none. */
void power_vfs_fail_at(int64_t operation, int64_t count);

/* Calls back before every operation, with its number. */
void power_vfs_on_operation(void (*callback)(int64_t operation));

/* Writes to `folder` what the disk would hold if the power went now: of each file in `site_folder`
 * (those opened through this VFS) the flushed bytes, and of each sector of 512 bytes written since,
 * the old or the new content by chance. A file that was removed is not there. */
bool power_vfs_cut(struct rng *rng, const char *site_folder, const char *folder);

#endif
