#include "base/fileio.h"
#include "base/hash.h"
#include "base/tile_pack_wire.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct tile_pack_writer {
    char path[FILEIO_PATH_MAX], spool_path[FILEIO_PATH_MAX];
    FILE *spool; /* tiles as they came */
    uint64_t spool_bytes;
    struct tile_pack_photo *photos;
    int32_t photo_count;
    struct tile_pack_node *nodes; /* offsets are the spool's until the end */
    int64_t node_count;
    double error_m, error_range_m;
};

static enum st io_error(const char *path, struct errctx *err) {
    int error = errno ? errno : EIO;
    return errctx_set(err, fileio_status(error), "%s: cannot write: %s", path, strerror(error));
}

static void writer_free(struct tile_pack_writer *w) {
    if (!w)
        return;
    if (w->spool)
        (void)fclose(w->spool);
    if (w->spool_path[0])
        fileio_abandon(w->spool_path);
    free(w->photos);
    free(w->nodes);
    free(w);
}

enum st tile_pack_create(const char *path, struct tile_pack_photo *photos, int32_t photo_count,
                         double error_m, double error_range_m, struct tile_pack_writer **out_writer,
                         struct errctx *err) {
    if (photo_count < 0 || photo_count > TILE_PACK_MAX_PHOTOS || strlen(path) >= FILEIO_PATH_MAX)
        return errctx_set(err, ST_INVALID, "%s: %d photographs do not fit", path, photo_count);
    int64_t nodes = 0;
    for (int32_t i = 0; i < photo_count; i++)
        nodes += tile_pack_wire_lay_out(photos + i, nodes);
    if (nodes > TILE_PACK_MAX_NODES)
        return errctx_set(err, ST_INVALID, "%s: %lld tiles are more than one pack holds", path,
                          (long long)nodes);
    struct tile_pack_writer *w = calloc(1, sizeof *w);
    if (!w)
        return errctx_set(err, ST_NOMEM, "%s: no memory", path);
    memcpy(w->path, path, strlen(path) + 1);
    w->photo_count = photo_count;
    w->node_count = nodes;
    w->error_m = error_m;
    w->error_range_m = error_range_m;
    w->photos = malloc(((size_t)photo_count + 1) * sizeof *w->photos);
    w->nodes = calloc((size_t)nodes + 1, sizeof *w->nodes);
    enum st st = ST_OK;
    if (!w->photos || !w->nodes) {
        st = errctx_set(err, ST_NOMEM, "%s: no memory for an index of %lld tiles", path,
                        (long long)nodes);
        goto out;
    }
    if (photo_count)
        memcpy(w->photos, photos, (size_t)photo_count * sizeof *w->photos);
    for (int64_t i = 0; i < nodes; i++)
        w->nodes[i].disparity_min_per_m = 1.0f; /* above the maximum: holds none */
    st = fileio_temp(path, w->spool_path, err);
    if (st) {
        w->spool_path[0] = 0;
        goto out;
    }
    w->spool = fopen(w->spool_path, "w+b");
    if (!w->spool)
        st = io_error(w->spool_path, err);
out:
    if (st)
        writer_free(w);
    else
        *out_writer = w;
    return st;
}

enum st tile_pack_put(struct tile_pack_writer *w, int64_t node,
                      const struct tile_pack_node *description, const void *bytes,
                      struct errctx *err) {
    if (node < 0 || node >= w->node_count || description->size_bytes > TILE_CODE_MAX_BYTES ||
        (description->kind == TILE_PACK_NONE) != (description->size_bytes == 0) ||
        w->nodes[node].size_bytes)
        return errctx_set(err, ST_INVALID, "%s: tile %lld makes no sense", w->path,
                          (long long)node);
    struct tile_pack_node n = *description;
    n.offset = n.size_bytes ? w->spool_bytes : 0;
    n.crc32c = n.size_bytes ? hash_crc32c(0, bytes, n.size_bytes) : 0;
    if (n.size_bytes && fwrite(bytes, 1, n.size_bytes, w->spool) != n.size_bytes)
        return io_error(w->path, err);
    w->spool_bytes += n.size_bytes;
    w->nodes[node] = n;
    return ST_OK;
}

/* Order of the tiles in the file: coarsest level first, then photograph after photograph. Level
 * counts differ, so "coarsest" is counted from level 15 down: what has few pixels comes early. */
static enum st copy_tiles(struct tile_pack_writer *w, FILE *out, const char *out_path,
                          uint64_t first_offset, struct errctx *err) {
    uint64_t at = first_offset;
    uint8_t bytes[TILE_CODE_MAX_BYTES];
    for (int32_t level = TILE_PACK_MAX_LEVELS - 1; level >= 0; level--)
        for (int32_t i = 0; i < w->photo_count; i++) {
            const struct tile_pack_photo *photo = w->photos + i;
            if (level >= photo->level_count)
                continue;
            int32_t tx, ty;
            tile_pack_tiles(&photo->camera, level, &tx, &ty);
            for (int64_t k = 0; k < (int64_t)tx * ty; k++) {
                struct tile_pack_node *n = w->nodes + photo->first_node[level] + k;
                if (!n->size_bytes)
                    continue;
                if (fseeko(w->spool, (off_t)n->offset, SEEK_SET) != 0 ||
                    fread(bytes, 1, n->size_bytes, w->spool) != n->size_bytes)
                    return io_error(w->spool_path, err);
                if (fwrite(bytes, 1, n->size_bytes, out) != n->size_bytes)
                    return io_error(out_path, err);
                n->offset = at;
                at += n->size_bytes;
            }
        }
    return ST_OK;
}

static enum st write_index(struct tile_pack_writer *w, FILE *out, const char *out_path,
                           uint64_t index_bytes, uint64_t file_bytes, struct errctx *err) {
    uint8_t *bytes = calloc(1, (size_t)index_bytes);
    if (!bytes)
        return errctx_set(err, ST_NOMEM, "%s: no memory for the index", w->path);
    struct tile_pack_wire_header header = {.version = TILE_PACK_VERSION,
                                           .photo_count = w->photo_count,
                                           .node_count = w->node_count,
                                           .file_bytes = file_bytes,
                                           .error_m = w->error_m,
                                           .error_range_m = w->error_range_m};
    uint8_t *p = bytes + TILE_PACK_WIRE_HEADER_BYTES;
    for (int32_t i = 0; i < w->photo_count; i++, p += TILE_PACK_WIRE_PHOTO_BYTES)
        tile_pack_wire_put_photo(p, w->photos + i);
    for (int64_t i = 0; i < w->node_count; i++, p += TILE_PACK_WIRE_NODE_BYTES)
        tile_pack_wire_put_node(p, w->nodes + i);
    tile_pack_wire_put_header(bytes, &header);
    header.index_crc32c = hash_crc32c(0, bytes + 16, (size_t)index_bytes - 16);
    tile_pack_wire_put_header(bytes, &header);
    enum st st = ST_OK;
    if (fseeko(out, 0, SEEK_SET) != 0 ||
        fwrite(bytes, 1, (size_t)index_bytes, out) != (size_t)index_bytes)
        st = io_error(out_path, err);
    free(bytes);
    return st;
}

enum st tile_pack_commit(struct tile_pack_writer *w, uint64_t *out_file_bytes, struct errctx *err) {
    char temp[FILEIO_PATH_MAX] = "";
    uint64_t index_bytes = TILE_PACK_WIRE_HEADER_BYTES +
                           (uint64_t)w->photo_count * TILE_PACK_WIRE_PHOTO_BYTES +
                           (uint64_t)w->node_count * TILE_PACK_WIRE_NODE_BYTES;
    uint64_t file_bytes = index_bytes + w->spool_bytes;
    FILE *out = NULL;
    enum st st = fileio_temp(w->path, temp, err);
    if (st) {
        temp[0] = 0;
        goto out;
    }
    out = fopen(temp, "w+b");
    if (!out || fseeko(out, (off_t)index_bytes, SEEK_SET) != 0) {
        st = io_error(temp, err);
        goto out;
    }
    st = copy_tiles(w, out, temp, index_bytes, err);
    if (!st)
        st = write_index(w, out, temp, index_bytes, file_bytes, err);
    if (!st && (fflush(out) != 0 || fsync(fileno(out)) != 0))
        st = io_error(temp, err);
    if (fclose(out) != 0 && !st)
        st = io_error(temp, err);
    out = NULL;
    if (!st) {
        st = fileio_commit(temp, w->path, err);
        temp[0] = 0;
    }
    if (!st && out_file_bytes)
        *out_file_bytes = file_bytes;
out:
    if (out)
        (void)fclose(out);
    if (temp[0])
        fileio_abandon(temp);
    writer_free(w);
    return st;
}

void tile_pack_abandon(struct tile_pack_writer *writer) {
    writer_free(writer);
}
