/* Parts of the fusion benchmark: each prints text for people on stderr and figures as JSON on
 * stdout. */
#ifndef SC_TESTS_BENCH_FUSION_H
#define SC_TESTS_BENCH_FUSION_H

#include "fusion/resolve.h"
#include "fusion/scatter.h"

#include <stdbool.h>
#include <stddef.h>

/* One figure of the JSON list. */
void bench_figure(const char *name, double value, const char *unit);
double bench_wall_s(void);
double bench_cpu_s(void); /* of the whole process */
/* Ends the program on a failure: a benchmark has nothing to recover. */
void bench_check(enum st st, const struct errctx *err);

/* A photograph of a scene of the twin at quality field, coloured by intensity; free with
 * photo_destroy(). */
struct photo bench_scene_photo(const char *scene, bool quick);

int bench_speed(bool quick);
int bench_accuracy(bool quick);
int bench_skins(bool quick);
int bench_cull(bool quick);
int bench_code(bool quick);
/* Samples for a peer: writes x y z floats; and reads back its depths to count what floats. */
int bench_peer_write(const char *path);
int bench_peer_read(const char *path, double seconds);

#endif
