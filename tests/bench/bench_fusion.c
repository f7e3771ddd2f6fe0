/* Fusion: speed, accuracy against truth, skins, culling, bits. JSON list on stdout, tables on
 * stderr. Usage: bench_fusion PART [--quick]      PART: speed accuracy skins cull code
 *        bench_fusion peer-write FILE | peer-read FILE SECONDS */
#include "bench_fusion.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static int figures;

void bench_figure(const char *name, double value, const char *unit) {
    (void)printf("%s{\"name\": \"%s\", \"value\": %.9g, \"unit\": \"%s\"}",
                 figures++ ? ",\n " : "[", name, value, unit);
}

static double clock_s(clockid_t which) {
    struct timespec t = {0, 0};
    (void)clock_gettime(which, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
double bench_wall_s(void) {
    return clock_s(CLOCK_MONOTONIC);
}
double bench_cpu_s(void) {
    return clock_s(CLOCK_PROCESS_CPUTIME_ID);
}

void bench_check(enum st st, const struct errctx *err) {
    if (!st)
        return;
    (void)fprintf(stderr, "bench_fusion: %s\n", err && err->text[0] ? err->text : st_name(st));
    exit(1);
}

int main(int argc, char **argv) {
    const char *part = argc > 1 ? argv[1] : "";
    bool quick = argc > 2 && !strcmp(argv[2], "--quick");
    int status = 2;
    if (!strcmp(part, "speed"))
        status = bench_speed(quick);
    else if (!strcmp(part, "accuracy"))
        status = bench_accuracy(quick);
    else if (!strcmp(part, "skins"))
        status = bench_skins(quick);
    else if (!strcmp(part, "cull"))
        status = bench_cull(quick);
    else if (!strcmp(part, "code"))
        status = bench_code(quick);
    else if (!strcmp(part, "peer-write") && argc == 3)
        status = bench_peer_write(argv[2]);
    else if (!strcmp(part, "peer-read") && argc == 4)
        status = bench_peer_read(argv[2], atof(argv[3]));
    if (status == 2)
        (void)fprintf(stderr, "bench_fusion: see the head of tests/bench/bench_fusion.c\n");
    else
        (void)printf("%s]\n", figures ? "" : "[");
    return status;
}
