#include "capture/backends/head_usb.h"

#include "base/clock.h"
#include "base/head_packet.h"

#include <libusb-1.0/libusb.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>

enum {
    ENDPOINT = 0x81,
    FIRST_BYTES = 2048,   /* of a transfer before the rate is known */
    SHORT_NS = 5000000,   /* a full transfer in less: the next may be larger */
    LONG_NS = 40000000,   /* in more: smaller */
    ERRORS_IN_A_ROW = 16, /* failed transfers without a byte between them: give up */
    STOP_MS = 900,        /* for transfers that were cancelled to come back */
    STALE_READS = 8,      /* transfers at most that are thrown away at the start */
    STALE_MS = 2,
    VERSION_UNKNOWN = 0xff /* no packet seen yet */
};

struct head_usb {
    struct head head;
    /* constant after open */
    struct head_usb_config config;
    struct head_identity identity;
    libusb_context *context;
    libusb_device_handle *device;
    int interface;
    bool claimed;
    unsigned packet_bytes; /* of the endpoint; transfers are multiples of it */
    /* the thread that pumps */
    const struct head_sink *sink; /* within pump and stop, else NULL */
    struct libusb_transfer *transfer[HEAD_USB_TRANSFERS_MAX];
    uint8_t *memory; /* [transfers][transfer_bytes] */
    unsigned in_flight;
    unsigned length;       /* of the next transfer */
    unsigned error_row;    /* failed transfers since the last byte */
    int64_t last_full_ns;  /* when the last full transfer came; 0: none yet */
    unsigned seen_version; /* of the packets */
    bool running, stopping, gone, stalled, abandoned;
    struct head_stats stats;
};

struct head_usb_config head_usb_default(void) {
    return (struct head_usb_config){
        .vendor = 0x1209, .product = 0x5c41, .transfers = 8, .transfer_bytes = 16384};
}

static struct head_usb *of(struct head *head) {
    return (struct head_usb *)head;
}

/* --- finding and opening ---------------------------------------------------------------------- */

static enum st translate(const struct head_usb *h, int code, const char *doing,
                         struct errctx *err) {
    unsigned v = h->config.vendor, p = h->config.product;
    switch (code) {
    case LIBUSB_ERROR_ACCESS:
        return errctx_set(err, ST_PERMISSION,
                          "not allowed to open the head (USB %04x:%04x): install the udev rules of "
                          "the board's folder (boards/rpi5/70-scancart.rules) and add yourself to "
                          "the group scancart",
                          v, p);
    case LIBUSB_ERROR_NO_DEVICE:
    case LIBUSB_ERROR_NOT_FOUND:
        return errctx_set(err, ST_DEVICE,
                          "the head (USB %04x:%04x) is gone while %s: has it been unplugged?", v, p,
                          doing);
    case LIBUSB_ERROR_BUSY:
        return errctx_set(err, ST_BUSY, "the head (USB %04x:%04x) is in use by another program", v,
                          p);
    case LIBUSB_ERROR_NO_MEM:
        return errctx_set(err, ST_NOMEM, "no memory for the head's transfers");
    default:
        return errctx_set(err, ST_DEVICE, "the head (USB %04x:%04x) failed while %s: %s", v, p,
                          doing, libusb_error_name(code));
    }
}

static void read_text(libusb_device_handle *device, uint8_t index, char out_text[64]) {
    int n = index ? libusb_get_string_descriptor_ascii(device, index, (unsigned char *)out_text, 63)
                  : 0;
    out_text[n > 0 ? n : 0] = 0;
}

/* Opens `device` if it is the one; ST_OK without a handle if it is another. */
static enum st try_device(struct head_usb *h, libusb_device *device, struct errctx *err) {
    struct libusb_device_descriptor d;
    libusb_device_handle *handle = NULL;
    if (libusb_get_device_descriptor(device, &d) || d.idVendor != h->config.vendor ||
        d.idProduct != h->config.product)
        return ST_OK;
    int code = libusb_open(device, &handle);
    if (code)
        return translate(h, code, "opening", err);
    struct head_identity id = {.protocol_version = d.bcdDevice >> 8};
    read_text(handle, d.iProduct, id.product);
    read_text(handle, d.iSerialNumber, id.serial);
    if (h->config.serial && strcmp(h->config.serial, id.serial)) {
        libusb_close(handle);
        return ST_OK;
    }
    if (h->device) {
        enum st st = errctx_set(err, ST_INVALID,
                                "two heads are plugged in ('%s' and '%s'): name the serial number "
                                "in the board file (head.serial)",
                                h->identity.serial, id.serial);
        libusb_close(handle);
        return st;
    }
    h->device = handle;
    h->identity = id;
    return ST_OK;
}

static enum st find_device(struct head_usb *h, struct errctx *err) {
    libusb_device **list = NULL;
    ssize_t count = libusb_get_device_list(h->context, &list);
    if (count < 0)
        return translate(h, (int)count, "looking for it", err);
    enum st st = ST_OK, denied = ST_OK;
    for (ssize_t i = 0; i < count && !st; i++) {
        st = try_device(h, list[i], err);
        if (st == ST_PERMISSION) { /* perhaps another one is the right one */
            denied = st;
            st = ST_OK;
        }
    }
    libusb_free_device_list(list, 1);
    if (st || h->device)
        return st;
    if (denied)
        return denied;
    return errctx_set(err, ST_NOT_FOUND,
                      "no head (USB %04x:%04x%s%s) is plugged in: is it powered, does `lsusb` show "
                      "it?",
                      h->config.vendor, h->config.product, h->config.serial ? ", serial " : "",
                      h->config.serial ? h->config.serial : "");
}

/* The vendor interface with the bulk endpoint, and the version of the protocol. */
static enum st check_descriptors(struct head_usb *h, struct errctx *err) {
    if (h->identity.protocol_version != HEAD_PACKET_VERSION)
        return errctx_set(err, ST_UNSUPPORTED,
                          "head '%s' speaks version %u of the protocol, this program knows %d: "
                          "update the program or the head",
                          h->identity.serial, h->identity.protocol_version, HEAD_PACKET_VERSION);
    struct libusb_config_descriptor *config = NULL;
    int code = libusb_get_active_config_descriptor(libusb_get_device(h->device), &config);
    if (code)
        return translate(h, code, "reading its descriptors", err);
    h->interface = -1;
    for (int i = 0; i < config->bNumInterfaces && h->interface < 0; i++) {
        const struct libusb_interface_descriptor *alt = config->interface[i].altsetting;
        for (int e = 0; config->interface[i].num_altsetting > 0 && e < alt->bNumEndpoints; e++) {
            const struct libusb_endpoint_descriptor *endpoint = &alt->endpoint[e];
            if (alt->bInterfaceClass == LIBUSB_CLASS_VENDOR_SPEC &&
                endpoint->bEndpointAddress == ENDPOINT &&
                (endpoint->bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) == LIBUSB_TRANSFER_TYPE_BULK) {
                h->interface = alt->bInterfaceNumber;
                h->packet_bytes = endpoint->wMaxPacketSize & 0x7ffu;
            }
        }
    }
    libusb_free_config_descriptor(config);
    if (h->interface < 0 || !h->packet_bytes || h->packet_bytes > h->config.transfer_bytes)
        return errctx_set(err, ST_UNSUPPORTED,
                          "USB device %04x:%04x has no vendor interface with bulk endpoint %02x: "
                          "it is no rangefinder head",
                          h->config.vendor, h->config.product, ENDPOINT);
    return ST_OK;
}

static enum st connect_device(struct head_usb *h, struct errctx *err) {
    int code = libusb_init(&h->context);
    if (code) {
        h->context = NULL;
        return errctx_set(err, ST_DEVICE, "libusb does not start (%s): is there a USB controller?",
                          libusb_error_name(code));
    }
    enum st st = find_device(h, err);
    if (!st)
        st = check_descriptors(h, err);
    if (st)
        return st;
    code = libusb_claim_interface(h->device, h->interface);
    if (code)
        return translate(h, code, "taking its interface", err);
    h->claimed = true;
    return ST_OK;
}

/* --- transfers -------------------------------------------------------------------------------- */

static unsigned whole_packets(const struct head_usb *h, unsigned bytes) {
    unsigned whole = bytes / h->packet_bytes * h->packet_bytes;
    return whole ? whole : h->packet_bytes;
}

/* Transfers that fill quickly may be larger: fewer of them; slow ones smaller: data come sooner. */
static void adapt_length(struct head_usb *h, int64_t now_ns) {
    int64_t took_ns = now_ns - h->last_full_ns;
    if (h->last_full_ns && took_ns < SHORT_NS && h->length < h->config.transfer_bytes)
        h->length = whole_packets(
            h, h->length * 2 < h->config.transfer_bytes ? h->length * 2 : h->config.transfer_bytes);
    else if (h->last_full_ns && took_ns > LONG_NS)
        h->length = whole_packets(h, h->length / 2);
    h->last_full_ns = now_ns;
}

static void submit(struct head_usb *h, struct libusb_transfer *transfer) {
    transfer->length = (int)h->length;
    int code = libusb_submit_transfer(transfer);
    if (!code) {
        h->in_flight++;
    } else if (code == LIBUSB_ERROR_NO_DEVICE) {
        h->gone = true;
    } else {
        h->stats.transfer_errors++;
        h->error_row = ERRORS_IN_A_ROW;
    }
}

/* Looks at the packets' header until one was understood. */
static void look_at_version(struct head_usb *h, const uint8_t *bytes, size_t size) {
    static const uint8_t magic[4] = {'S', 'C', 'H', 'P'};
    if (h->seen_version == HEAD_PACKET_VERSION || size < HEAD_PACKET_HEADER_BYTES ||
        memcmp(bytes, magic, sizeof magic))
        return;
    h->seen_version = bytes[4];
    if (h->seen_version == HEAD_PACKET_VERSION)
        h->identity.interval_ns = (uint32_t)bytes[24] | (uint32_t)bytes[25] << 8 |
                                  (uint32_t)bytes[26] << 16 | (uint32_t)bytes[27] << 24;
}

static void hand_over(struct head_usb *h, const struct libusb_transfer *transfer, int64_t now_ns) {
    size_t size = (size_t)transfer->actual_length;
    if (!size)
        return;
    h->error_row = 0;
    h->stats.bytes += size;
    look_at_version(h, transfer->buffer, size);
    if (h->sink)
        h->sink->bytes(h->sink->ctx, transfer->buffer, size, now_ns);
}

static void LIBUSB_CALL completed(struct libusb_transfer *transfer) {
    struct head_usb *h = transfer->user_data;
    int64_t now_ns = clock_now_ns();
    h->in_flight--;
    h->stats.transfers++;
    hand_over(h, transfer, now_ns);
    switch (transfer->status) {
    case LIBUSB_TRANSFER_COMPLETED:
        if (transfer->actual_length == transfer->length)
            adapt_length(h, now_ns);
        break;
    case LIBUSB_TRANSFER_NO_DEVICE:
        h->gone = true;
        break;
    case LIBUSB_TRANSFER_STALL:
        h->stalled = true;
        h->error_row++;
        h->stats.transfer_errors++;
        break;
    case LIBUSB_TRANSFER_ERROR:
    case LIBUSB_TRANSFER_OVERFLOW:
        h->error_row++;
        h->stats.transfer_errors++;
        break;
    case LIBUSB_TRANSFER_CANCELLED:
    case LIBUSB_TRANSFER_TIMED_OUT:
        break;
    }
    if (!h->stopping && !h->gone && !h->stalled && h->error_row < ERRORS_IN_A_ROW)
        submit(h, transfer);
}

/* Lets libusb work for at most timeout_ms; false if it fails. */
static bool handle_events(struct head_usb *h, unsigned timeout_ms) {
    struct timeval limit = {timeout_ms / 1000, timeout_ms % 1000 * 1000};
    int code = libusb_handle_events_timeout_completed(h->context, &limit, NULL);
    return !code || code == LIBUSB_ERROR_INTERRUPTED || code == LIBUSB_ERROR_TIMEOUT;
}

/* Cancels what is under way and waits for it to come back, at most STOP_MS. */
static bool recall_all(struct head_usb *h) {
    h->stopping = true;
    /* the last one first: a cancelled transfer must not make room for a younger one */
    for (unsigned i = h->config.transfers; i-- > 0;)
        if (h->transfer[i])
            (void)libusb_cancel_transfer(h->transfer[i]); /* not under way: nothing to do */
    int64_t end_ns = clock_now_ns() + (int64_t)STOP_MS * 1000000;
    while (h->in_flight && clock_now_ns() < end_ns)
        if (!handle_events(h, 20))
            break;
    h->stopping = false;
    return !h->in_flight;
}

static void submit_all(struct head_usb *h) {
    for (unsigned i = 0; i < h->config.transfers && !h->gone; i++)
        submit(h, h->transfer[i]);
}

/* A stalled endpoint holds still until the halt is cleared; nothing may be under way then. */
static void clear_stall(struct head_usb *h) {
    h->abandoned = !recall_all(h);
    h->stalled = false;
    if (h->abandoned || h->gone)
        return;
    int code = libusb_clear_halt(h->device, ENDPOINT);
    if (code == LIBUSB_ERROR_NO_DEVICE)
        h->gone = true;
    else if (h->error_row < ERRORS_IN_A_ROW)
        submit_all(h);
}

static enum st state_of(const struct head_usb *h, struct errctx *err) {
    if (h->gone)
        return translate(h, LIBUSB_ERROR_NO_DEVICE, "reading", err);
    if (h->seen_version != VERSION_UNKNOWN && h->seen_version != HEAD_PACKET_VERSION)
        return errctx_set(err, ST_UNSUPPORTED,
                          "head '%s' sends packets of version %u, this program knows %d: update "
                          "the program or the head",
                          h->identity.serial, h->seen_version, HEAD_PACKET_VERSION);
    if (h->error_row >= ERRORS_IN_A_ROW || h->abandoned)
        return errctx_set(err, ST_DEVICE,
                          "%u transfers from the head failed in a row: check its cable and power",
                          h->error_row);
    return ST_OK;
}

/* --- ops -------------------------------------------------------------------------------------- */

static enum st usb_identify(struct head *head, struct head_identity *out_identity,
                            struct errctx *err) {
    (void)err;
    *out_identity = of(head)->identity;
    return ST_OK;
}

static enum st make_transfers(struct head_usb *h, struct errctx *err) {
    if (h->memory)
        return ST_OK;
    h->memory = calloc(h->config.transfers, h->config.transfer_bytes);
    for (unsigned i = 0; h->memory && i < h->config.transfers; i++) {
        h->transfer[i] = libusb_alloc_transfer(0);
        if (!h->transfer[i])
            return errctx_set(err, ST_NOMEM, "no memory for the head's transfers");
        libusb_fill_bulk_transfer(h->transfer[i], h->device, ENDPOINT,
                                  h->memory + (size_t)i * h->config.transfer_bytes,
                                  (int)h->config.transfer_bytes, completed, h, 0);
    }
    return h->memory ? ST_OK : errctx_set(err, ST_NOMEM, "no memory for the head's transfers");
}

static enum st usb_start(struct head *head, struct errctx *err) {
    struct head_usb *h = of(head);
    if (h->running)
        return errctx_set(err, ST_INVALID, "the head runs already");
    enum st st = make_transfers(h, err);
    if (st)
        return st;
    for (int i = 0, got = 1; i < STALE_READS && got; i++) { /* what it kept from before */
        int code = libusb_bulk_transfer(h->device, ENDPOINT, h->memory, (int)h->packet_bytes, &got,
                                        STALE_MS);
        if (code == LIBUSB_ERROR_NO_DEVICE)
            return translate(h, code, "starting", err);
        if (code == LIBUSB_ERROR_PIPE)
            (void)libusb_clear_halt(h->device, ENDPOINT);
    }
    h->length = whole_packets(h, FIRST_BYTES);
    h->error_row = 0;
    h->last_full_ns = 0;
    h->seen_version = VERSION_UNKNOWN;
    submit_all(h);
    st = state_of(h, err);
    h->running = !st;
    if (st)
        h->abandoned = !recall_all(h);
    return st;
}

static enum st usb_pump(struct head *head, unsigned timeout_ms, const struct head_sink *sink,
                        struct errctx *err) {
    struct head_usb *h = of(head);
    if (!h->running)
        return errctx_set(err, ST_INVALID, "the head does not run");
    h->sink = sink;
    uint64_t before = h->stats.transfers;
    bool works = h->gone || handle_events(h, timeout_ms);
    /* what else has come, but never longer than once around */
    for (unsigned i = 0; works && i < h->config.transfers && h->stats.transfers != before; i++) {
        before = h->stats.transfers;
        works = handle_events(h, 0);
    }
    if (h->stalled)
        clear_stall(h);
    h->sink = NULL;
    return works ? state_of(h, err) : translate(h, LIBUSB_ERROR_IO, "reading", err);
}

static enum st usb_stop(struct head *head, const struct head_sink *sink, struct errctx *err) {
    struct head_usb *h = of(head);
    if (!h->running)
        return ST_OK;
    h->sink = sink;
    h->abandoned = !recall_all(h);
    h->sink = NULL;
    h->running = false;
    return h->abandoned ? errctx_set(err, ST_DEVICE, "the head's transfers do not end: unplug it")
                        : ST_OK;
}

static void usb_stats(const struct head *head, struct head_stats *out_stats) {
    *out_stats = ((const struct head_usb *)head)->stats;
}

static void usb_close(struct head *head) {
    struct head_usb *h = of(head);
    if (h->running)
        h->abandoned = !recall_all(h);
    if (h->abandoned) /* the kernel may still write into the memory: rather lost than broken */
        return;
    for (unsigned i = 0; i < h->config.transfers; i++)
        libusb_free_transfer(h->transfer[i]);
    if (h->claimed)
        (void)libusb_release_interface(h->device, h->interface);
    if (h->device)
        libusb_close(h->device);
    if (h->context)
        libusb_exit(h->context);
    free(h->memory);
    free(h);
}

static const struct head_ops usb_ops = {.identify = usb_identify,
                                        .start = usb_start,
                                        .pump = usb_pump,
                                        .stop = usb_stop,
                                        .stats = usb_stats,
                                        .close = usb_close};

enum st head_usb_open(const struct head_usb_config *config, struct head **out_head,
                      struct errctx *err) {
    if (!config->vendor || !config->transfers || config->transfers > HEAD_USB_TRANSFERS_MAX ||
        config->transfer_bytes < HEAD_PACKET_MAX_BYTES ||
        config->transfer_bytes > HEAD_USB_TRANSFER_BYTES_MAX)
        return errctx_set(err, ST_INVALID,
                          "the head is not configured sensibly: give head.usb_vendor and "
                          "head.usb_product in the board file");
    struct head_usb *h = calloc(1, sizeof *h);
    if (!h)
        return errctx_set(err, ST_NOMEM, "no memory for the head");
    h->head.ops = &usb_ops;
    h->config = *config;
    h->seen_version = VERSION_UNKNOWN;
    enum st st = connect_device(h, err);
    h->config.serial = NULL; /* the caller's */
    if (st)
        usb_close(&h->head);
    else
        *out_head = &h->head;
    return st;
}
