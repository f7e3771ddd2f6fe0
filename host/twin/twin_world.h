/* Inside of the twin's devices: the simulated world that they share, its time, and what waits to be
 * fetched. Everything but the constants is under the lock. */
#ifndef SC_TWIN_TWIN_WORLD_H
#define SC_TWIN_TWIN_WORLD_H

#include "base/edge_record.h"
#include "device/cart_devices.h"
#include "twin/cart.h"
#include "twin/twin_devices.h"

#include <pthread.h>

enum {
    TWIN_WORLD_TRANSFER_BYTES = 8192, /* of the head: 16 full packets */
    TWIN_WORLD_TRANSFERS = 4096,      /* 90 s at 25 kHz */
    TWIN_WORLD_EDGES = 4096,
    TWIN_WORLD_EXPOSURES = 64
};

/* One bulk transfer of the head. It ends when it is full, with a short packet, or by time. */
struct twin_world_transfer {
    int64_t t_first_ns, t_last_ns; /* host */
    size_t size;
    uint8_t bytes[TWIN_WORLD_TRANSFER_BYTES];
};

struct twin_world_exposure {
    int64_t t_host_ns;
    uint32_t seq;
    double pan_rad, tilt_rad, light, factor;
};

/* A queue's counters: items `taken` to `put` wait in slots n % capacity. */
struct twin_world_queue {
    uint64_t taken, put, lost;
};

struct twin_world_head {
    struct head head;
    struct twin_devices *twin;
    bool started;
    struct twin_world_transfer *transfer; /* [TWIN_WORLD_TRANSFERS] */
    struct twin_world_queue queue;
    struct head_stats stats;
};

struct twin_world_lines {
    struct lines lines;
    struct twin_devices *twin;
    struct edge_record edge[TWIN_WORLD_EDGES];
    struct twin_world_queue queue;
    struct lines_stats stats;
    uint8_t high;
};

struct twin_world_camera {
    struct camera_device camera;
    struct twin_devices *twin;
    bool started;
    struct camera_settings settings;
    struct twin_world_exposure exposure[TWIN_WORLD_EXPOSURES];
    struct twin_world_queue queue;
    uint32_t strobes;
    double late; /* factor that the next exposure still has */
    uint8_t *jpeg;
};

struct twin_devices {
    /* constant */
    const struct scene *scene;
    struct twin_config config;
    struct faults faults;
    struct pose world_from_station;
    uint64_t seed;
    void (*shot)(void *ctx, const struct cart_shot *shot);
    void *shot_ctx;
    bool real_time;
    int64_t zero_ns; /* real time: the host's clock at true time 0 */
    struct hosttime hosttime;
    struct cart_hooks hooks;
    struct motor *motor;
    struct motor_ops motor_ops;
    const struct motor_ops *motor_inner_ops;
    pthread_t thread;
    bool has_thread, has_lock;
    /* under the lock */
    pthread_mutex_t lock;
    pthread_cond_t news;
    struct cart *cart;
    bool stopping;
    enum st ended; /* not ST_OK: this world is over */
    struct errctx why;
    struct twin_world_head head;
    struct twin_world_lines lines;
    struct twin_world_camera camera;
};

/* Enters the world: takes the lock, lets the head follow (virtual time) or time come up to now
 * (real time). Not ST_OK (and no lock): the world has ended. */
ST_MUST_CHECK enum st twin_world_enter(struct twin_devices *twin, struct errctx *err);
void twin_world_leave(struct twin_devices *twin);

/* Host time, of the world that one has entered. */
int64_t twin_world_now_ns(const struct twin_devices *twin);
/* The host time of something that the cart's host clock showed. */
int64_t twin_world_host_ns(const struct twin_devices *twin, int64_t cart_host_ns);
/* Makes room for one more item: its slot, or -1 (counted as lost). */
int twin_world_put(struct twin_world_queue *queue, int capacity);

/* Waits for news until host time `until_ns`, in a world that one has entered; returns after each
 * piece of them, *out_over when that time has come. Not ST_OK: the world has ended (and the lock is
 * given back). */
ST_MUST_CHECK enum st twin_world_await(struct twin_devices *twin, int64_t until_ns, bool *out_over,
                                       struct errctx *err);

/* struct hosttime's calls, with the lock inside. */
int64_t twin_world_time_now(void *ctx);
enum st twin_world_time_wait(void *ctx, int64_t t_ns, struct errctx *err);
/* The thread of real time: until twin->stopping or the end of the world. */
void twin_world_follow(struct twin_devices *twin);
/* struct cart_hooks' calls: they enter and leave the world around a request. */
enum st twin_world_request_begins(void *ctx, struct errctx *err);
enum st twin_world_request_ends(void *ctx, struct errctx *err);
int64_t twin_world_request_now(void *ctx);

/* Devices: their ops, and what the cart's sink gives them. */
void twin_head_init(struct twin_devices *twin);
void twin_head_packet(struct twin_devices *twin, const struct cart_packet *packet);
void twin_lines_init(struct twin_devices *twin);
void twin_lines_edge(struct twin_devices *twin, const struct cart_edge *edge);
void twin_camera_init(struct twin_devices *twin);
void twin_camera_strobe(struct twin_devices *twin, const struct cart_edge *edge);

#endif
