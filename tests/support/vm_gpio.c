/* A CP2112 USB-to-GPIO chip in user space, through uhid: the kernel's hid-cp2112 makes a real
 * /dev/gpiochip of it. Line 0 is the mirror index, 1 the e-stop, 2 the interlock chain (high:
 * closed). SIGUSR1 opens and closes the e-stop; ends with SIGTERM, which unplugs the chip. */
#include "base/clock.h"
#include "tests/support/vm_mirror.h"

#include <fcntl.h>
#include <linux/input.h>
#include <linux/uhid.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum {
    GPIO_CONFIG = 2,
    GPIO_GET = 3,
    GPIO_SET = 4,
    VERSION = 5,
    SMBUS_CONFIG = 6,
    LOCK_BYTE = 0x20
};

static volatile sig_atomic_t estop_open;

static void toggle_estop(int signal_number) {
    (void)signal_number;
    estop_open = !estop_open;
}

static const uint8_t descriptor[] = {
    0x06, 0x00, 0xff, 0x09, 0x01, 0xa1, 0x01,       /* vendor page, application collection */
    0x85, 0x03, 0x15, 0x00, 0x26, 0xff, 0x00,       /* report 3, values 0 to 255 */
    0x75, 0x08, 0x95, 0x3f, 0x09, 0x01, 0xb1, 0x02, /* 63 bytes, feature */
    0xc0};

static int create(int fd) {
    struct uhid_event e = {.type = UHID_CREATE2};
    struct uhid_create2_req *c = &e.u.create2;
    memcpy(c->name, "scancart test CP2112", 21);
    c->bus = BUS_USB;
    c->vendor = 0x10c4;
    c->product = 0xea90;
    c->rd_size = sizeof descriptor;
    memcpy(c->rd_data, descriptor, sizeof descriptor);
    return write(fd, &e, sizeof e) != (ssize_t)sizeof e;
}

static uint16_t answer(uint8_t report, uint8_t *out_data) {
    static const uint8_t config[5] = {GPIO_CONFIG, 0, 0, 0, 0};
    static const uint8_t version[3] = {VERSION, 0x0c, 3};
    static const uint8_t smbus[14] = {SMBUS_CONFIG, 0, 1, 0x86, 0xa0, 2, 0, 0, 0, 0, 0, 0, 0, 1};
    switch (report) {
    case GPIO_CONFIG:
        memcpy(out_data, config, sizeof config);
        return sizeof config;
    case GPIO_GET:
        out_data[0] = GPIO_GET;
        out_data[1] = (uint8_t)(vm_mirror_index(clock_now_ns()) | (estop_open ? 0 : 2) | 4);
        return 2;
    case VERSION:
        memcpy(out_data, version, sizeof version);
        return sizeof version;
    case SMBUS_CONFIG:
        memcpy(out_data, smbus, sizeof smbus);
        return sizeof smbus;
    case LOCK_BYTE:
        out_data[0] = LOCK_BYTE;
        out_data[1] = 0xff; /* nothing is locked */
        return 2;
    default:
        return 0;
    }
}

static int serve(int fd, const struct uhid_event *e) {
    struct uhid_event reply = {.type = UHID_GET_REPORT_REPLY};
    switch (e->type) {
    case UHID_GET_REPORT:
        reply.u.get_report_reply.id = e->u.get_report.id;
        reply.u.get_report_reply.size = answer(e->u.get_report.rnum, reply.u.get_report_reply.data);
        reply.u.get_report_reply.err = reply.u.get_report_reply.size ? 0 : 5;
        break;
    case UHID_SET_REPORT:
        reply.type = UHID_SET_REPORT_REPLY;
        reply.u.set_report_reply.id = e->u.set_report.id;
        break;
    default:
        return 0;
    }
    return write(fd, &reply, sizeof reply) != (ssize_t)sizeof reply;
}

int main(void) {
    struct sigaction on_usr1 = {.sa_handler = toggle_estop, .sa_flags = SA_RESTART};
    int fd = open("/dev/uhid", O_RDWR | O_CLOEXEC);
    if (fd < 0 || sigaction(SIGUSR1, &on_usr1, NULL) || create(fd)) {
        perror("/dev/uhid");
        return 1;
    }
    struct uhid_event e;
    while (read(fd, &e, sizeof e) > 0)
        if (serve(fd, &e))
            return 1;
    return 0;
}
