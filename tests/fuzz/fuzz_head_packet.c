/* Any bytes may come from the wire: the decoder must neither read beyond them nor accept a packet
 * that it would not itself have written. */
#include "base/head_packet.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct head_stream_stats stats = {0};
    struct head_packet packet;
    size_t offset = 0;
    while (head_stream_next(data, size, &offset, &packet, &stats) == ST_OK) {
        uint8_t again[HEAD_PACKET_MAX_BYTES];
        size_t n = 0;
        bool numbered = true; /* the encoder numbers samples itself */
        for (unsigned i = 0; i < packet.sample_count; i++)
            numbered &= packet.samples[i].seq8 == (uint8_t)(packet.first_sample_seq + i);
        if (head_packet_encode(&packet, again, &n) || n > offset ||
            (numbered && memcmp(again, data + offset - n, n)))
            abort();
    }
    if (offset > size || stats.bytes_skipped > size)
        abort();
    return 0;
}
