/* What the test in the virtual machine drives: real backends on real kernel devices.
 *
 * vm_probe take BOARD SECONDS          opens all that the board has and takes data from each
 * vm_probe refuse BOARD STATUS WORD [BOARD STATUS WORD ...]
 *                                      opening must fail with that status, the text hold the word
 * vm_probe save BOARD                  stores the commissioning values of a new controller
 * vm_probe version BOARD               the head's first packets must be refused
 * vm_probe unplug BOARD head|lines|camera COMMAND   the device must be said to be gone, within 5 s
 */
#include "base/clock.h"
#include "base/head_packet.h"
#include "capture/backends/board_open.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { REST_BYTES = 1 << 20 };

struct taken {
    uint8_t bytes[REST_BYTES];
    size_t size;
    struct head_stream_stats stream;
    uint64_t samples, lost_packets;
    uint32_t next_packet;
    bool any;
    unsigned edges[LINES_COUNT];
    int64_t last_index_ns, longest_turn_ns;
};

static struct taken taken;

static void take_bytes(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns) {
    struct taken *t = ctx;
    (void)t_host_ns;
    if (size > REST_BYTES - t->size) {
        t->lost_packets++;
        return;
    }
    memcpy(t->bytes + t->size, bytes, size);
    t->size += size;
    size_t offset = 0;
    struct head_packet p;
    while (!head_stream_next(t->bytes, t->size, &offset, &p, &t->stream)) {
        if (t->any)
            t->lost_packets += p.packet_seq - t->next_packet;
        t->any = true;
        t->next_packet = p.packet_seq + 1;
        t->samples += p.sample_count;
    }
    memmove(t->bytes, t->bytes + offset, t->size - offset);
    t->size -= offset;
}

static void take_edge(void *ctx, const struct edge_record *edge) {
    struct taken *t = ctx;
    t->edges[edge->line]++;
    if (edge->line != EDGE_RECORD_INDEX)
        return;
    int64_t turn_ns = edge->t_ns - t->last_index_ns;
    if (t->last_index_ns && turn_ns > t->longest_turn_ns)
        t->longest_turn_ns = turn_ns;
    t->last_index_ns = edge->t_ns;
}

static const struct head_sink head_sink = {&taken, take_bytes};
static const struct lines_sink lines_sink = {&taken, take_edge};

static int complain(const char *what, const struct errctx *err) {
    (void)printf("FAILED %s: %s (%s)\n", what, err->text, st_name(err->st));
    return 1;
}

static int ask_motor(struct motor *motor, struct errctx *err) {
    struct motor_identity id;
    struct motor_status status;
    int64_t start_ns = clock_now_ns();
    unsigned asked = 0;
    if (motor->ops->identify(motor, &id, err))
        return complain("motor", err);
    for (; asked < 8; asked++)
        if (motor->ops->status(motor, &status, err))
            return complain("motor", err);
    (void)printf("motor: board %u, firmware %u.%u.%u, %u statuses in %.1f s, %u bad frames\n",
                 id.board_id, id.fw_major, id.fw_minor, id.fw_patch, asked,
                 (double)(clock_now_ns() - start_ns) * 1e-9, status.frames_bad);
    return id.board_id != 2;
}

static int take_pictures(struct camera_device *camera, struct errctx *err) {
    struct camera_device_identity id;
    struct camera_settings s = {640, 480, 0.01, 1, 0, 5000};
    const struct camera_device_ops *ops = camera->ops;
    if (ops->identify(camera, &id, err) || ops->configure(camera, &s, err) ||
        ops->start(camera, err))
        return complain("camera", err);
    (void)printf("camera: %s '%s', %ux%u, exposure %g s, gain %g, focus %g, white %g K\n",
                 id.driver, id.product, s.width_px, s.height_px, s.exposure_s, s.gain,
                 s.focus_diopter, s.white_balance_k);
    unsigned frames = 0;
    uint32_t first_seq = 0, last_seq = 0;
    for (; frames < 5; frames++) {
        struct camera_frame f;
        int64_t after_ns = clock_now_ns();
        if (ops->frame(camera, after_ns, 5000, &f, err))
            return complain("camera", err);
        if (f.t_ns < after_ns || f.t_ns > clock_now_ns() || !f.settings_held ||
            f.size < f.width_px || f.width_px != s.width_px)
            return complain("camera: a frame that was not asked for", err);
        first_seq = frames ? first_seq : f.seq;
        last_seq = f.seq;
    }
    (void)printf("camera: %u frames, numbers %u to %u\n", frames, first_seq, last_seq);
    return ops->stop(camera, err) ? complain("camera", err) : 0;
}

static int pump_both(const struct cart_devices *cart, double seconds, struct errctx *err) {
    struct lines_levels levels;
    if (cart->lines->ops->levels(cart->lines, &levels, err))
        return complain("lines", err);
    if (cart->head->ops->start(cart->head, err))
        return complain("head", err);
    int64_t end_ns = clock_now_ns() + llround(seconds * 1e9);
    while (clock_now_ns() < end_ns) {
        if (cart->head->ops->pump(cart->head, 20, &head_sink, err))
            return complain("head", err);
        if (cart->lines->ops->pump(cart->lines, 0, &lines_sink, err))
            return complain("lines", err);
    }
    if (cart->head->ops->stop(cart->head, &head_sink, err))
        return complain("head", err);
    struct head_stats stats;
    cart->head->ops->stats(cart->head, &stats);
    (void)printf("head: %llu samples in %llu packets, %llu lost, %llu bytes skipped, %llu "
                 "transfers, %llu errors\n",
                 (unsigned long long)taken.samples, (unsigned long long)taken.stream.packets,
                 (unsigned long long)taken.lost_packets,
                 (unsigned long long)taken.stream.bytes_skipped,
                 (unsigned long long)stats.transfers, (unsigned long long)stats.transfer_errors);
    (void)printf("lines: wired %x, high %x, %u index edges, longest turn %.0f ms\n", levels.wired,
                 levels.high, taken.edges[EDGE_RECORD_INDEX], (double)taken.longest_turn_ns * 1e-6);
    unsigned chains = 1u << EDGE_RECORD_ESTOP | 1u << EDGE_RECORD_INTERLOCK;
    return !taken.samples || taken.lost_packets || stats.transfer_errors ||
           (levels.high & chains) != chains || taken.edges[EDGE_RECORD_INDEX] < 2;
}

static int take(const struct board_config *board, double seconds) {
    struct errctx err = {0};
    struct board_open *open = NULL;
    if (board_open(board, NULL, &open, &err))
        return complain("open", &err);
    struct cart_devices cart = board_open_cart(open);
    int bad = !cart.lines || !cart.camera;
    bad = bad || ask_motor(cart.motor, &err) || take_pictures(cart.camera, &err) ||
          pump_both(&cart, seconds, &err);
    board_open_close(open);
    return bad;
}

static int refuse(const char *path, const char *status, const char *word) {
    struct errctx err = {0};
    struct board_config *board = NULL;
    struct board_open *open = NULL;
    if (board_config_load(path, &board, &err))
        return complain(path, &err);
    enum st st = board_open(board, NULL, &open, &err);
    board_open_close(open);
    board_config_free(board);
    int bad = !st || strcmp(st_name(st), status) || !strstr(err.text, word);
    (void)printf("%s: %s: %s\n", bad ? "NOT as wanted" : "refused", st_name(st), err.text);
    return bad;
}

enum watched { HEAD, LINES, CAMERA };

static enum st start(const struct cart_devices *cart, enum watched what, struct errctx *err) {
    struct camera_settings s = {640, 480, 0.01, 1, 0, 5000};
    if (what == HEAD)
        return cart->head->ops->start(cart->head, err);
    if (what == LINES)
        return ST_OK;
    enum st st = cart->camera->ops->configure(cart->camera, &s, err);
    return st ? st : cart->camera->ops->start(cart->camera, err);
}

static enum st take_some(const struct cart_devices *cart, enum watched what, struct errctx *err) {
    struct camera_frame frame;
    if (what == HEAD)
        return cart->head->ops->pump(cart->head, 20, &head_sink, err);
    if (what == LINES)
        return cart->lines->ops->pump(cart->lines, 20, &lines_sink, err);
    enum st st = cart->camera->ops->frame(cart->camera, 0, 200, &frame, err);
    return st == ST_TIMEOUT ? ST_OK : st;
}

/* Takes data until an op fails; prints how. 0 if it is that status. */
static int take_until(const struct cart_devices *cart, enum watched what, enum st wanted) {
    struct errctx err = {0};
    enum st st = ST_OK;
    int64_t end_ns = clock_now_ns() + 5000000000;
    while (!st && clock_now_ns() < end_ns)
        st = take_some(cart, what, &err);
    (void)printf("ended: %s: %s\n", st_name(st), err.text);
    return st != wanted;
}

static int watch(const struct board_config *board, enum watched what, const char *command,
                 enum st wanted) {
    struct errctx err = {0};
    struct board_open *open = NULL;
    if (board_open(board, NULL, &open, &err))
        return complain("open", &err);
    struct cart_devices cart = board_open_cart(open);
    int bad = start(&cart, what, &err) ? complain("start", &err) : 0;
    if (!bad && command)
        bad = system(command);
    bad = bad || take_until(&cart, what, wanted);
    board_open_close(open);
    return bad;
}

static int save(const struct board_config *board) {
    struct errctx err = {0};
    struct board_open *open = NULL;
    if (board_open(board, NULL, &open, &err))
        return complain("open", &err);
    struct motor *motor = board_open_cart(open).motor;
    enum st st = motor->ops->save(motor, &err);
    board_open_close(open);
    return st ? complain("save", &err) : 0;
}

int main(int argc, char **argv) {
    struct errctx err = {0};
    struct board_config *board = NULL;
    const char *what = argc > 2 ? argv[1] : "";
    if (argc < 3 || board_config_load(argv[2], &board, &err)) {
        (void)fprintf(stderr, "vm_probe: %s\n", argc < 3 ? "which board?" : err.text);
        return 2;
    }
    int bad = 2;
    if (!strcmp(what, "refuse") && argc % 3 == 2) {
        bad = 0;
        for (int i = 2; i < argc; i += 3)
            bad += refuse(argv[i], argv[i + 1], argv[i + 2]);
    } else if (!strcmp(what, "take") && argc == 4)
        bad = take(board, strtod(argv[3], NULL));
    else if (!strcmp(what, "save"))
        bad = save(board);
    else if (!strcmp(what, "version"))
        bad = watch(board, HEAD, NULL, ST_UNSUPPORTED);
    else if (!strcmp(what, "unplug") && argc == 5)
        bad = watch(board,
                    !strcmp(argv[3], "head")    ? HEAD
                    : !strcmp(argv[3], "lines") ? LINES
                                                : CAMERA,
                    argv[4], ST_DEVICE);
    board_config_free(board);
    return bad;
}
