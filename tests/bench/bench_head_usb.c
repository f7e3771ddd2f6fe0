/* Head packets through the real libusb, on a bus that umockdev simulates in this process: at the
 * original head's 50 000 samples/s for some seconds, then as fast as it goes.
 *
 *   bench_head_usb [SECONDS]      default 5 */
#include "base/clock.h"
#include "base/head_packet.h"
#include "capture/backends/head_usb.h"
#include "tests/support/head_sim.h"
#include "tests/support/umock.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { REST_BYTES = 1 << 18 };

struct feed { /* the head */
    int64_t start_ns;
    double rate_hz; /* 0: as fast as asked for */
    uint32_t packet;
};

struct count { /* what came out */
    uint8_t rest[REST_BYTES];
    size_t size;
    struct head_stream_stats stream;
    uint64_t samples, lost;
    uint32_t next;
};

static struct count count;

/* Whole packets that are due, as many as the transfer holds. */
static size_t more(void *ctx, uint8_t *out_bytes, size_t capacity) {
    struct feed *feed = ctx;
    size_t filled = 0;
    double due = feed->rate_hz > 0 ? (double)(clock_now_ns() - feed->start_ns) * 1e-9 *
                                         feed->rate_hz / HEAD_PACKET_MAX_SAMPLES
                                   : 1e18;
    while (filled + HEAD_PACKET_MAX_BYTES <= capacity && (double)feed->packet < due) {
        struct head_packet p = {.packet_seq = feed->packet,
                                .first_sample_seq = feed->packet * HEAD_PACKET_MAX_SAMPLES,
                                .head_t_ns = (int64_t)feed->packet * 680000,
                                .interval_ns = 20000,
                                .sample_count = HEAD_PACKET_MAX_SAMPLES};
        size_t size = 0;
        if (head_packet_encode(&p, out_bytes + filled, &size))
            return 0;
        filled += size;
        feed->packet++;
    }
    return filled;
}

static void take(void *ctx, const uint8_t *bytes, size_t size, int64_t t_host_ns) {
    struct count *c = ctx;
    struct head_packet p;
    size_t offset = 0;
    (void)t_host_ns;
    if (size > REST_BYTES - c->size)
        return;
    memcpy(c->rest + c->size, bytes, size);
    c->size += size;
    while (!head_stream_next(c->rest, c->size, &offset, &p, &c->stream)) {
        c->lost += p.packet_seq - c->next;
        c->next = p.packet_seq + 1;
        c->samples += p.sample_count;
    }
    memmove(c->rest, c->rest + offset, c->size - offset);
    c->size -= offset;
}

static bool run(const char *name, double rate_hz, double seconds) {
    const struct head_sim_device device = {0x1209, 0x5c41, 0x0100, "BENCH"};
    const struct head_sink sink = {&count, take};
    struct head_usb_config config = head_usb_default();
    struct feed feed = {.rate_hz = rate_hz};
    struct head_stats stats;
    struct errctx err = {0};
    struct head *head = NULL;
    memset(&count, 0, sizeof count);
    if (!head_sim_plug(&device, 1) || head_usb_open(&config, &head, &err) ||
        head->ops->start(head, &err)) {
        (void)fprintf(stderr, "bench_head_usb: %s\n", err.text);
        return false;
    }
    feed.start_ns = clock_now_ns();
    head_sim_source(more, &feed);
    int64_t end_ns = feed.start_ns + (int64_t)(seconds * 1e9);
    bool good = true;
    while (good && clock_now_ns() < end_ns)
        good = !head->ops->pump(head, 20, &sink, &err);
    double took_s = (double)(clock_now_ns() - feed.start_ns) * 1e-9;
    head->ops->stats(head, &stats);
    (void)head->ops->stop(head, &sink, &err); /* what is still under way counts too */
    (void)printf("%-24s %10.0f %10.2f %8llu %8llu %8llu\n", name, (double)count.samples / took_s,
                 (double)stats.bytes / took_s * 1e-6, (unsigned long long)count.lost,
                 (unsigned long long)(feed.packet - count.next),
                 (unsigned long long)stats.transfer_errors);
    head_close(head);
    head_sim_remove();
    return good && !count.lost;
}

int main(int argc, char **argv) {
    int skip = umock_enter(argv);
    if (skip)
        return skip;
    double seconds = argc > 1 ? strtod(argv[1], NULL) : 5;
    (void)printf("%-24s %10s %10s %8s %8s %8s\n", "head through libusb", "samples/s", "MB/s",
                 "lost", "unsent", "errors");
    bool good = run("50 000 samples/s", 50000, seconds);
    good = run("as fast as it goes", 0, seconds) && good;
    return !good;
}
