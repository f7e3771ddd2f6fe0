#include "tests/support/power_vfs.h"

#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NODES_MAX = 64, NAME_MAX_BYTES = 512, SECTOR = 512 };

/* A file by its path: what is written and what of it is flushed. */
struct node {
    char path[NAME_MAX_BYTES];
    bool exists, loaded;
    uint8_t *now, *flushed;
    int64_t now_size, flushed_size, capacity;
};

struct file {
    sqlite3_file base;
    struct node *node; /* NULL: not watched */
    sqlite3_file *real;
};

static sqlite3_vfs *system_vfs;
static sqlite3_vfs power;
static struct node nodes[NODES_MAX];
static int64_t operations, fail_first, fail_end;
static void (*on_operation)(int64_t operation);

/* Counts an operation; true if it must fail. */
static bool count_operation(void) {
    operations++;
    if (on_operation)
        on_operation(operations);
    return operations >= fail_first && operations < fail_end;
}

static struct node *node_of(const char *path) {
    for (int i = 0; i < NODES_MAX; i++) {
        if (!nodes[i].path[0])
            (void)snprintf(nodes[i].path, sizeof nodes[i].path, "%s", path);
        if (!strcmp(nodes[i].path, path))
            return &nodes[i];
    }
    abort();
}

static void reserve(struct node *node, int64_t size) {
    if (size <= node->capacity)
        return;
    int64_t capacity = 2 * size + 4096;
    node->now = realloc(node->now, (size_t)capacity);
    node->flushed = realloc(node->flushed, (size_t)capacity);
    if (!node->now || !node->flushed)
        abort();
    size_t more = (size_t)(capacity - node->capacity);
    memset(node->now + node->capacity, 0, more);
    memset(node->flushed + node->capacity, 0, more);
    node->capacity = capacity;
}

static void load(struct node *node, sqlite3_file *real) {
    sqlite3_int64 size = 0;
    node->exists = true;
    if (node->loaded || real->pMethods->xFileSize(real, &size))
        return;
    reserve(node, size);
    if (size > 0 && real->pMethods->xRead(real, node->now, (int)size, 0))
        abort();
    if (size > 0)
        memcpy(node->flushed, node->now, (size_t)size);
    node->now_size = node->flushed_size = size;
    node->loaded = true;
}

static int x_close(sqlite3_file *base) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xClose(file->real);
}
static int x_read(sqlite3_file *base, void *out, int size, sqlite3_int64 offset) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xRead(file->real, out, size, offset);
}
static int x_write(sqlite3_file *base, const void *data, int size, sqlite3_int64 offset) {
    struct file *file = (struct file *)base;
    struct node *node = file->node;
    if (node && count_operation())
        return SQLITE_IOERR_WRITE;
    if (node) {
        reserve(node, offset + size);
        memcpy(node->now + offset, data, (size_t)size);
        node->now_size = offset + size > node->now_size ? offset + size : node->now_size;
    }
    return file->real->pMethods->xWrite(file->real, data, size, offset);
}
static int x_truncate(sqlite3_file *base, sqlite3_int64 size) {
    struct file *file = (struct file *)base;
    struct node *node = file->node;
    if (node && count_operation())
        return SQLITE_IOERR_TRUNCATE;
    if (node && size < node->now_size) {
        memset(node->now + size, 0, (size_t)(node->now_size - size));
        node->now_size = size;
    }
    return file->real->pMethods->xTruncate(file->real, size);
}
static int x_sync(sqlite3_file *base, int flags) {
    struct file *file = (struct file *)base;
    struct node *node = file->node;
    if (node && count_operation())
        return SQLITE_IOERR_FSYNC;
    if (node && node->capacity) {
        memcpy(node->flushed, node->now, (size_t)node->capacity);
        node->flushed_size = node->now_size;
    }
    (void)flags; /* the real flush would only cost time */
    return SQLITE_OK;
}
static int x_file_size(sqlite3_file *base, sqlite3_int64 *out_size) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xFileSize(file->real, out_size);
}
static int x_lock(sqlite3_file *base, int level) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xLock(file->real, level);
}
static int x_unlock(sqlite3_file *base, int level) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xUnlock(file->real, level);
}
static int x_check_reserved_lock(sqlite3_file *base, int *out) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xCheckReservedLock(file->real, out);
}
static int x_file_control(sqlite3_file *base, int op, void *arg) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xFileControl(file->real, op, arg);
}
static int x_sector_size(sqlite3_file *base) {
    (void)base;
    return SECTOR;
}
static int x_device_characteristics(sqlite3_file *base) {
    (void)base;
    return 0; /* promises nothing, not even that a write leaves its neighbours alone */
}
static int x_shm_map(sqlite3_file *base, int page, int size, int extend, void volatile **out) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xShmMap(file->real, page, size, extend, out);
}
static int x_shm_lock(sqlite3_file *base, int offset, int n, int flags) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xShmLock(file->real, offset, n, flags);
}
static void x_shm_barrier(sqlite3_file *base) {
    struct file *file = (struct file *)base;
    file->real->pMethods->xShmBarrier(file->real);
}
static int x_shm_unmap(sqlite3_file *base, int remove) {
    struct file *file = (struct file *)base;
    return file->real->pMethods->xShmUnmap(file->real, remove);
}

static const sqlite3_io_methods methods = {
    .iVersion = 2,
    .xClose = x_close,
    .xRead = x_read,
    .xWrite = x_write,
    .xTruncate = x_truncate,
    .xSync = x_sync,
    .xFileSize = x_file_size,
    .xLock = x_lock,
    .xUnlock = x_unlock,
    .xCheckReservedLock = x_check_reserved_lock,
    .xFileControl = x_file_control,
    .xSectorSize = x_sector_size,
    .xDeviceCharacteristics = x_device_characteristics,
    .xShmMap = x_shm_map,
    .xShmLock = x_shm_lock,
    .xShmBarrier = x_shm_barrier,
    .xShmUnmap = x_shm_unmap,
};

static int x_open(sqlite3_vfs *vfs, sqlite3_filename name, sqlite3_file *base, int flags,
                  int *out_flags) {
    struct file *file = (struct file *)base;
    (void)vfs;
    memset(file, 0, sizeof *file);
    file->real = (sqlite3_file *)(void *)(file + 1);
    int rc = system_vfs->xOpen(system_vfs, name, file->real, flags, out_flags);
    if (rc)
        return rc;
    file->base.pMethods = &methods;
    bool watched = flags & (SQLITE_OPEN_MAIN_DB | SQLITE_OPEN_WAL | SQLITE_OPEN_MAIN_JOURNAL);
    if (watched && name) {
        file->node = node_of(name);
        load(file->node, file->real);
    }
    return SQLITE_OK;
}

static int x_delete(sqlite3_vfs *vfs, const char *name, int sync_dir) {
    (void)vfs;
    struct node *node = node_of(name);
    if (count_operation())
        return SQLITE_IOERR_DELETE;
    if (node->capacity) {
        memset(node->now, 0, (size_t)node->capacity);
        memset(node->flushed, 0, (size_t)node->capacity);
    }
    node->exists = node->loaded = false;
    node->now_size = node->flushed_size = 0;
    return system_vfs->xDelete(system_vfs, name, sync_dir);
}

void power_vfs_install(void) {
    power_vfs_remove();
    for (int i = 0; i < NODES_MAX; i++) {
        free(nodes[i].now);
        free(nodes[i].flushed);
        nodes[i] = (struct node){0};
    }
    operations = fail_first = fail_end = 0;
    on_operation = NULL;
    system_vfs = sqlite3_vfs_find(NULL);
    power = *system_vfs;
    power.zName = "power";
    power.szOsFile = (int)sizeof(struct file) + system_vfs->szOsFile;
    power.pNext = NULL;
    power.xOpen = x_open;
    power.xDelete = x_delete;
    (void)sqlite3_vfs_register(&power, 1);
}

void power_vfs_remove(void) {
    if (system_vfs) {
        (void)sqlite3_vfs_unregister(&power);
        (void)sqlite3_vfs_register(system_vfs, 1);
    }
    system_vfs = NULL;
}

int64_t power_vfs_operations(void) {
    return operations;
}

void power_vfs_fail_at(int64_t operation, int64_t count) {
    fail_first = operation;
    fail_end = operation + count;
}

void power_vfs_on_operation(void (*callback)(int64_t operation)) {
    on_operation = callback;
}

/* Mixes old and new sectors into `mixed` and writes the file. */
static bool write_mixed(struct rng *rng, const struct node *node, const char *path) {
    int64_t most = node->now_size > node->flushed_size ? node->now_size : node->flushed_size;
    int64_t size = node->now_size == node->flushed_size || rng_u64(rng) % 2 ? node->now_size
                                                                            : node->flushed_size;
    FILE *out = fopen(path, "wb");
    if (!out)
        return false;
    bool good = true;
    bool all_old = rng_u64(rng) % 4 == 0; /* nothing of it reached the disk */
    for (int64_t at = 0; at < size && at < most && good; at += SECTOR) {
        int64_t n = size - at < SECTOR ? size - at : SECTOR;
        bool is_new = !all_old && rng_u64(rng) % 2;
        good = fwrite((is_new ? node->now : node->flushed) + at, 1, (size_t)n, out) == (size_t)n;
    }
    return fclose(out) == 0 && good;
}

bool power_vfs_cut(struct rng *rng, const char *site_folder, const char *folder) {
    size_t prefix = strlen(site_folder);
    bool good = true;
    for (int i = 0; i < NODES_MAX && good; i++) {
        char path[2 * NAME_MAX_BYTES];
        if (!nodes[i].exists || strncmp(nodes[i].path, site_folder, prefix) != 0)
            continue;
        (void)snprintf(path, sizeof path, "%s%s", folder, nodes[i].path + prefix);
        good = write_mixed(rng, &nodes[i], path);
    }
    return good;
}
