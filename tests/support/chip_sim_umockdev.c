/* The chip below the real libgpiod 1.x: umockdev answers the ioctls of /dev/gpiochip0 and of the
 * lines' files. A line's file is a pipe with the events, put where umockdev knows a device, so that
 * poll and read see the pipe and ioctl the simulation. */
#define _GNU_SOURCE /* syscall */
#include "tests/support/chip_sim.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <umockdev.h>
#include <unistd.h>

const char *const chip_sim_name[CHIP_SIM_LINES] = {"GPIO17", "GPIO27", "GPIO22", "GPIO23",
                                                   "",       "",       "",       ""};

static struct {
    UMockdevTestbed *bed;
    UMockdevIoctlBase *handler;
    bool denied, gone;
    mode_t mode; /* of the chip's file */
    bool busy[CHIP_SIM_LINES], high[CHIP_SIM_LINES];
    int feed[CHIP_SIM_LINES];       /* our ends of the pipes */
    uint32_t edges[CHIP_SIM_LINES]; /* GPIOEVENT_REQUEST_... */
} chip;

/* A new file for a line that the program takes. */
static int line_event(struct gpioevent_request *r) {
    int ends[2], line = (int)r->lineoffset;
    char node[32];
    if (line >= CHIP_SIM_LINES)
        return EINVAL;
    if (chip.busy[line])
        return EBUSY;
    (void)snprintf(node, sizeof node, "/dev/gpioline%d", line);
    r->fd = open(node, O_RDWR);
    if (r->fd < 0 || pipe(ends))
        return EMFILE;
    (void)syscall(SYS_dup3, ends[0], r->fd, 0); /* not umockdev's own dup */
    (void)close(ends[0]);
    if (chip.feed[line] > 0)
        (void)close(chip.feed[line]);
    chip.feed[line] = ends[1];
    chip.edges[line] = r->eventflags;
    return 0;
}

static int line_info(struct gpioline_info *info) {
    if (info->line_offset >= CHIP_SIM_LINES)
        return EINVAL;
    info->flags = 0;
    memset(info->consumer, 0, sizeof info->consumer);
    (void)snprintf(info->name, sizeof info->name, "%s", chip_sim_name[info->line_offset]);
    return 0;
}

/* The program is this process: its memory is ours. */
static int answer(unsigned long request, const char *node, void *argument) {
    if (chip.gone)
        return ENODEV;
    if (request == GPIO_GET_CHIPINFO_IOCTL) {
        struct gpiochip_info info = {.name = "gpiochip0", .label = CHIP_SIM_LABEL, .lines = 8};
        memcpy(argument, &info, sizeof info);
        return 0;
    }
    if (request == GPIO_GET_LINEINFO_IOCTL)
        return line_info(argument);
    if (request == GPIO_GET_LINEEVENT_IOCTL)
        return line_event(argument);
    if (request == GPIOHANDLE_GET_LINE_VALUES_IOCTL) {
        struct gpiohandle_data *data = argument;
        data->values[0] = chip.high[node[strlen(node) - 1] - '0'];
        return 0;
    }
    return ENOTTY;
}

static gboolean on_ioctl(UMockdevIoctlBase *base, UMockdevIoctlClient *client, gpointer data) {
    (void)base;
    (void)data;
    void *argument;
    memcpy(&argument, umockdev_ioctl_client_get_arg(client)->data, sizeof argument);
    int error = answer(umockdev_ioctl_client_get_request(client),
                       umockdev_ioctl_client_get_devnode(client), argument);
    umockdev_ioctl_client_complete(client, error ? -1 : 0, error);
    return TRUE;
}

/* A character device with the handler; its file under /dev. */
static bool add_node(const char *name, const char *number) {
    char node[64], text[256];
    (void)snprintf(node, sizeof node, "/dev/%s", name);
    (void)snprintf(text, sizeof text,
                   "P: /devices/%s\nN: %s\nE: DEVNAME=%s\nE: SUBSYSTEM=gpio\nA: dev=%s\\n\n", name,
                   name, node, number);
    return umockdev_testbed_add_from_string(chip.bed, text, NULL) &&
           umockdev_testbed_attach_ioctl(chip.bed, node, chip.handler, NULL);
}

/* Where libgpiod looks whether a file is a chip. */
static void link_bus(void) {
    char path[512], *sys = umockdev_testbed_get_sys_dir(chip.bed);
    (void)snprintf(path, sizeof path, "%s/bus/gpio/devices", sys);
    (void)g_mkdir_with_parents(path, 0755);
    (void)snprintf(path, sizeof path, "%s/bus/gpio/devices/gpiochip0", sys);
    (void)symlink("../../../devices/gpiochip0", path); /* may be there already */
    g_free(sys);
}

bool chip_sim_plug(void) {
    memset(&chip, 0, sizeof chip);
    chip.bed = umockdev_testbed_new();
    chip.handler = umockdev_ioctl_base_new();
    g_signal_connect(chip.handler, "handle-ioctl", G_CALLBACK(on_ioctl), NULL);
    bool good = add_node("gpiochip0", "254:0");
    link_bus();
    for (int i = 0; i < CHIP_SIM_LINES && good; i++) {
        char name[16], number[8];
        (void)snprintf(name, sizeof name, "gpioline%d", i);
        (void)snprintf(number, sizeof number, "254:%d", i + 1);
        good = add_node(name, number);
    }
    return good;
}

void chip_sim_remove(void) {
    for (int i = 0; i < CHIP_SIM_LINES; i++)
        if (chip.feed[i] > 0)
            (void)close(chip.feed[i]);
    g_object_unref(chip.handler);
    g_object_unref(chip.bed);
}

void chip_sim_deny(bool deny) {
    if (deny == chip.denied)
        return;
    chip.denied = deny;
    char path[512], *root = umockdev_testbed_get_root_dir(chip.bed);
    (void)snprintf(path, sizeof path, "%s/dev/gpiochip0", root);
    if (!deny && !getuid())
        (void)!seteuid(0);
    (void)chmod(root, 0755);
    struct stat before;
    if (deny && !lstat(path, &before))
        chip.mode = before.st_mode & 07777; /* with the mark that makes it a device for umockdev */
    (void)chmod(path, deny ? chip.mode & ~0777u : chip.mode);
    if (deny && !getuid())
        (void)!seteuid(65534);
    g_free(root);
}

void chip_sim_busy(unsigned offset) {
    chip.busy[offset] = true;
}

void chip_sim_level(unsigned offset, bool high) {
    chip.high[offset] = high;
}

void chip_sim_edge(unsigned offset, bool rising, int64_t t_ns) {
    chip.high[offset] = rising;
    if (!(chip.edges[offset] & (rising ? (uint32_t)GPIOEVENT_REQUEST_RISING_EDGE
                                       : (uint32_t)GPIOEVENT_REQUEST_FALLING_EDGE)))
        return;
    struct gpioevent_data event = {.timestamp = (uint64_t)t_ns,
                                   .id = rising ? GPIOEVENT_EVENT_RISING_EDGE
                                                : GPIOEVENT_EVENT_FALLING_EDGE};
    (void)!write(chip.feed[offset], &event, sizeof event);
}

void chip_sim_unplug(void) {
    chip.gone = true;
    for (int i = 0; i < CHIP_SIM_LINES; i++) {
        if (chip.feed[i] > 0)
            (void)close(chip.feed[i]);
        chip.feed[i] = 0;
    }
}

bool chip_sim_lose(unsigned offset, unsigned count) {
    (void)offset;
    (void)count;
    return false;
}
