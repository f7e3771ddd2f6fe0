/* What a thread that must not be late asks of Linux: first-in-first-out priority, a processor of
 * its own, memory that stays. Whatever the system does not grant is said once and done without. */
#ifndef SC_CAPTURE_REALTIME_H
#define SC_CAPTURE_REALTIME_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Higher is more urgent; both below the kernel's interrupt threads (50). */
enum realtime_priority { REALTIME_LINES = 38, REALTIME_HEAD = 40 };

/* Starts a thread with that priority on the processor `number` (modulo those there are; < 0: any).
 * Falls back to a normal thread. Returns 0 or an errno; *out_granted: priority and processor were
 * given. */
int realtime_start(pthread_t *out_thread, void *(*run)(void *), void *arg, int priority, int number,
                   bool *out_granted);

/* Locks the memory that is there now; false with a reason for a person if that is not allowed. */
bool realtime_lock_memory(char *out_why, size_t size);
void realtime_unlock_memory(void);

#ifdef __cplusplus
}
#endif
#endif
