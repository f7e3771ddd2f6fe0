/* Bytes of a tile pack's index; shared by its reader and its writer only. */
#ifndef SC_BASE_TILE_PACK_WIRE_H
#define SC_BASE_TILE_PACK_WIRE_H

#include "base/tile_pack.h"

#ifdef __cplusplus
extern "C" {
#endif

/* header | photographs | nodes | tiles. The CRC-32C in the header covers all of the index after it.
 */
enum {
    TILE_PACK_WIRE_HEADER_BYTES = 64,
    TILE_PACK_WIRE_PHOTO_BYTES = 320,
    TILE_PACK_WIRE_NODE_BYTES = 32
};
extern const char tile_pack_wire_magic[8];

struct tile_pack_wire_header {
    uint32_t version, index_crc32c;
    int64_t photo_count, node_count;
    uint64_t file_bytes;
    double error_m, error_range_m;
};

void tile_pack_wire_put_header(uint8_t *out_bytes, const struct tile_pack_wire_header *header);
/* ST_FORMAT unless magic, version and counts are in bounds. */
ST_MUST_CHECK enum st tile_pack_wire_get_header(const uint8_t *bytes,
                                                struct tile_pack_wire_header *out_header);
void tile_pack_wire_put_photo(uint8_t *out_bytes, const struct tile_pack_photo *photo);
void tile_pack_wire_get_photo(const uint8_t *bytes, struct tile_pack_photo *out_photo);
void tile_pack_wire_put_node(uint8_t *out_bytes, const struct tile_pack_node *node);
void tile_pack_wire_get_node(const uint8_t *bytes, struct tile_pack_node *out_node);

/* Level of each node's photograph: fills level_count, first_node and returns the number of nodes
 * from `first` on. */
int64_t tile_pack_wire_lay_out(struct tile_pack_photo *photo, int64_t first);

#ifdef __cplusplus
}
#endif
#endif
