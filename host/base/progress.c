#include "base/progress.h"

#include "base/clock.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { BAR_COLUMNS = 24, TEXT_COLUMNS = 79 };
static const int64_t draw_period_ns = 100000000;

static bool is_redrawable(FILE *out) {
    const char *term = getenv("TERM");
    return out && isatty(fileno(out)) && term && strcmp(term, "dumb") != 0;
}

void progress_init(struct progress *progress, FILE *out, const char *label, int64_t total,
                   const char *unit) {
    memset(progress, 0, sizeof *progress);
    progress->out = is_redrawable(out) ? out : NULL;
    progress->label = label;
    progress->unit = unit;
    progress->total = total;
    progress->start_ns = clock_now_ns();
    atomic_init(&progress->done, 0);
    atomic_init(&progress->next_draw_ns, progress->start_ns);
    atomic_init(&progress->drawing, false);
}

/* "0:07", "12:34", "3:04:05" */
static void duration_text(int64_t ns, char *out_text, size_t size) {
    long long s = (long long)((ns + 500000000) / 1000000000);
    if (s >= 3600)
        (void)snprintf(out_text, size, "%lld:%02lld:%02lld", s / 3600, s / 60 % 60, s % 60);
    else
        (void)snprintf(out_text, size, "%lld:%02lld", s / 60, s % 60);
}

void progress_text(const struct progress *progress, int64_t done, int64_t elapsed_ns,
                   char *out_text, size_t size) {
    char time[32], line[256];
    if (progress->total <= 0) {
        duration_text(elapsed_ns, time, sizeof time);
        (void)snprintf(line, sizeof line, "%s  %lld %s  %s", progress->label, (long long)done,
                       progress->unit, time);
    } else {
        double share = (double)done / (double)progress->total;
        share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
        char bar[BAR_COLUMNS + 1];
        for (int i = 0; i < BAR_COLUMNS; i++)
            bar[i] = (i + 1) <= (int)(share * BAR_COLUMNS) ? '#' : '.';
        bar[BAR_COLUMNS] = '\0';
        bool over = share >= 1.0;
        if (over)
            duration_text(elapsed_ns, time, sizeof time);
        else if (done > 0)
            duration_text((int64_t)((double)elapsed_ns * (1.0 - share) / share), time, sizeof time);
        else
            (void)snprintf(time, sizeof time, "-:--");
        (void)snprintf(line, sizeof line, "%s  [%s] %3d %%  %lld/%lld %s  %s%s", progress->label,
                       bar, (int)(100.0 * share), (long long)done, (long long)progress->total,
                       progress->unit, time, over ? "" : " left");
    }
    line[TEXT_COLUMNS] = '\0';
    (void)snprintf(out_text, size, "%s", line);
}

static void draw(struct progress *progress, int64_t now_ns) {
    char text[TEXT_COLUMNS + 1];
    progress_text(progress, atomic_load(&progress->done), now_ns - progress->start_ns, text,
                  sizeof text);
    (void)fprintf(progress->out, "\r%s\033[K", text);
    (void)fflush(progress->out);
}

void progress_add(struct progress *progress, int64_t n) {
    if (!progress)
        return;
    (void)atomic_fetch_add_explicit(&progress->done, n, memory_order_relaxed);
    if (!progress->out)
        return;
    int64_t now_ns = clock_now_ns();
    if (now_ns < atomic_load_explicit(&progress->next_draw_ns, memory_order_relaxed))
        return;
    if (atomic_exchange(&progress->drawing, true))
        return; /* another thread is at it */
    atomic_store(&progress->next_draw_ns, now_ns + draw_period_ns);
    draw(progress, now_ns);
    atomic_store(&progress->drawing, false);
}

void progress_fini(struct progress *progress, bool keep) {
    if (!progress || !progress->out)
        return;
    if (keep) {
        draw(progress, clock_now_ns());
        (void)fputc('\n', progress->out);
    } else {
        (void)fputs("\r\033[K", progress->out);
    }
    (void)fflush(progress->out);
    progress->out = NULL;
}
