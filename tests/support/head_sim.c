#include "tests/support/head_sim.h"

#include <errno.h>
#include <linux/usb/ch9.h>
#include <linux/usbdevice_fs.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <umockdev.h>
#include <unistd.h>

enum { URBS = 128, DEVICES = 4, NODE = 64 };

static struct {
    UMockdevTestbed *bed;
    UMockdevIoctlBase *handler;
    struct head_sim_device device[DEVICES];
    unsigned devices;
    mode_t mode;
    bool denied;
    /* guarded by the lock */
    pthread_mutex_t lock;
    struct usbdevfs_urb *urb[URBS]; /* submitted, in order */
    bool done[URBS];                /* has its result already */
    unsigned count, most, cleared, fail_count;
    int fail_error;
    bool busy, unplugged, halted;
    const uint8_t *bytes;
    size_t size;
    size_t (*more)(void *ctx, uint8_t *out_bytes, size_t capacity);
    void *more_ctx;
} usb = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* --- the device ------------------------------------------------------------------------------- */

/* Text as a string descriptor. */
static int string_descriptor(const char *text, uint8_t *out, int capacity) {
    int n = 2 + 2 * (int)strlen(text);
    uint8_t all[256] = {(uint8_t)n, USB_DT_STRING};
    for (int i = 0; text[i]; i++)
        all[2 + 2 * i] = (uint8_t)text[i];
    n = n < capacity ? n : capacity;
    memcpy(out, all, (size_t)n);
    return n;
}

static void control(struct usbdevfs_urb *urb, unsigned device) {
    uint8_t *setup = urb->buffer, *data = setup + 8;
    int room = urb->buffer_length - 8;
    const uint8_t languages[4] = {4, USB_DT_STRING, 0x09, 0x04};
    urb->status = 0;
    if (setup[1] != USB_REQ_GET_DESCRIPTOR || setup[3] != USB_DT_STRING) {
        urb->status = -EPIPE;
        urb->actual_length = 0;
    } else if (setup[2] == 0) {
        urb->actual_length = room < 4 ? room : 4;
        memcpy(data, languages, (size_t)urb->actual_length);
    } else {
        urb->actual_length = string_descriptor(
            setup[2] == 1 ? "simulated head" : usb.device[device].serial, data, room);
    }
}

static int submit(struct usbdevfs_urb *urb, unsigned device) {
    if (usb.count == URBS)
        return ENOMEM;
    usb.done[usb.count] = urb->type == USBDEVFS_URB_TYPE_CONTROL;
    if (usb.done[usb.count])
        control(urb, device);
    usb.urb[usb.count++] = urb;
    usb.most = usb.count > usb.most ? usb.count : usb.most;
    return 0;
}

/* Gives the transfer its result, if there is one now. */
static bool fill(struct usbdevfs_urb *urb) {
    urb->actual_length = 0;
    if (usb.halted)
        return false;
    if (usb.fail_count) {
        usb.fail_count--;
        urb->status = -usb.fail_error;
        usb.halted = usb.fail_error == EPIPE;
        return true;
    }
    size_t n = (size_t)urb->buffer_length;
    if (usb.size) {
        n = n < usb.size ? n : usb.size;
        memcpy(urb->buffer, usb.bytes, n);
        usb.bytes += n;
        usb.size -= n;
    } else {
        n = usb.more ? usb.more(usb.more_ctx, urb->buffer, n) : 0;
    }
    urb->actual_length = (int)n;
    urb->status = 0;
    return n > 0;
}

static int reap(void *out_urb) {
    unsigned i = 0;
    while (i < usb.count && !usb.done[i])
        i++;
    if (i == usb.count) {
        if (!usb.count || !fill(usb.urb[0]))
            return usb.unplugged ? ENODEV : EAGAIN;
        i = 0;
    }
    memcpy(out_urb, &usb.urb[i], sizeof usb.urb[i]);
    usb.count--;
    memmove(usb.urb + i, usb.urb + i + 1, (usb.count - i) * sizeof usb.urb[0]);
    memmove(usb.done + i, usb.done + i + 1, (usb.count - i) * sizeof usb.done[0]);
    return 0;
}

static int discard(const void *urb) {
    for (unsigned i = 0; i < usb.count; i++)
        if (usb.urb[i] == urb && !usb.done[i]) {
            usb.done[i] = true;
            usb.urb[i]->status = -ENOENT;
            usb.urb[i]->actual_length = 0;
            return 0;
        }
    return EINVAL;
}

static int answer(unsigned long request, void *argument, unsigned device) {
    uint32_t caps = USBDEVFS_CAP_BULK_CONTINUATION | USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                    USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
    switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
        memcpy(argument, &caps, sizeof caps);
        return 0;
    case USBDEVFS_REAPURBNDELAY:
        return reap(argument);
    case USBDEVFS_DISCARDURB:
        return discard(argument);
    case USBDEVFS_SUBMITURB:
        return usb.unplugged && !usb.size ? ENODEV : submit(argument, device);
    case USBDEVFS_CLAIMINTERFACE:
        return usb.busy ? EBUSY : 0;
    case USBDEVFS_CLEAR_HALT:
        usb.halted = false;
        usb.cleared++;
        return 0;
    case USBDEVFS_RELEASEINTERFACE:
        return 0;
    default:
        return ENOTTY;
    }
}

static gboolean on_ioctl(UMockdevIoctlBase *base, UMockdevIoctlClient *client, gpointer data) {
    (void)base;
    (void)data;
    const char *node = umockdev_ioctl_client_get_devnode(client);
    void *argument; /* the program is this process: its memory is ours */
    memcpy(&argument, umockdev_ioctl_client_get_arg(client)->data, sizeof argument);
    (void)pthread_mutex_lock(&usb.lock);
    int error = answer(umockdev_ioctl_client_get_request(client), argument,
                       (unsigned)(node[strlen(node) - 1] - '2') % DEVICES);
    (void)pthread_mutex_unlock(&usb.lock);
    umockdev_ioctl_client_complete(client, error ? -1 : 0, error);
    return TRUE;
}

/* --- the bus ---------------------------------------------------------------------------------- */

/* Device, configuration, vendor interface and bulk endpoint, as sysfs has them, in hexadecimal. */
static void descriptors(const struct head_sim_device *d, char out_hex[128]) {
    const uint8_t all[43] = {18,
                             1,
                             0,
                             2,
                             0,
                             0,
                             0,
                             64,
                             (uint8_t)d->vendor,
                             (uint8_t)(d->vendor >> 8),
                             (uint8_t)d->product,
                             (uint8_t)(d->product >> 8),
                             (uint8_t)d->version,
                             (uint8_t)(d->version >> 8),
                             0,
                             1,
                             2,
                             1,
                             /* configuration */ 9,
                             2,
                             25,
                             0,
                             1,
                             1,
                             0,
                             0x80,
                             50,
                             /* interface */ 9,
                             4,
                             0,
                             0,
                             1,
                             0xff,
                             0,
                             0,
                             0,
                             /* endpoint */ 7,
                             5,
                             0x81,
                             2,
                             0,
                             2,
                             0};
    for (unsigned i = 0; i < sizeof all; i++)
        (void)snprintf(out_hex + 2 * i, 3, "%02X", all[i]);
}

static bool add_device(unsigned n) {
    char text[1024], hex[128], node[NODE];
    descriptors(&usb.device[n], hex);
    (void)snprintf(node, sizeof node, "/dev/bus/usb/001/%03u", n + 2);
    (void)snprintf(text, sizeof text,
                   "P: /devices/usb1/1-%u\nN: bus/usb/001/%03u\nE: DEVNAME=%s\n"
                   "E: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: BUSNUM=001\nE: DEVNUM=%03u\n"
                   "A: busnum=1\\n\nA: devnum=%u\\n\nA: speed=480\\n\nA: bConfigurationValue=1\\n\n"
                   "A: dev=189:%u\\n\nH: descriptors=%s\n\n",
                   n + 1, n + 2, node, n + 2, n + 2, n + 1, hex);
    GError *error = NULL;
    bool good = umockdev_testbed_add_from_string(usb.bed, text, &error) &&
                umockdev_testbed_attach_ioctl(usb.bed, node, usb.handler, &error);
    if (error)
        (void)fprintf(stderr, "umockdev: %s\n", error->message);
    g_clear_error(&error);
    return good;
}

bool head_sim_plug(const struct head_sim_device *devices, unsigned count) {
    usb.bed = umockdev_testbed_new();
    usb.handler = umockdev_ioctl_base_new();
    g_signal_connect(usb.handler, "handle-ioctl", G_CALLBACK(on_ioctl), NULL);
    usb.count = usb.most = usb.cleared = usb.fail_count = 0;
    usb.busy = usb.unplugged = usb.halted = usb.denied = false;
    usb.bytes = NULL;
    usb.size = 0;
    usb.more = NULL;
    usb.devices = count;
    bool good = count <= DEVICES;
    for (unsigned i = 0; i < count && good; i++) {
        usb.device[i] = devices[i];
        good = add_device(i);
    }
    return good;
}

void head_sim_remove(void) {
    head_sim_deny(false);
    g_object_unref(usb.handler);
    g_object_unref(usb.bed);
}

void head_sim_send(const uint8_t *bytes, size_t size) {
    (void)pthread_mutex_lock(&usb.lock);
    usb.bytes = bytes;
    usb.size = size;
    (void)pthread_mutex_unlock(&usb.lock);
}

void head_sim_source(size_t (*more)(void *ctx, uint8_t *out_bytes, size_t capacity), void *ctx) {
    (void)pthread_mutex_lock(&usb.lock);
    usb.more = more;
    usb.more_ctx = ctx;
    (void)pthread_mutex_unlock(&usb.lock);
}

void head_sim_fail(int error, unsigned count) {
    (void)pthread_mutex_lock(&usb.lock);
    usb.fail_error = error;
    usb.fail_count = count;
    (void)pthread_mutex_unlock(&usb.lock);
}

/* Another user, too, must get at umockdev's own socket. */
static void allow_simulation(const char *root) {
    static const char *const way[] = {"",
                                      "/ioctl",
                                      "/ioctl/dev",
                                      "/ioctl/dev/bus",
                                      "/ioctl/dev/bus/usb",
                                      "/ioctl/dev/bus/usb/001",
                                      "/ioctl/dev/bus/usb/001/002"};
    for (unsigned i = 0; i < sizeof way / sizeof way[0]; i++) {
        char path[512];
        (void)snprintf(path, sizeof path, "%s%s", root, way[i]);
        (void)chmod(path, 0777);
    }
}

void head_sim_deny(bool deny) {
    if (deny == usb.denied)
        return;
    usb.denied = deny;
    char path[512], *root = umockdev_testbed_get_root_dir(usb.bed);
    (void)snprintf(path, sizeof path, "%s/dev/bus/usb/001/002", root);
    if (!deny && !getuid())
        (void)!seteuid(0);
    allow_simulation(root);
    struct stat before;
    if (deny && !lstat(path, &before))
        usb.mode = before.st_mode & 07777; /* with the mark that makes it a device for umockdev */
    (void)chmod(path, deny ? usb.mode & ~0777u : usb.mode);
    if (deny && !getuid())
        (void)!seteuid(65534);
    g_free(root);
}

void head_sim_busy(void) {
    usb.busy = true;
}

void head_sim_unplug(void) {
    (void)pthread_mutex_lock(&usb.lock);
    usb.unplugged = true;
    (void)pthread_mutex_unlock(&usb.lock);
}

unsigned head_sim_halts_cleared(void) {
    (void)pthread_mutex_lock(&usb.lock);
    unsigned n = usb.cleared;
    (void)pthread_mutex_unlock(&usb.lock);
    return n;
}

unsigned head_sim_most_in_flight(void) {
    (void)pthread_mutex_lock(&usb.lock);
    unsigned n = usb.most;
    (void)pthread_mutex_unlock(&usb.lock);
    return n;
}
