/* What the replaying backends share: the time that a recorded station lives in.
 *
 * A recording is played back through the same operations as the devices themselves: the head's
 * bytes, the lines' edges, the controller's events and the camera's frames come as they came, at
 * the host times at which they came. `replay_time` is that host time: virtual (it stands still but
 * in waiting, so a recording runs as fast as the machine can) or following the host's clock.
 *
 * Commands are taken and answered as a healthy cart would: axes arrive at once, the mirror is at
 * its speed, a sweep is under way until the recording of the head ends. Nothing recorded is thrown
 * away by a command that comes earlier or later than it did: starting the head moves the time to
 * where its recording begins.
 *
 * Threads: each device may have one of its own (each reads the site through a handle of its own).
 */
#ifndef SC_CAPTURE_REPLAY_H
#define SC_CAPTURE_REPLAY_H

#include "base/atomic.h"
#include "base/st.h"
#include "device/cart_devices.h"
#include "site/site.h"
#include "site/stream.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { REPLAY_PATH_MAX = 1024 };

/* The recording and its time. */
struct replay {
    /* constant after open */
    struct hosttime hosttime;
    char site_path[REPLAY_PATH_MAX];
    int64_t station_id;
    bool real_time;
    int64_t head_first_ns, head_last_ns; /* of the head's recording */
    int64_t first_ns, last_ns;           /* of all */
    /* any thread */
    SC_ATOMIC(int64_t) now_ns;    /* virtual */
    SC_ATOMIC(int64_t) offset_ns; /* real: recorded time minus the host's clock */
};

/* Finds the station (NULL: the first) and what it holds; the time is a little before the first
 * record. ST_NOT_FOUND: no such station, or it has no stream of a head. Errors of the site. */
ST_MUST_CHECK enum st replay_open(const char *site_path, const char *station, bool real_time,
                                  struct replay **out_replay, struct errctx *err);
void replay_close(struct replay *replay); /* after its devices; takes NULL */

int64_t replay_now_ns(const struct replay *replay);
/* Waits until that time, or jumps to it. */
void replay_wait_until(struct replay *replay, int64_t t_ns);
/* Moves the time on to t_ns without waiting, if it is earlier. */
void replay_skip_to(struct replay *replay, int64_t t_ns);

/* The devices. lines and camera: ST_NOT_FOUND if the recording has none. Each outlives nothing but
 * is closed before `replay`. */
ST_MUST_CHECK enum st head_replay_open(struct replay *replay, struct head **out_head,
                                       struct errctx *err);
ST_MUST_CHECK enum st lines_replay_open(struct replay *replay, struct lines **out_lines,
                                        struct errctx *err);
ST_MUST_CHECK enum st motor_replay_open(struct replay *replay, struct motor **out_motor,
                                        struct errctx *err);
ST_MUST_CHECK enum st camera_replay_open(struct replay *replay, struct camera_device **out_camera,
                                         struct errctx *err);

/* --- for the devices: a stream of a recording, item by item --- */

struct replay_reader {
    struct site *site;
    struct stream_reader *reader;
    struct stream_chunk chunk;
    size_t at; /* bytes of the chunk that were taken */
    bool any, ended;
};

/* Opens the station's stream of that kind. ST_NOT_FOUND if there is none. */
ST_MUST_CHECK enum st replay_reader_open(struct replay_reader *reader, const struct replay *replay,
                                         const char *kind, const char *format, struct errctx *err);
void replay_reader_close(struct replay_reader *reader); /* takes a zeroed one */

/* The next at most max_bytes bytes of the chunk, or of the next chunk; *out_t_ns: when they came,
 * from their place between the chunk's first and last time. Not taken until replay_reader_take().
 * ST_NOT_FOUND at the end. */
ST_MUST_CHECK enum st replay_reader_peek(struct replay_reader *reader, size_t max_bytes,
                                         const uint8_t **out_bytes, size_t *out_size,
                                         int64_t *out_t_ns, struct errctx *err);
void replay_reader_take(struct replay_reader *reader, size_t size);

#ifdef __cplusplus
}
#endif
#endif
