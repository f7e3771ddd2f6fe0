/* The header of a PLY file and the scalars behind it; used by ply_grid.c. */
#ifndef SC_IMPORT_PLY_HEADER_H
#define SC_IMPORT_PLY_HEADER_H

#include "base/st.h"
#include "import/number_text.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { PLY_ELEMENTS_MAX = 8, PLY_PROPERTIES_MAX = 32, PLY_NAME_MAX = 48 };

enum ply_encoding { PLY_ASCII, PLY_LITTLE_ENDIAN, PLY_BIG_ENDIAN };

enum ply_type {
    PLY_INT8,
    PLY_UINT8,
    PLY_INT16,
    PLY_UINT16,
    PLY_INT32,
    PLY_UINT32,
    PLY_FLOAT32,
    PLY_FLOAT64
};

struct ply_property {
    char name[PLY_NAME_MAX];
    enum ply_type type;
    bool is_list;
    enum ply_type count_type;
};

struct ply_element {
    char name[PLY_NAME_MAX];
    int64_t count;
    struct ply_property properties[PLY_PROPERTIES_MAX];
    int property_count;
};

struct ply_header {
    enum ply_encoding encoding;
    struct ply_element elements[PLY_ELEMENTS_MAX];
    int element_count;
    int64_t num_rows, num_columns; /* obj_info of range grids; 0: not given */
};

/* Parses up to and with "end_header"; *out_body is where the data start. */
ST_MUST_CHECK enum st ply_header_parse(const void *data, size_t size, struct ply_header *out_header,
                                       struct number_text *out_body, struct errctx *err);

/* The next scalar of the body. False at the end, or where there is no number. */
bool ply_header_scalar(const struct ply_header *header, struct number_text *body,
                       enum ply_type type, double *out_value);

/* Bytes that an element takes at the least: what a claimed count is held against. */
size_t ply_header_least_bytes(const struct ply_header *header, const struct ply_element *element);

#ifdef __cplusplus
}
#endif
#endif
