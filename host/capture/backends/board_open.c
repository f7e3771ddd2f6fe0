#include "capture/backends/board_open.h"

#include "capture/backends/camera_libcamera.h"
#include "capture/backends/camera_v4l2.h"
#include "capture/backends/head_usb.h"
#include "capture/backends/lines_gpiod.h"
#include "capture/backends/motor_modbus.h"
#include "capture/backends/replay.h"

#include <stdlib.h>
#include <string.h>

struct board_open {
    struct cart_devices cart;
    struct replay *replay; /* NULL: real devices */
};

static enum st open_motor(const struct board_controller *at, struct board_open *board,
                          struct errctx *err) {
    struct motor_modbus_config config = motor_modbus_default();
    config.device = at->device;
    config.baud = at->baud;
    config.unit = at->unit;
    config.timeout_ms = at->timeout_ms;
    if (at->parity)
        config.parity = !strcmp(at->parity, "none") ? 'N' : !strcmp(at->parity, "odd") ? 'O' : 'E';
    return motor_modbus_open(&config, &board->cart.motor, err);
}

static enum st open_head(const struct board_head *at, struct board_open *board,
                         struct errctx *err) {
    struct head_usb_config config = head_usb_default();
    config.vendor = at->usb_vendor;
    config.product = at->usb_product;
    config.serial = at->serial;
    return head_usb_open(&config, &board->cart.head, err);
}

static enum lines_gpiod_bias bias_of(const char *text) {
    return !text                        ? LINES_GPIOD_BIAS_AS_IS
           : !strcmp(text, "pull-up")   ? LINES_GPIOD_BIAS_PULL_UP
           : !strcmp(text, "pull-down") ? LINES_GPIOD_BIAS_PULL_DOWN
                                        : LINES_GPIOD_BIAS_NONE;
}

static enum st open_lines(const struct board_gpio *at, struct board_open *board,
                          struct errctx *err) {
    struct lines_gpiod_config config = {.chip = at->chip,
                                        .line = {[EDGE_RECORD_INDEX] = at->mirror_index,
                                                 [EDGE_RECORD_STROBE] = at->strobe,
                                                 [EDGE_RECORD_ESTOP] = at->estop,
                                                 [EDGE_RECORD_INTERLOCK] = at->interlock},
                                        .bias = bias_of(at->bias)};
    return lines_gpiod_open(&config, &board->cart.lines, err);
}

static enum st open_camera(const struct board_camera *at, struct board_open *board,
                           struct errctx *err) {
    return at->driver && !strcmp(at->driver, "libcamera")
               ? camera_libcamera_open(at->device, &board->cart.camera, err)
               : camera_v4l2_open(at->device, &board->cart.camera, err);
}

static enum st open_real(const struct board_config *config,
                         const struct board_open_options *options, struct board_open *board,
                         struct errctx *err) {
    if (!config->controller.device || !config->head.usb_vendor)
        return errctx_set(err, ST_INVALID, "the board file leaves out %s: a cart needs both",
                          config->controller.device ? "head.usb_vendor" : "controller.device");
    board->cart.hosttime = &hosttime_real;
    enum st st = open_motor(&config->controller, board, err);
    if (!st)
        st = open_head(&config->head, board, err);
    if (!st && config->gpio.chip && !options->no_lines)
        st = open_lines(&config->gpio, board, err);
    if (!st && config->camera.device && !options->no_camera)
        st = open_camera(&config->camera, board, err);
    return st;
}

/* Lines and camera are left out where the recording has none. */
static enum st open_replay(const struct board_replay *at, const struct board_open_options *options,
                           struct board_open *board, struct errctx *err) {
    enum st st = replay_open(at->site, at->station, at->real_time, &board->replay, err);
    if (st)
        return st;
    board->cart.hosttime = &board->replay->hosttime;
    st = motor_replay_open(board->replay, &board->cart.motor, err);
    if (!st)
        st = head_replay_open(board->replay, &board->cart.head, err);
    if (!st && !options->no_lines)
        st = lines_replay_open(board->replay, &board->cart.lines, err);
    if (st == ST_NOT_FOUND && board->cart.head)
        st = ST_OK;
    if (!st && !options->no_camera)
        st = camera_replay_open(board->replay, &board->cart.camera, err);
    return st == ST_NOT_FOUND && board->cart.head ? ST_OK : st;
}

enum st board_open(const struct board_config *config, const struct board_open_options *options,
                   struct board_open **out_board, struct errctx *err) {
    static const struct board_open_options all = {false, false};
    if (config->twin)
        return errctx_set(err, ST_INVALID, "board '%s' is a simulated cart",
                          config->name ? config->name : "");
    struct board_open *board = calloc(1, sizeof *board);
    if (!board)
        return errctx_set(err, ST_NOMEM, "no memory for the board");
    options = options ? options : &all;
    enum st st = config->replay ? open_replay(config->replay, options, board, err)
                                : open_real(config, options, board, err);
    if (st)
        board_open_close(board);
    else
        *out_board = board;
    return st;
}

struct cart_devices board_open_cart(const struct board_open *board) {
    return board->cart;
}

void board_open_close(struct board_open *board) {
    if (!board)
        return;
    camera_device_close(board->cart.camera);
    lines_close(board->cart.lines);
    head_close(board->cart.head);
    motor_close(board->cart.motor);
    replay_close(board->replay);
    free(board);
}
