#include "capture/status.h"

#include <math.h>
#include <stdio.h>

const char *status_count(uint64_t count, char *out_text, size_t size) {
    double n = (double)count;
    if (count < 10000)
        (void)snprintf(out_text, size, "%llu", (unsigned long long)count);
    else if (n < 1e6)
        (void)snprintf(out_text, size, "%.0f k", n / 1e3);
    else
        (void)snprintf(out_text, size, "%.2f %s", n / (n < 1e9 ? 1e6 : 1e9), n < 1e9 ? "M" : "G");
    return out_text;
}

static void left(double seconds, char *out_text, size_t size) {
    if (!isfinite(seconds))
        out_text[0] = 0;
    else if (seconds < 90)
        (void)snprintf(out_text, size, " | %.0f s left", seconds);
    else
        (void)snprintf(out_text, size, " | %.0f min left", ceil(seconds / 60));
}

const char *status_line(const struct session_status *status, char out_line[STATUS_LINE_MAX]) {
    const struct session_status *s = status;
    char samples[24], lost[24], rest[32], photos[40] = "", pan[24] = "";
    uint64_t lost_samples = head_ledger_lost_samples(&s->counts.head);
    left(s->remaining_s, rest, sizeof rest);
    if (s->photos || s->photos_missed)
        (void)snprintf(photos, sizeof photos, " | photograph %u of %u",
                       s->photos + s->photos_missed, s->photos_planned);
    if (isfinite(s->pan_deg))
        (void)snprintf(pan, sizeof pan, ", pan %.1f deg", s->pan_deg);
    (void)snprintf(out_line, STATUS_LINE_MAX,
                   "%3.0f %% %s%s | %s samples, %s lost | mirror %.2f Hz, laser %s%s | %.1f MB, "
                   "%.0f GB free%s",
                   s->progress * 100, drive_phase_name(s->phase), pan,
                   status_count(s->counts.head.samples, samples, sizeof samples),
                   status_count(lost_samples, lost, sizeof lost), s->mirror_hz,
                   s->laser_on ? "on" : "off", photos, (double)s->counts.stored_bytes * 1e-6,
                   (double)s->free_bytes * 1e-9, rest);
    return out_line;
}
