#include "base/fileio.h"
#include "base/hash.h"
#include "base/tile_pack_wire.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

struct tile_pack {
    int fd;               /* -1: in memory */
    const uint8_t *bytes; /* NULL: in the file */
    uint64_t size;
    struct tile_pack_index index;
};

static enum st read_at(const struct tile_pack *pack, uint64_t offset, uint8_t *out, size_t size,
                       struct errctx *err) {
    if (offset > pack->size || size > pack->size - offset)
        return errctx_set(err, ST_FORMAT, "the file ends before its tiles do");
    if (pack->bytes) {
        memcpy(out, pack->bytes + offset, size);
        return ST_OK;
    }
    for (size_t at = 0; at < size;) {
        ssize_t n = pread(pack->fd, out + at, size - at, (off_t)(offset + at));
        if (n < 0 && errno == EINTR)
            continue;
        if (n <= 0)
            return errctx_set(err, n < 0 ? fileio_status(errno) : ST_FORMAT,
                              "cannot read tiles: %s", n < 0 ? strerror(errno) : "end of file");
        at += (size_t)n;
    }
    return ST_OK;
}

static bool is_text(const char *name, size_t size) {
    return memchr(name, 0, size) != NULL;
}

static enum st check_photo(const struct tile_pack_photo *photo, struct errctx *err) {
    enum st st = camera_check(&photo->camera, err);
    if (st)
        return ST_FORMAT;
    const struct pose *poses[2] = {&photo->station_from_cam, &photo->world_from_station};
    for (int k = 0; k < 2; k++)
        if (!(pose_orthonormality_error(&poses[k]->r) < 1e-6) || !vec3_is_finite(poses[k]->t_m))
            return errctx_set(err, ST_FORMAT, "a pose is no rotation");
    return ST_OK;
}

static enum st check_node(const struct tile_pack *pack, const struct tile_pack_node *n,
                          uint64_t index_bytes, struct errctx *err) {
    bool none = n->kind == TILE_PACK_NONE;
    if (n->kind > TILE_PACK_PLANE || none != (n->size_bytes == 0) ||
        n->size_bytes > TILE_CODE_MAX_BYTES || n->valid_count > PHOTO_TILE_PX * PHOTO_TILE_PX ||
        isnan(n->disparity_min_per_m) || isnan(n->disparity_max_per_m) || isnan(n->error_per_m))
        return errctx_set(err, ST_FORMAT, "the index describes a tile that cannot be");
    if (!none && (n->offset < index_bytes || n->offset > pack->size ||
                  n->size_bytes > pack->size - n->offset))
        return errctx_set(err, ST_FORMAT, "a tile lies outside of the file");
    return ST_OK;
}

static enum st parse(struct tile_pack *pack, const struct tile_pack_wire_header *header,
                     const uint8_t *index, uint64_t index_bytes, struct errctx *err) {
    struct tile_pack_index *x = &pack->index;
    x->photos = calloc((size_t)header->photo_count + 1, sizeof *x->photos);
    x->nodes = malloc(((size_t)header->node_count + 1) * sizeof *x->nodes);
    if (!x->photos || !x->nodes)
        return errctx_set(err, ST_NOMEM, "no memory for the index of %lld tiles",
                          (long long)header->node_count);
    x->photo_count = (int32_t)header->photo_count;
    x->node_count = header->node_count;
    x->file_bytes = header->file_bytes;
    x->error_m = header->error_m;
    x->error_range_m = header->error_range_m;
    const uint8_t *p = index;
    int64_t first = 0;
    for (int32_t i = 0; i < x->photo_count; i++, p += TILE_PACK_WIRE_PHOTO_BYTES) {
        if (!is_text((const char *)p, TILE_PACK_NAME_BYTES))
            return errctx_set(err, ST_FORMAT, "photograph %d has no name", i);
        tile_pack_wire_get_photo(p, x->photos + i);
        enum st st = check_photo(x->photos + i, err);
        if (st)
            return errctx_prefix(err, st, "photograph %d", i);
        int64_t said = x->photos[i].first_node[0];
        int64_t count = tile_pack_wire_lay_out(x->photos + i, first);
        if (said != first || count > x->node_count - first)
            return errctx_set(err, ST_FORMAT, "photograph %d has other tiles than the index", i);
        first += count;
    }
    if (first != x->node_count)
        return errctx_set(err, ST_FORMAT, "the index has tiles of no photograph");
    for (int64_t i = 0; i < x->node_count; i++, p += TILE_PACK_WIRE_NODE_BYTES) {
        tile_pack_wire_get_node(p, x->nodes + i);
        enum st st = check_node(pack, x->nodes + i, index_bytes, err);
        if (st)
            return errctx_prefix(err, st, "tile %lld", (long long)i);
    }
    return ST_OK;
}

static enum st load(struct tile_pack *pack, struct errctx *err) {
    uint8_t wire[TILE_PACK_WIRE_HEADER_BYTES];
    struct tile_pack_wire_header header;
    if (pack->size < sizeof wire)
        return errctx_set(err, ST_FORMAT, "%llu bytes are no tile pack",
                          (unsigned long long)pack->size);
    enum st st = read_at(pack, 0, wire, sizeof wire, err);
    if (st)
        return st;
    st = tile_pack_wire_get_header(wire, &header);
    if (st)
        return errctx_set(err, st, "this is no tile pack that this program reads");
    uint64_t rest = (uint64_t)header.photo_count * TILE_PACK_WIRE_PHOTO_BYTES +
                    (uint64_t)header.node_count * TILE_PACK_WIRE_NODE_BYTES;
    if (header.file_bytes != pack->size || rest > pack->size - sizeof wire)
        return errctx_set(err, ST_FORMAT, "the file has %llu bytes, not the %llu it says",
                          (unsigned long long)pack->size, (unsigned long long)header.file_bytes);
    uint8_t *index = malloc((size_t)rest + 1);
    if (!index)
        return errctx_set(err, ST_NOMEM, "no memory for an index of %llu bytes",
                          (unsigned long long)rest);
    st = read_at(pack, sizeof wire, index, (size_t)rest, err);
    uint32_t crc = hash_crc32c(hash_crc32c(0, wire + 16, sizeof wire - 16), index, (size_t)rest);
    if (!st && crc != header.index_crc32c)
        st = errctx_set(err, ST_DAMAGED, "the index is damaged; make the tiles again");
    if (!st)
        st = parse(pack, &header, index, sizeof wire + rest, err);
    free(index);
    return st;
}

enum st tile_pack_open(const char *path, struct tile_pack **out_pack, struct errctx *err) {
    struct tile_pack *pack = calloc(1, sizeof *pack);
    if (!pack)
        return errctx_set(err, ST_NOMEM, "%s: no memory", path);
    enum st st = ST_OK;
    struct stat stat_of_file;
    pack->fd = open(path, O_RDONLY | O_CLOEXEC);
    if (pack->fd < 0 || fstat(pack->fd, &stat_of_file) != 0) {
        int error = errno;
        st = errctx_set(err, fileio_status(error), "%s: %s", path, strerror(error));
        tile_pack_close(pack);
        return st;
    }
    pack->size = stat_of_file.st_size > 0 ? (uint64_t)stat_of_file.st_size : 0;
    st = load(pack, err);
    if (st) {
        tile_pack_close(pack);
        return errctx_prefix(err, st, "%s", path);
    }
    *out_pack = pack;
    return ST_OK;
}

enum st tile_pack_open_memory(const void *bytes, size_t size, struct tile_pack **out_pack,
                              struct errctx *err) {
    struct tile_pack *pack = calloc(1, sizeof *pack);
    if (!pack)
        return errctx_set(err, ST_NOMEM, "no memory");
    pack->fd = -1;
    pack->bytes = bytes;
    pack->size = size;
    enum st st = load(pack, err);
    if (st) {
        tile_pack_close(pack);
        return st;
    }
    *out_pack = pack;
    return ST_OK;
}

void tile_pack_close(struct tile_pack *pack) {
    if (!pack)
        return;
    if (pack->fd >= 0)
        (void)close(pack->fd);
    free(pack->index.photos);
    free(pack->index.nodes);
    free(pack);
}

const struct tile_pack_index *tile_pack_get_index(const struct tile_pack *pack) {
    return &pack->index;
}

enum st tile_pack_read(const struct tile_pack *pack, int64_t node, struct tile_samples *out_samples,
                       struct errctx *err) {
    if (node < 0 || node >= pack->index.node_count)
        return errctx_set(err, ST_INVALID, "there is no tile %lld", (long long)node);
    const struct tile_pack_node *n = pack->index.nodes + node;
    if (!n->size_bytes)
        return errctx_set(err, ST_NOT_FOUND, "tile %lld holds nothing", (long long)node);
    uint8_t bytes[TILE_CODE_MAX_BYTES];
    enum st st = read_at(pack, n->offset, bytes, n->size_bytes, err);
    if (st)
        return errctx_prefix(err, st, "tile %lld", (long long)node);
    if (hash_crc32c(0, bytes, n->size_bytes) != n->crc32c)
        return errctx_set(err, ST_DAMAGED, "tile %lld is damaged", (long long)node);
    enum tile_code_kind kind;
    st = tile_code_decode(bytes, n->size_bytes, out_samples, &kind);
    if (!st && (kind == TILE_CODE_PLANE) != (n->kind == TILE_PACK_PLANE))
        st = ST_FORMAT;
    return st ? errctx_set(err, st, "tile %lld does not decode", (long long)node) : ST_OK;
}
