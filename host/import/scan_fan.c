#include "import/scan_fan.h"

#include "base/sample_grid.h"
#include "import/number_text.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double rad = 3.14159265358979323846 / 180.0;

enum { LEAD = 3, FEWEST_NUMBERS = 8, MOST_BEARINGS = 1 << 16 };
static const double farthest_m = 1e4; /* beyond this a range is garbage */

struct fan {
    double *bearing_rad;
    size_t bearings;
    struct scan scan;
    size_t capacity;
};

/* The next number of the line, and the comma behind it. */
static bool next_number(struct number_text *text, double *out_value) {
    if (!number_text_double(text, out_value))
        return false;
    if (!number_text_at_line_end(text) && *text->at == ',')
        text->at++;
    return true;
}

bool scan_fan_is(const void *data, size_t size) {
    struct number_text text = number_text_start(data, size);
    double value = 0;
    int n = 0;
    if (number_text_at_end(&text))
        return false;
    while (n < FEWEST_NUMBERS && !number_text_at_line_end(&text) && next_number(&text, &value))
        n++;
    return n == FEWEST_NUMBERS;
}

static enum st read_bearings(struct number_text *text, struct fan *fan, struct errctx *err) {
    fan->bearing_rad = malloc(MOST_BEARINGS * sizeof *fan->bearing_rad);
    if (!fan->bearing_rad)
        return errctx_set(err, ST_NOMEM, "no memory for the bearings of a scan");
    double value = 0;
    for (size_t n = 0; !number_text_at_line_end(text); n++) {
        if (!next_number(text, &value))
            return errctx_set(err, ST_FORMAT, "line %zu: number %zu is none", text->line, n + 1);
        if (n < LEAD)
            continue;
        if (fan->bearings == MOST_BEARINGS || fabs(value) > 180.0)
            return errctx_set(err, ST_FORMAT, "line %zu: number %zu, %g, is no bearing in degrees",
                              text->line, n + 1, value);
        fan->bearing_rad[fan->bearings++] = value * rad;
    }
    return fan->bearings ? ST_OK
                         : errctx_set(err, ST_FORMAT, "line %zu has no bearing", text->line);
}

static enum st make_room(struct fan *fan, struct errctx *err) {
    if (fan->scan.count + fan->bearings <= fan->capacity)
        return ST_OK;
    const size_t wanted = 2 * fan->capacity + 64 * fan->bearings;
    struct polar_sample *more =
        wanted <= SCAN_MAX_SAMPLES ? realloc(fan->scan.samples, wanted * sizeof *more) : NULL;
    if (!more)
        return errctx_set(err, ST_NOMEM, "no memory for a scan of %zu samples", wanted);
    fan->scan.samples = more;
    fan->capacity = wanted;
    return ST_OK;
}

static struct polar_sample make_sample(double bearing_rad, double turn_rad, double range_m) {
    const struct vec3 dir = {cos(bearing_rad) * cos(turn_rad), sin(bearing_rad),
                             cos(bearing_rad) * sin(turn_rad)};
    struct polar_sample s = sample_from_point(dir);
    s.range_m = range_m > 0.0 ? (float)range_m : NAN;
    s.flags = 0;
    if (!(range_m > 0.0))
        s.flags = SAMPLE_NO_RETURN;
    return s;
}

static enum st read_line(struct number_text *text, struct fan *fan, struct errctx *err) {
    double lead[LEAD], range_m = 0;
    enum st st = make_room(fan, err);
    for (int i = 0; i < LEAD && !st; i++)
        if (!next_number(text, &lead[i]))
            st = errctx_set(err, ST_FORMAT, "line %zu: number %d is none", text->line, i + 1);
    if (!st && fabs(lead[2]) > 3600.0)
        st = errctx_set(err, ST_FORMAT, "line %zu: %g is no angle of the motor in degrees",
                        text->line, lead[2]);
    for (size_t i = 0; i < fan->bearings && !st; i++) {
        if (!next_number(text, &range_m) || range_m < 0.0 || range_m > farthest_m) {
            st = errctx_set(err, ST_FORMAT, "line %zu: number %zu is no range in metres",
                            text->line, i + LEAD + 1);
            break;
        }
        struct polar_sample s = make_sample(fan->bearing_rad[i], lead[2] * rad, range_m);
        s.row = (uint32_t)fan->scan.rows;
        s.column = (uint32_t)i;
        fan->scan.samples[fan->scan.count++] = s;
    }
    if (!st && !number_text_at_line_end(text))
        st = errctx_set(err, ST_FORMAT, "line %zu has more numbers than %zu ranges need",
                        text->line, fan->bearings);
    fan->scan.rows++;
    return st;
}

enum st scan_fan_parse(const void *data, size_t size, struct scan *out_scan, struct errctx *err) {
    struct number_text text = number_text_start(data, size);
    struct fan fan;
    memset(&fan, 0, sizeof fan);
    enum st st = number_text_at_end(&text) ? errctx_set(err, ST_FORMAT, "there is no scan in it")
                                           : read_bearings(&text, &fan, err);
    if (!st)
        number_text_next_line(&text);
    while (!st && !number_text_at_end(&text)) {
        st = read_line(&text, &fan, err);
        number_text_next_line(&text);
    }
    if (!st && !fan.scan.rows)
        st = errctx_set(err, ST_FORMAT, "there is no line of ranges in it");
    free(fan.bearing_rad);
    if (st) {
        scan_destroy(&fan.scan);
        return st;
    }
    fan.scan.columns = (int32_t)fan.bearings;
    fan.scan.world_from_station = pose_identity();
    (void)snprintf(fan.scan.meta, sizeof fan.scan.meta,
                   "{\"grid\":\"nodding line scanner\",\"rows\":%d,\"columns\":%d,"
                   "\"axis\":[0,1,0]}",
                   fan.scan.rows, fan.scan.columns);
    *out_scan = fan.scan;
    return ST_OK;
}
