/* Writes what a simulated cart sends into a site's streams, in chunks. */
#ifndef SC_TWIN_TWIN_RECORD_H
#define SC_TWIN_TWIN_RECORD_H

#include "base/index_event.h"
#include "site/site.h"
#include "twin/cart.h"

#include <stdbool.h>

/* One stream being filled. */
struct twin_record_stream {
    int64_t id;
    uint8_t *bytes; /* [capacity] */
    size_t size, capacity;
    int64_t first_item, next_item, items; /* of the chunk */
    int64_t t_first_ns, t_last_ns;
};

struct twin_record {
    struct site *site;
    int64_t station_id;
    struct twin_record_stream head, index, gpio;
    uint32_t next_seq; /* of the head's packets */
    bool disk_full;    /* a fault: the site takes no more */
};

/* Adds the three streams to a station. ST_NOMEM and the site's errors. */
ST_MUST_CHECK enum st twin_record_open(struct twin_record *record, struct site *site,
                                       int64_t station_id, uint32_t interval_ns,
                                       struct errctx *err);
/* What came from head, controller and lines. */
enum st twin_record_packet(struct twin_record *record, const struct cart_packet *packet,
                           struct errctx *err);
enum st twin_record_index(struct twin_record *record, const struct index_event *event,
                          int64_t t_host_ns, struct errctx *err);
enum st twin_record_edge(struct twin_record *record, const struct cart_edge *edge,
                         struct errctx *err);
/* Stores what is still in memory. */
ST_MUST_CHECK enum st twin_record_flush(struct twin_record *record, struct errctx *err);
void twin_record_fini(struct twin_record *record);

#endif
