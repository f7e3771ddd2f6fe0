/* The lock of the one writer: flock() on SITE/writer.lock, which the kernel releases whatever
 * happens to the process. The file says who holds it. Only for host/site. */
#ifndef SC_SITE_WRITER_LOCK_H
#define SC_SITE_WRITER_LOCK_H

#include "base/st.h"

/* Takes the lock without waiting and writes "pid PID on HOST" into the file.
 * ST_BUSY with the text of who holds it. */
ST_MUST_CHECK enum st writer_lock_take(const char *site_path, int *out_fd, struct errctx *err);

/* Empties the file and releases the lock; takes -1. The file stays: removing it would race. */
void writer_lock_release(int fd);

#endif
