/* libgpiod 2.x as far as scancart uses it, on a chip in memory (chip_sim.h). */
#include "tests/support/chip_sim.h"

#include <errno.h>
#include <gpiod.h>
#include <stdlib.h>
#include <string.h>

enum { QUEUE = 64 };

struct gpiod_chip {
    int opened;
};
struct gpiod_chip_info {
    const char *label;
};
struct gpiod_line_settings {
    enum gpiod_line_direction direction;
    enum gpiod_line_edge edge;
    enum gpiod_line_bias bias;
    enum gpiod_line_clock clock;
};
struct gpiod_line_config {
    bool used[CHIP_SIM_LINES];
    struct gpiod_line_settings settings[CHIP_SIM_LINES];
    bool out_of_range;
};
struct gpiod_request_config {
    char consumer[32];
    size_t events;
};
struct gpiod_line_request {
    struct gpiod_line_config lines;
};
struct gpiod_edge_event {
    unsigned offset;
    bool rising;
    uint64_t t_ns;
    unsigned long seqno;
};
struct gpiod_edge_event_buffer {
    struct gpiod_edge_event *event; /* [capacity] */
    size_t capacity, count;
};

const char *const chip_sim_name[CHIP_SIM_LINES] = {"GPIO17", "GPIO27", "GPIO22", "GPIO23",
                                                   "",       "",       "",       ""};

static struct {
    bool plugged, denied, gone;
    bool busy[CHIP_SIM_LINES], high[CHIP_SIM_LINES];
    unsigned long seqno[CHIP_SIM_LINES];
    struct gpiod_line_request *request;
    struct gpiod_edge_event queue[QUEUE];
    size_t count;
} chip;

/* --- the test's side -------------------------------------------------------------------------- */

bool chip_sim_plug(void) {
    memset(&chip, 0, sizeof chip);
    chip.plugged = true;
    return true;
}

void chip_sim_remove(void) {
    chip.plugged = false;
}

void chip_sim_deny(bool deny) {
    chip.denied = deny;
}

void chip_sim_busy(unsigned offset) {
    chip.busy[offset] = true;
}

void chip_sim_level(unsigned offset, bool high) {
    chip.high[offset] = high;
}

void chip_sim_edge(unsigned offset, bool rising, int64_t t_ns) {
    chip.high[offset] = rising;
    if (!chip.request || !chip.request->lines.used[offset])
        return;
    enum gpiod_line_edge edge = chip.request->lines.settings[offset].edge;
    if (edge != GPIOD_LINE_EDGE_BOTH &&
        edge != (rising ? GPIOD_LINE_EDGE_RISING : GPIOD_LINE_EDGE_FALLING))
        return;
    chip.seqno[offset]++;
    if (chip.count < QUEUE)
        chip.queue[chip.count++] =
            (struct gpiod_edge_event){offset, rising, (uint64_t)t_ns, chip.seqno[offset]};
}

void chip_sim_unplug(void) {
    chip.gone = true;
}

bool chip_sim_lose(unsigned offset, unsigned count) {
    chip.seqno[offset] += count;
    return true;
}

/* --- libgpiod --------------------------------------------------------------------------------- */

bool gpiod_is_gpiochip_device(const char *path) {
    return chip.plugged && !strcmp(path, "/dev/gpiochip0");
}

struct gpiod_chip *gpiod_chip_open(const char *path) {
    (void)path;
    errno = EACCES;
    return chip.denied ? NULL : calloc(1, sizeof(struct gpiod_chip));
}

void gpiod_chip_close(struct gpiod_chip *c) {
    free(c);
}

struct gpiod_chip_info *gpiod_chip_get_info(struct gpiod_chip *c) {
    (void)c;
    struct gpiod_chip_info *info = calloc(1, sizeof *info);
    if (info)
        info->label = CHIP_SIM_LABEL;
    return info;
}

void gpiod_chip_info_free(struct gpiod_chip_info *info) {
    free(info);
}

const char *gpiod_chip_info_get_label(struct gpiod_chip_info *info) {
    return info->label;
}

size_t gpiod_chip_info_get_num_lines(struct gpiod_chip_info *info) {
    (void)info;
    return CHIP_SIM_LINES;
}

int gpiod_chip_get_line_offset_from_name(struct gpiod_chip *c, const char *name) {
    (void)c;
    for (int i = 0; i < CHIP_SIM_LINES; i++)
        if (*chip_sim_name[i] && !strcmp(chip_sim_name[i], name))
            return i;
    errno = ENOENT;
    return -1;
}

struct gpiod_line_request *gpiod_chip_request_lines(struct gpiod_chip *c,
                                                    struct gpiod_request_config *req_cfg,
                                                    struct gpiod_line_config *line_cfg) {
    (void)c;
    errno = line_cfg->out_of_range || !*req_cfg->consumer ? EINVAL : 0;
    for (int i = 0; i < CHIP_SIM_LINES; i++)
        if (line_cfg->used[i] && chip.busy[i])
            errno = EBUSY;
    struct gpiod_line_request *request = errno ? NULL : calloc(1, sizeof *request);
    if (request)
        request->lines = *line_cfg;
    chip.request = request;
    return request;
}

struct gpiod_line_settings *gpiod_line_settings_new(void) {
    return calloc(1, sizeof(struct gpiod_line_settings));
}

void gpiod_line_settings_free(struct gpiod_line_settings *settings) {
    free(settings);
}

int gpiod_line_settings_set_direction(struct gpiod_line_settings *settings,
                                      enum gpiod_line_direction direction) {
    settings->direction = direction;
    return 0;
}

int gpiod_line_settings_set_edge_detection(struct gpiod_line_settings *settings,
                                           enum gpiod_line_edge edge) {
    settings->edge = edge;
    return 0;
}

int gpiod_line_settings_set_bias(struct gpiod_line_settings *settings, enum gpiod_line_bias bias) {
    settings->bias = bias;
    return 0;
}

int gpiod_line_settings_set_event_clock(struct gpiod_line_settings *settings,
                                        enum gpiod_line_clock event_clock) {
    settings->clock = event_clock;
    return 0;
}

struct gpiod_line_config *gpiod_line_config_new(void) {
    return calloc(1, sizeof(struct gpiod_line_config));
}

void gpiod_line_config_free(struct gpiod_line_config *config) {
    free(config);
}

int gpiod_line_config_add_line_settings(struct gpiod_line_config *config,
                                        const unsigned int *offsets, size_t num_offsets,
                                        struct gpiod_line_settings *settings) {
    for (size_t i = 0; i < num_offsets; i++) {
        if (offsets[i] >= CHIP_SIM_LINES) { /* the real one finds out when lines are requested */
            config->out_of_range = true;
            continue;
        }
        config->used[offsets[i]] = true;
        config->settings[offsets[i]] = *settings;
    }
    return 0;
}

struct gpiod_request_config *gpiod_request_config_new(void) {
    return calloc(1, sizeof(struct gpiod_request_config));
}

void gpiod_request_config_free(struct gpiod_request_config *config) {
    free(config);
}

void gpiod_request_config_set_consumer(struct gpiod_request_config *config, const char *consumer) {
    strncpy(config->consumer, consumer, sizeof config->consumer - 1);
}

void gpiod_request_config_set_event_buffer_size(struct gpiod_request_config *config,
                                                size_t event_buffer_size) {
    config->events = event_buffer_size;
}

void gpiod_line_request_release(struct gpiod_line_request *request) {
    chip.request = NULL;
    free(request);
}

enum gpiod_line_value gpiod_line_request_get_value(struct gpiod_line_request *request,
                                                   unsigned int offset) {
    errno = ENODEV;
    if (chip.gone || !request->lines.used[offset] ||
        request->lines.settings[offset].direction != GPIOD_LINE_DIRECTION_INPUT)
        return GPIOD_LINE_VALUE_ERROR;
    return chip.high[offset] ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
}

int gpiod_line_request_wait_edge_events(struct gpiod_line_request *request, int64_t timeout_ns) {
    (void)request;
    (void)timeout_ns; /* nothing comes while the test waits */
    errno = ENODEV;
    return chip.gone ? -1 : chip.count > 0;
}

int gpiod_line_request_read_edge_events(struct gpiod_line_request *request,
                                        struct gpiod_edge_event_buffer *buffer, size_t max_events) {
    (void)request;
    size_t n = chip.count < max_events ? chip.count : max_events;
    n = n < buffer->capacity ? n : buffer->capacity;
    memcpy(buffer->event, chip.queue, n * sizeof *buffer->event);
    memmove(chip.queue, chip.queue + n, (chip.count - n) * sizeof *chip.queue);
    chip.count -= n;
    buffer->count = n;
    return (int)n;
}

struct gpiod_edge_event_buffer *gpiod_edge_event_buffer_new(size_t capacity) {
    struct gpiod_edge_event_buffer *buffer = calloc(1, sizeof *buffer);
    if (buffer)
        buffer->event = calloc(capacity, sizeof *buffer->event);
    if (buffer)
        buffer->capacity = capacity;
    return buffer;
}

void gpiod_edge_event_buffer_free(struct gpiod_edge_event_buffer *buffer) {
    free(buffer->event);
    free(buffer);
}

struct gpiod_edge_event *gpiod_edge_event_buffer_get_event(struct gpiod_edge_event_buffer *buffer,
                                                           unsigned long index) {
    return &buffer->event[index];
}

enum gpiod_edge_event_type gpiod_edge_event_get_event_type(struct gpiod_edge_event *event) {
    return event->rising ? GPIOD_EDGE_EVENT_RISING_EDGE : GPIOD_EDGE_EVENT_FALLING_EDGE;
}

uint64_t gpiod_edge_event_get_timestamp_ns(struct gpiod_edge_event *event) {
    return event->t_ns;
}

unsigned int gpiod_edge_event_get_line_offset(struct gpiod_edge_event *event) {
    return event->offset;
}

unsigned long gpiod_edge_event_get_line_seqno(struct gpiod_edge_event *event) {
    return event->seqno;
}
