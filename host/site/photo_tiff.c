#include "site/photo_tiff.h"

#include "base/fileio.h"
#include "base/image.h"
#include "site/photo_json.h"
#include "site/tiff_mem.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PAGES = 4, STRIP_BYTES = 256 * 1024 };

/* The largest photograph, uncompressed, must fit a classic TIFF's 32-bit offsets. */
_Static_assert(IMAGE_MAX_PIXELS * 9 < INT64_C(4000000000), "BigTIFF would be needed");

/* Rotation matrices go through text of 17 digits unchanged, but a stranger's file may be rounded.
 */
#define ROTATION_TOLERANCE 1e-6

/* Deflate packs 1032 bytes into one at the most: a file that claims more lies. */
enum { DEFLATE_RATIO_MAX = 1032 };

/* How one plane of a photograph is kept as a page. */
struct page {
    const char *name;
    uint16_t samples, bits, format, photometric, predictor;
};
static const struct page pages[PAGES] = {
    {"colour", 3, 8, SAMPLEFORMAT_UINT, PHOTOMETRIC_RGB, PREDICTOR_HORIZONTAL},
    {"disparity", 1, 32, SAMPLEFORMAT_IEEEFP, PHOTOMETRIC_MINISBLACK, PREDICTOR_FLOATINGPOINT},
    {"flags", 1, 8, SAMPLEFORMAT_UINT, PHOTOMETRIC_MINISBLACK, PREDICTOR_NONE},
    {"confidence", 1, 8, SAMPLEFORMAT_UINT, PHOTOMETRIC_MINISBLACK, PREDICTOR_NONE},
};

static size_t page_row_bytes(const struct page *page, int32_t width_px) {
    return (size_t)width_px * page->samples * (page->bits / 8u);
}

static void photo_planes(const struct photo *photo, uint8_t *out_planes[PAGES]) {
    out_planes[0] = photo->rgb;
    out_planes[1] = (uint8_t *)photo->disparity_per_m;
    out_planes[2] = photo->flags;
    out_planes[3] = photo->confidence;
}

static bool set_tags(TIFF *tiff, int index, const struct camera *camera, uint16_t compression,
                     const char *description) {
    const struct page *page = &pages[index];
    size_t row = page_row_bytes(page, camera->width_px);
    uint32_t rows = row >= STRIP_BYTES ? 1u : (uint32_t)(STRIP_BYTES / row);
    if (rows > (uint32_t)camera->height_px)
        rows = (uint32_t)camera->height_px;
    bool ok = TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, FILETYPE_PAGE) &&
              TIFFSetField(tiff, TIFFTAG_PAGENUMBER, index, PAGES) &&
              TIFFSetField(tiff, TIFFTAG_PAGENAME, page->name) &&
              TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, (uint32_t)camera->width_px) &&
              TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, (uint32_t)camera->height_px) &&
              TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, page->samples) &&
              TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, page->bits) &&
              TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, page->format) &&
              TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, page->photometric) &&
              TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) &&
              TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT) &&
              TIFFSetField(tiff, TIFFTAG_COMPRESSION, compression) &&
              TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, rows);
    if (ok && compression == COMPRESSION_ADOBE_DEFLATE)
        ok = TIFFSetField(tiff, TIFFTAG_PREDICTOR, page->predictor);
    if (ok && description)
        ok = TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, description) &&
             TIFFSetField(tiff, TIFFTAG_SOFTWARE, "scancart " SCANCART_VERSION);
    return ok;
}

/* Writes a plane strip by strip with the tags already set. libtiff's predictor works in the buffer
 * it is given, so each strip goes through `scratch` (one strip). */
static bool write_strips(TIFF *tiff, const uint8_t *plane, size_t plane_bytes, uint8_t *scratch) {
    const size_t strip = (size_t)TIFFStripSize(tiff);
    for (size_t at = 0, i = 0; at < plane_bytes; at += strip, i++) {
        size_t n = plane_bytes - at < strip ? plane_bytes - at : strip;
        memcpy(scratch, plane + at, n);
        if (TIFFWriteEncodedStrip(tiff, (uint32_t)i, scratch, (tmsize_t)n) < 0)
            return false;
    }
    return true;
}

/* One page on its own, deflated, in `mem`. */
static bool deflate_page(struct tiff_mem *mem, int index, const struct camera *camera,
                         const uint8_t *plane, uint8_t *scratch) {
    TIFF *tiff = tiff_mem_create(mem);
    if (!tiff)
        return false;
    const size_t bytes =
        page_row_bytes(&pages[index], camera->width_px) * (size_t)camera->height_px;
    bool ok = set_tags(tiff, index, camera, COMPRESSION_ADOBE_DEFLATE, NULL) &&
              write_strips(tiff, plane, bytes, scratch) && TIFFWriteDirectory(tiff);
    TIFFClose(tiff);
    return ok;
}

/* Compressed strips of `from` as they are into the page that is being written. */
static bool copy_strips(TIFF *tiff, TIFF *from) {
    uint8_t *raw = NULL;
    bool ok = true;
    for (uint32_t i = 0; ok && i < TIFFNumberOfStrips(from); i++) {
        tmsize_t n = (tmsize_t)TIFFGetStrileByteCount(from, i);
        uint8_t *bigger = realloc(raw, (size_t)n + 1);
        ok = bigger != NULL;
        if (!ok)
            break;
        raw = bigger;
        ok = TIFFReadRawStrip(from, i, raw, n) == n && TIFFWriteRawStrip(tiff, i, raw, n) == n;
    }
    free(raw);
    return ok;
}

static size_t stored_bytes(TIFF *tiff) {
    size_t sum = 0;
    for (uint32_t i = 0; i < TIFFNumberOfStrips(tiff); i++)
        sum += (size_t)TIFFGetStrileByteCount(tiff, i);
    return sum;
}

/* Deflates the page aside and takes the result only if it is smaller. */
static bool write_page(TIFF *tiff, int index, const struct camera *camera, const uint8_t *plane,
                       const char *description, uint8_t *scratch) {
    const size_t bytes =
        page_row_bytes(&pages[index], camera->width_px) * (size_t)camera->height_px;
    struct tiff_mem mem = {0};
    bool ok = deflate_page(&mem, index, camera, plane, scratch);
    TIFF *packed = ok ? tiff_mem_reopen(&mem) : NULL;
    ok = packed != NULL;
    const bool smaller = ok && stored_bytes(packed) < bytes;
    ok = ok && set_tags(tiff, index, camera, smaller ? COMPRESSION_ADOBE_DEFLATE : COMPRESSION_NONE,
                        description);
    ok = ok && (smaller ? copy_strips(tiff, packed) : write_strips(tiff, plane, bytes, scratch));
    ok = ok && TIFFWriteDirectory(tiff);
    if (packed)
        TIFFClose(packed);
    tiff_mem_fini(&mem);
    return ok;
}

static enum st check_values(const struct photo *photo, enum st st, struct errctx *err) {
    const int32_t w = photo->camera.width_px;
    const size_t n = (size_t)w * (size_t)photo->camera.height_px;
    for (size_t i = 0; i < n; i++) {
        float d = photo->disparity_per_m[i];
        if (isinf(d) || d < 0.0f)
            return errctx_set(err, st, "disparity %g at pixel (%zu, %zu) is not 0, positive or NaN",
                              (double)d, i % (size_t)w, i / (size_t)w);
    }
    return ST_OK;
}

static enum st check_photo(const struct photo *photo, enum st st_bad, struct errctx *err) {
    enum st st = camera_check(&photo->camera, err);
    if (st)
        return errctx_prefix(err, st_bad, "camera");
    if (!camera_is_pinhole(&photo->camera))
        return errctx_set(err, st_bad, "the camera has distortion; a photograph is undistorted");
    if ((int64_t)photo->camera.width_px * photo->camera.height_px > IMAGE_MAX_PIXELS)
        return errctx_set(err, st_bad, "%d x %d pixels are too many", photo->camera.width_px,
                          photo->camera.height_px);
    if (!vec3_is_finite(photo->station_from_cam.t_m) ||
        !(pose_orthonormality_error(&photo->station_from_cam.r) <= ROTATION_TOLERANCE))
        return errctx_set(err, st_bad, "the pose is not a rotation and a finite place");
    return ST_OK;
}

enum st photo_tiff_encode(const struct photo *photo, const struct photo_tiff_info *info,
                          uint8_t **out_data, size_t *out_size, struct errctx *err) {
    enum st st = check_photo(photo, ST_INVALID, err);
    if (!st)
        st = check_values(photo, ST_INVALID, err);
    if (st)
        return st;
    struct tiff_mem mem = {0};
    TIFF *tiff = NULL;
    const struct photo_tiff_info metres = {.length_unit = "m"};
    char *description = photo_json_print(photo, info ? info : &metres);
    size_t row = page_row_bytes(&pages[1], photo->camera.width_px);
    uint8_t *scratch = malloc(row > STRIP_BYTES ? row : STRIP_BYTES);
    bool ok = description && scratch && (tiff = tiff_mem_create(&mem)) != NULL;
    uint8_t *planes[PAGES];
    photo_planes(photo, planes);
    for (int i = 0; ok && i < PAGES; i++)
        ok = write_page(tiff, i, &photo->camera, planes[i], i ? NULL : description, scratch);
    if (tiff)
        TIFFClose(tiff);
    free(scratch);
    free(description);
    if (!ok) {
        st = errctx_set(err, ST_NOMEM, "cannot make a TIFF of %d x %d pixels: %s",
                        photo->camera.width_px, photo->camera.height_px,
                        mem.message[0] ? mem.message : "out of memory");
        tiff_mem_fini(&mem);
        return st;
    }
    *out_data = mem.data;
    *out_size = mem.size;
    return ST_OK;
}

static uint32_t tag_u32(TIFF *tiff, uint32_t tag) {
    uint32_t value = 0;
    return TIFFGetField(tiff, tag, &value) ? value : 0;
}
static uint16_t tag_u16(TIFF *tiff, uint32_t tag) {
    uint16_t value = 0;
    return TIFFGetFieldDefaulted(tiff, tag, &value) ? value : 0;
}

static bool lossless(uint16_t compression) {
    switch (compression) {
    case COMPRESSION_NONE:
    case COMPRESSION_LZW:
    case COMPRESSION_ADOBE_DEFLATE:
    case COMPRESSION_DEFLATE:
    case COMPRESSION_PACKBITS:
        return true;
    default:
        return false;
    }
}

/* Whether the current directory is what page `index` of a photograph of that size must be. */
static enum st check_page(TIFF *tiff, int index, int32_t width_px, int32_t height_px,
                          struct errctx *err) {
    const struct page *page = &pages[index];
    const uint16_t samples = tag_u16(tiff, TIFFTAG_SAMPLESPERPIXEL);
    const uint16_t bits = tag_u16(tiff, TIFFTAG_BITSPERSAMPLE);
    const uint16_t format = tag_u16(tiff, TIFFTAG_SAMPLEFORMAT);
    if (tag_u32(tiff, TIFFTAG_IMAGEWIDTH) != (uint32_t)width_px ||
        tag_u32(tiff, TIFFTAG_IMAGELENGTH) != (uint32_t)height_px)
        return errctx_set(err, ST_FORMAT, "page %d (%s) is not %d x %d pixels", index + 1,
                          page->name, width_px, height_px);
    if (samples != page->samples || bits != page->bits || format != page->format)
        return errctx_set(
            err, ST_FORMAT, "page %d (%s) has %d x %d bits of kind %d, not %d x %d of kind %d",
            index + 1, page->name, samples, bits, format, page->samples, page->bits, page->format);
    if (TIFFIsTiled(tiff) || tag_u16(tiff, TIFFTAG_PLANARCONFIG) != PLANARCONFIG_CONTIG ||
        tag_u16(tiff, TIFFTAG_ORIENTATION) != ORIENTATION_TOPLEFT ||
        tag_u16(tiff, TIFFTAG_PHOTOMETRIC) != page->photometric)
        return errctx_set(err, ST_FORMAT, "page %d (%s) is not laid out in strips from the top",
                          index + 1, page->name);
    if (!lossless(tag_u16(tiff, TIFFTAG_COMPRESSION)))
        return errctx_set(err, ST_FORMAT, "page %d (%s): compression %d is not a lossless one",
                          index + 1, page->name, tag_u16(tiff, TIFFTAG_COMPRESSION));
    return ST_OK;
}

static enum st read_page(TIFF *tiff, int index, const struct camera *camera, uint8_t *plane,
                         const struct tiff_mem *mem, struct errctx *err) {
    enum st st = check_page(tiff, index, camera->width_px, camera->height_px, err);
    if (st)
        return st;
    const size_t bytes =
        page_row_bytes(&pages[index], camera->width_px) * (size_t)camera->height_px;
    const tmsize_t strip = TIFFStripSize(tiff);
    const size_t row = page_row_bytes(&pages[index], camera->width_px);
    if (strip <= 0 || (size_t)strip % row)
        return errctx_set(err, ST_FORMAT, "page %d has strips of %lld bytes", index + 1,
                          (long long)strip);
    for (size_t at = 0, i = 0; at < bytes; at += (size_t)strip, i++) {
        size_t n = bytes - at < (size_t)strip ? bytes - at : (size_t)strip;
        if (i >= TIFFNumberOfStrips(tiff) ||
            TIFFReadEncodedStrip(tiff, (uint32_t)i, plane + at, (tmsize_t)n) != (tmsize_t)n)
            return errctx_set(err, ST_FORMAT, "page %d (%s) is damaged from row %zu on: %s",
                              index + 1, pages[index].name, at / row,
                              mem->message[0] ? mem->message : "too short");
    }
    return ST_OK;
}

/* Size of the first page and its description, before any memory is taken for it. */
static enum st read_header(TIFF *tiff, size_t file_bytes, struct photo *out_header,
                           struct photo_tiff_info *out_info, struct errctx *err) {
    uint32_t w = tag_u32(tiff, TIFFTAG_IMAGEWIDTH), h = tag_u32(tiff, TIFFTAG_IMAGELENGTH);
    if (w < 1 || h < 1 || w > IMAGE_MAX_SIDE_PX || h > IMAGE_MAX_SIDE_PX ||
        (int64_t)w * h > IMAGE_MAX_PIXELS)
        return errctx_set(err, ST_FORMAT, "%u x %u pixels are out of bounds", w, h);
    if ((uint64_t)w * h * 9 / DEFLATE_RATIO_MAX > file_bytes)
        return errctx_set(err, ST_FORMAT, "%u x %u pixels cannot be in %zu bytes", w, h,
                          file_bytes);
    char *description = NULL;
    if (!TIFFGetField(tiff, TIFFTAG_IMAGEDESCRIPTION, &description) || !description)
        return errctx_set(err, ST_FORMAT, "no image description: not a 3D photograph");
    enum st st = photo_json_parse(description, out_header, out_info, err);
    if (st)
        return errctx_prefix(err, st, "image description");
    if (out_header->camera.width_px != (int32_t)w || out_header->camera.height_px != (int32_t)h)
        return errctx_set(err, ST_FORMAT, "the camera says %d x %d pixels, the page %u x %u",
                          out_header->camera.width_px, out_header->camera.height_px, w, h);
    return check_photo(out_header, ST_FORMAT, err);
}

static enum st read_pages(TIFF *tiff, struct tiff_mem *mem, struct photo *out_photo,
                          struct photo_tiff_info *out_info, struct errctx *err) {
    struct photo header = {0}, photo = {0};
    struct photo_tiff_info info = {{0}, {0}};
    enum st st = read_header(tiff, mem->size, &header, &info, err);
    if (!st)
        st = photo_create(&header.camera, &photo, err);
    if (st)
        return st;
    photo.station_from_cam = header.station_from_cam;
    uint8_t *planes[PAGES];
    photo_planes(&photo, planes);
    for (int i = 0; !st && i < PAGES; i++) {
        if (i && !TIFFReadDirectory(tiff))
            st = errctx_set(err, ST_FORMAT, "page %d (%s) is missing%s%s", i + 1, pages[i].name,
                            mem->message[0] ? ": " : "", mem->message);
        else
            st = read_page(tiff, i, &photo.camera, planes[i], mem, err);
    }
    if (!st)
        st = check_values(&photo, ST_FORMAT, err);
    if (st) {
        photo_destroy(&photo);
        return st;
    }
    *out_photo = photo;
    if (out_info)
        *out_info = info;
    return ST_OK;
}

enum st photo_tiff_decode(const void *data, size_t size, struct photo *out_photo,
                          struct photo_tiff_info *out_info, struct errctx *err) {
    struct tiff_mem mem;
    TIFF *tiff = tiff_mem_open(&mem, data, size);
    if (!tiff)
        return errctx_set(err, ST_FORMAT, "not a TIFF: %s",
                          mem.message[0] ? mem.message : "cannot be opened");
    enum st st = read_pages(tiff, &mem, out_photo, out_info, err);
    TIFFClose(tiff);
    return st;
}

enum st photo_tiff_write(const char *path, const struct photo *photo,
                         const struct photo_tiff_info *info, struct errctx *err) {
    uint8_t *data = NULL;
    size_t size = 0;
    enum st st = photo_tiff_encode(photo, info, &data, &size, err);
    if (st)
        return errctx_prefix(err, st, "%s", path);
    st = fileio_write(path, data, size, err);
    free(data);
    return st;
}

enum st photo_tiff_read(const char *path, struct photo *out_photo, struct photo_tiff_info *out_info,
                        struct errctx *err) {
    uint8_t *data = NULL;
    size_t size = 0;
    const size_t bound = (size_t)IMAGE_MAX_PIXELS * 9 + PHOTO_TIFF_OVERHEAD_BYTES(IMAGE_MAX_PIXELS);
    enum st st = fileio_read(path, bound, &data, &size, err);
    if (st)
        return st;
    st = photo_tiff_decode(data, size, out_photo, out_info, err);
    free(data);
    return st ? errctx_prefix(err, st, "%s", path) : ST_OK;
}
