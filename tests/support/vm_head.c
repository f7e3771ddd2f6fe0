/* A rangefinder head as a USB gadget: FunctionFS with one bulk endpoint that sends head packets.
 * Usage: vm_head FOLDER SAMPLES_HZ [VERSION]
 *   FOLDER: where FunctionFS is mounted; VERSION: of the packets (1)
 * Prints "ready" when the descriptors are written; ends when the gadget is taken away. */
#define _DEFAULT_SOURCE /* htole32 */
#include "base/clock.h"
#include "base/head_packet.h"
#include "tests/support/vm_mirror.h"

#include <endian.h>
#include <fcntl.h>
#include <linux/usb/functionfs.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { PACKETS_AT_ONCE = 32, TICK_NS = 4000000, LATE_NS = 200000000 };

struct speed {
    struct usb_interface_descriptor interface;
    struct usb_endpoint_descriptor_no_audio endpoint;
} __attribute__((packed));

static struct speed speed_of(uint16_t packet_bytes) {
    struct speed s = {.interface = {.bLength = sizeof s.interface,
                                    .bDescriptorType = USB_DT_INTERFACE,
                                    .bNumEndpoints = 1,
                                    .bInterfaceClass = USB_CLASS_VENDOR_SPEC,
                                    .iInterface = 1},
                      .endpoint = {.bLength = sizeof s.endpoint,
                                   .bDescriptorType = USB_DT_ENDPOINT,
                                   .bEndpointAddress = 1 | USB_DIR_IN,
                                   .bmAttributes = USB_ENDPOINT_XFER_BULK,
                                   .wMaxPacketSize = htole16(packet_bytes)}};
    return s;
}

static int describe(int ep0) {
    struct {
        struct usb_functionfs_descs_head_v2 head;
        __le32 full_count, high_count;
        struct speed full, high;
    } __attribute__((packed))
    descriptors = {.head = {.magic = htole32(FUNCTIONFS_DESCRIPTORS_MAGIC_V2),
                            .length = htole32(sizeof descriptors),
                            .flags = htole32(FUNCTIONFS_HAS_FS_DESC | FUNCTIONFS_HAS_HS_DESC)},
                   .full_count = htole32(2),
                   .high_count = htole32(2),
                   .full = speed_of(64),
                   .high = speed_of(512)};
    static const char name[] = "samples";
    struct {
        struct usb_functionfs_strings_head head;
        __le16 language;
        char text[sizeof name];
    } __attribute__((packed)) strings = {.head = {.magic = htole32(FUNCTIONFS_STRINGS_MAGIC),
                                                  .length = htole32(sizeof strings),
                                                  .str_count = htole32(1),
                                                  .lang_count = htole32(1)},
                                         .language = htole16(0x0409)};
    memcpy(strings.text, name, sizeof name);
    return write(ep0, &descriptors, sizeof descriptors) != (ssize_t)sizeof descriptors ||
           write(ep0, &strings, sizeof strings) != (ssize_t)sizeof strings;
}

/* The next packet; times are head time, 12 s ahead of the machine's. */
static size_t make_packet(uint64_t first, int64_t t_ns, uint32_t interval_ns, uint32_t packet_seq,
                          uint8_t *out_bytes) {
    struct head_packet p = {.packet_seq = packet_seq,
                            .first_sample_seq = (uint32_t)first,
                            .head_t_ns = t_ns + 12000000000,
                            .interval_ns = interval_ns,
                            .status = HEAD_STATUS_LASER_ON | HEAD_STATUS_MIRROR_LOCKED,
                            .flags = packet_seq ? 0 : HEAD_PACKET_RESET,
                            .sample_count = HEAD_PACKET_MAX_SAMPLES};
    for (unsigned i = 0; i < HEAD_PACKET_MAX_SAMPLES; i++) {
        int64_t at_ns = t_ns + (int64_t)i * interval_ns;
        bool wrapped = at_ns % VM_MIRROR_TURN_NS < (int64_t)interval_ns;
        p.samples[i] = (struct head_sample){
            .position = head_position_from_counts(vm_mirror_counts(at_ns)),
            .range = head_range_from_m(4 + sin(vm_mirror_counts(at_ns) * 0.003)),
            .intensity = 20000,
            .ambient = 300,
            .flags = wrapped ? HEAD_SAMPLE_INDEX : 0};
    }
    size_t size = 0;
    return head_packet_encode(&p, out_bytes, &size) ? 0 : size;
}

static void stream(int ep1, uint32_t interval_ns, uint8_t version) {
    static uint8_t bytes[PACKETS_AT_ONCE * HEAD_PACKET_MAX_BYTES];
    uint64_t sample = 0;
    uint32_t packet = 0;
    int64_t start_ns = clock_now_ns();
    for (;;) {
        size_t size = 0;
        int64_t now_ns = clock_now_ns();
        int64_t due_ns = start_ns + (int64_t)(sample * interval_ns);
        if (now_ns - due_ns > LATE_NS) /* nobody read: it goes on from here */
            start_ns += now_ns - due_ns;
        for (int i = 0; i < PACKETS_AT_ONCE; i++) {
            int64_t t_ns = start_ns + (int64_t)(sample * interval_ns);
            if (t_ns + (int64_t)HEAD_PACKET_MAX_SAMPLES * interval_ns > now_ns)
                break;
            size += make_packet(sample, t_ns, interval_ns, packet++, bytes + size);
            bytes[size - HEAD_PACKET_MAX_BYTES + 4] =
                version; /* other versions: CRC is wrong too */
            sample += HEAD_PACKET_MAX_SAMPLES;
        }
        if (size && write(ep1, bytes, size) < 0)
            return;
        struct timespec tick = {0, size == sizeof bytes ? 0 : TICK_NS};
        (void)nanosleep(&tick, NULL);
    }
}

int main(int argc, char **argv) {
    char path[256];
    double rate_hz = argc > 2 ? strtod(argv[2], NULL) : 0;
    if (!(rate_hz >= 100)) {
        (void)fprintf(stderr, "usage: vm_head FOLDER SAMPLES_HZ [VERSION]\n");
        return 2;
    }
    (void)snprintf(path, sizeof path, "%s/ep0", argv[1]);
    int ep0 = open(path, O_RDWR);
    if (ep0 < 0 || describe(ep0)) {
        perror(path);
        return 1;
    }
    (void)snprintf(path, sizeof path, "%s/ep1", argv[1]);
    int ep1 = open(path, O_WRONLY);
    if (ep1 < 0) {
        perror(path);
        return 1;
    }
    (void)printf("ready\n");
    (void)fflush(stdout);
    stream(ep1, (uint32_t)llround(1e9 / rate_hz),
           (uint8_t)(argc > 3 ? strtoul(argv[3], NULL, 10) : HEAD_PACKET_VERSION));
    return 0;
}
