/* Makes a site too large for memory: another site's photographs again and again, at stands on a
 * grid, until it has as many samples as asked for. Photographs are stored once, tiles are packed
 * for every stand.
 *
 * Usage: bench_viewer_site FROM PACK TO MILLIONS       FROM: a site; PACK: its tile pack */
#include "base/tile_pack.h"
#include "site/files.h"
#include "site/job.h"
#include "site/photo_row.h"
#include "site/station.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const double step_m = 14.0; /* from stand to stand */

struct big {
    struct site *from, *to;
    struct tile_pack *pack;
    const struct tile_pack_index *index;
    int fd; /* of the pack */
    int32_t copies, side;
    struct tile_pack_photo *photos; /* [copies][photo_count] */
    struct photo_row *rows;         /* [photo_count], of FROM */
};

static void must(enum st st, const struct errctx *err) {
    if (!st)
        return;
    (void)fprintf(stderr, "bench_viewer_site: %s\n", err->text);
    exit(1);
}

static int64_t samples_of(const struct tile_pack_index *index) {
    int64_t sum = 0;
    for (int32_t p = 0; p < index->photo_count; p++) {
        const struct tile_pack_photo *photo = &index->photos[p];
        int32_t nx, ny;
        tile_pack_tiles(&photo->camera, 0, &nx, &ny);
        for (int64_t k = 0; k < (int64_t)nx * ny; k++)
            sum += index->nodes[photo->first_node[0] + k].valid_count;
    }
    return sum;
}

/* The files of all photographs: one each, however often they are shown. */
static void copy_files(struct big *b) {
    struct errctx err = {0};
    for (int32_t p = 0; p < b->index->photo_count; p++) {
        uint8_t *bytes = NULL, sha256[HASH_SHA256_BYTES];
        size_t size = 0;
        must(photo_row_get(b->from, b->index->photos[p].photo_id, &b->rows[p], &err), &err);
        must(files_read(b->from, b->rows[p].sha256, &bytes, &size, &err), &err);
        must(files_put(b->to, FILES_PHOTO, "tif", bytes, size, sha256, &err), &err);
        free(bytes);
    }
}

/* One stand of FROM's stands, shifted and turned as a whole. */
static struct pose place(const struct big *b, int32_t copy) {
    double x = step_m * (copy % b->side), y = step_m * (copy / b->side), turn = 0.7 * copy;
    struct pose pose = {{{cos(turn), -sin(turn), 0, sin(turn), cos(turn), 0, 0, 0, 1}}, {x, y, 0}};
    return pose;
}

static void add_stands(struct big *b) {
    struct errctx err = {0};
    for (int32_t c = 0; c < b->copies; c++) {
        struct pose moved = place(b, c);
        int64_t old = 0, id = 0;
        for (int32_t p = 0; p < b->index->photo_count; p++) {
            struct tile_pack_photo *photo =
                &b->photos[(size_t)c * (size_t)b->index->photo_count + (size_t)p];
            *photo = b->index->photos[p];
            photo->world_from_station = pose_compose(&moved, &photo->world_from_station);
            if (photo->station_id != old) {
                struct station_pose pose = {.world_from_station = photo->world_from_station,
                                            .source = "bench"};
                char name[SITE_NAME_MAX];
                old = photo->station_id;
                (void)snprintf(name, sizeof name, "stand %d-%lld", (int)c, (long long)old);
                must(station_add(b->to, name, NULL, &pose, &id, &err), &err);
            }
            struct photo_row row = b->rows[p];
            row.station_id = id;
            row.frame_id = row.job_id = 0;
            must(photo_row_put(b->to, &row, &photo->photo_id, &err), &err);
            photo->station_id = id;
        }
    }
}

static void write_pack(struct big *b, const char *path) {
    struct errctx err = {0};
    struct tile_pack_writer *writer = NULL;
    uint8_t bytes[TILE_CODE_MAX_BYTES];
    int32_t n = b->index->photo_count;
    uint64_t size = 0;
    must(tile_pack_create(path, b->photos, b->copies * n, b->index->error_m,
                          b->index->error_range_m, &writer, &err),
         &err);
    for (int32_t c = 0; c < b->copies; c++)
        for (int32_t p = 0; p < n; p++) {
            const struct tile_pack_photo *from = &b->index->photos[p],
                                         *to = &b->photos[(size_t)c * (size_t)n + (size_t)p];
            int64_t end = p + 1 < n ? from[1].first_node[0] : b->index->node_count;
            for (int64_t k = from->first_node[0]; k < end; k++) {
                struct tile_pack_node node = b->index->nodes[k];
                if (node.size_bytes > sizeof bytes ||
                    pread(b->fd, bytes, node.size_bytes, (off_t)node.offset) !=
                        (ssize_t)node.size_bytes)
                    exit(1);
                must(tile_pack_put(writer, to->first_node[0] + (k - from->first_node[0]), &node,
                                   bytes, &err),
                     &err);
            }
        }
    must(tile_pack_commit(writer, &size, &err), &err);
    (void)fprintf(stderr, "%.0f MB of tiles\n", 1e-6 * (double)size);
}

int main(int argc, char **argv) {
    struct big b = {.fd = -1};
    struct errctx err = {0};
    struct site_info info = {0};
    char path[FILEIO_PATH_MAX];
    struct job_hash output = {.role = "tiles"};
    struct job job = {.kind = "fuse.tiles", .parameters = "{}", .outputs = &output};
    int64_t id = 0;
    if (argc != 5) {
        (void)fprintf(stderr, "usage: bench_viewer_site FROM PACK TO MILLIONS\n");
        return 2;
    }
    must(site_open(argv[1], SITE_READ, &b.from, &err), &err);
    must(site_create(argv[3], &info, &b.to, &err), &err);
    must(tile_pack_open(argv[2], &b.pack, &err), &err);
    b.fd = open(argv[2], O_RDONLY | O_CLOEXEC);
    b.index = tile_pack_get_index(b.pack);
    int64_t each = samples_of(b.index);
    b.copies = (int32_t)ceil(1e6 * strtod(argv[4], NULL) / (double)each);
    b.side = (int32_t)ceil(sqrt(b.copies));
    b.photos = calloc((size_t)b.copies * (size_t)b.index->photo_count, sizeof *b.photos);
    b.rows = calloc((size_t)b.index->photo_count, sizeof *b.rows);
    if (!b.photos || !b.rows || b.fd < 0)
        return 1;
    must(site_begin(b.to, &err), &err);
    copy_files(&b);
    add_stands(&b);
    must(files_temp_path(b.to, FILES_TILES, "tiles", path, &err), &err);
    write_pack(&b, path);
    must(files_adopt(b.to, FILES_TILES, "tiles", path, output.sha256, &err), &err);
    job.output_count = 1;
    (void)snprintf(job.program, sizeof job.program, "bench_viewer_site");
    must(job_add(b.to, &job, &id, &err), &err);
    must(site_commit(b.to, &err), &err);
    (void)fprintf(stderr, "%d copies of %.2f M samples: %.1f M samples, %d photographs\n",
                  (int)b.copies, 1e-6 * (double)each, 1e-6 * (double)each * b.copies,
                  (int)(b.copies * b.index->photo_count));
    must(site_close(b.to, &err), &err);
    must(site_close(b.from, &err), &err);
    tile_pack_close(b.pack);
    (void)close(b.fd);
    free(b.photos);
    free(b.rows);
    return 0;
}
