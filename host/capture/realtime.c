#define _GNU_SOURCE /* processor sets */
#include "capture/realtime.h"

#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* The attributes of an urgent thread; false if one of them is refused. */
static bool ask(pthread_attr_t *attr, int priority, int number) {
    struct sched_param param;
    memset(&param, 0, sizeof param);
    param.sched_priority = priority;
    bool good = !pthread_attr_setinheritsched(attr, PTHREAD_EXPLICIT_SCHED) &&
                !pthread_attr_setschedpolicy(attr, SCHED_FIFO) &&
                !pthread_attr_setschedparam(attr, &param);
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
    if (number >= 0 && processors > 1) {
        cpu_set_t set;
        CPU_ZERO(&set);
        CPU_SET((size_t)(number % processors), &set);
        good = good && !pthread_attr_setaffinity_np(attr, sizeof set, &set);
    }
    return good;
}

int realtime_start(pthread_t *out_thread, void *(*run)(void *), void *arg, int priority, int number,
                   bool *out_granted) {
    pthread_attr_t attr;
    *out_granted = false;
    if (!pthread_attr_init(&attr)) {
        *out_granted = ask(&attr, priority, number) && !pthread_create(out_thread, &attr, run, arg);
        (void)pthread_attr_destroy(&attr);
    }
    return *out_granted ? 0 : pthread_create(out_thread, NULL, run, arg);
}

bool realtime_lock_memory(char *out_why, size_t size) {
    out_why[0] = 0;
    if (!mlockall(MCL_CURRENT))
        return true;
    (void)snprintf(out_why, size, "memory is not locked: %s", strerror(errno));
    return false;
}

void realtime_unlock_memory(void) {
    (void)munlockall();
}
