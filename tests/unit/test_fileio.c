#include "base/fileio.h"
#include "tests/support/cmocka_all.h"
#include "tests/support/tempdir.h"

#include <dirent.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char dir[TEMPDIR_MAX];

static int setup(void **state) {
    (void)state;
    return tempdir_make(dir) ? 0 : -1;
}

static int teardown(void **state) {
    (void)state;
    tempdir_remove(dir);
    return 0;
}

static const char *in_dir(const char *name) {
    static char path[FILEIO_PATH_MAX];
    assert_int_equal(fileio_join(dir, name, path, NULL), ST_OK);
    return path;
}

static int entries(void) {
    DIR *d = opendir(dir);
    assert_non_null(d);
    int n = 0;
    for (struct dirent *e = readdir(d); e; e = readdir(d))
        n += e->d_name[0] != '.';
    (void)closedir(d);
    return n;
}

static void reads_back_what_was_written(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t *data = NULL;
    size_t size = 0;
    assert_int_equal(fileio_write(in_dir("f"), "a\0b", 3, &err), ST_OK);
    assert_int_equal(fileio_read(in_dir("f"), 3, &data, &size, &err), ST_OK);
    assert_int_equal(size, 3);
    assert_memory_equal(data, "a\0b", 4); /* and the 0 after it */
    free(data);
    uint64_t bytes = 0;
    assert_int_equal(fileio_size(in_dir("f"), &bytes, &err), ST_OK);
    assert_int_equal(bytes, 3);
    assert_int_equal(fileio_write(in_dir("f"), "", 0, &err), ST_OK);
    assert_int_equal(fileio_read(in_dir("f"), 0, &data, &size, &err), ST_OK);
    assert_int_equal(size, 0);
    free(data);
}

static void refuses_files_above_the_bound(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t *data = NULL;
    size_t size = 0;
    assert_int_equal(fileio_write(in_dir("f"), "1234", 4, &err), ST_OK);
    assert_int_equal(fileio_read(in_dir("f"), 3, &data, &size, &err), ST_FORMAT);
    assert_non_null(strstr(err.text, "larger than the 3 bytes"));
    assert_int_equal(fileio_read("/dev/zero", 100000, &data, &size, &err), ST_FORMAT);
    assert_int_equal(fileio_read(dir, 100, &data, &size, &err), ST_IO);
    assert_null(data);
}

static void files_whose_size_is_not_known_are_read_whole(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t *data = NULL;
    size_t size = 0;
    int fd[2];
    assert_int_equal(pipe(fd), 0);
    char block[20000];
    memset(block, 'x', sizeof block);
    assert_int_equal(write(fd[1], block, sizeof block), (ssize_t)sizeof block);
    (void)close(fd[1]);
    char path[64];
    (void)snprintf(path, sizeof path, "/dev/fd/%d", fd[0]);
    assert_int_equal(fileio_read(path, 30000, &data, &size, &err), ST_OK);
    (void)close(fd[0]);
    assert_int_equal(size, sizeof block);
    assert_memory_equal(data, block, sizeof block);
    free(data);
}

static void failed_write_leaves_the_old_content_and_no_litter(void **state) {
    (void)state;
    struct errctx err = {0};
    uint8_t *data = NULL;
    size_t size = 0;
    assert_int_equal(fileio_write(in_dir("f"), "old", 3, &err), ST_OK);
    int before = entries();
    assert_int_equal(fileio_mkdir(in_dir("d"), &err), ST_OK);
    assert_int_equal(fileio_write(in_dir("d"), "new", 3, &err), ST_IO); /* a directory is there */
    assert_int_equal(entries(), before + 1);
    assert_int_equal(fileio_write(in_dir("no/such"), "x", 1, &err), ST_NOT_FOUND);
    assert_non_null(strstr(err.text, "no/such: No such file or directory"));
    assert_int_equal(fileio_read(in_dir("f"), 10, &data, &size, &err), ST_OK);
    assert_memory_equal(data, "old", 3);
    free(data);
}

static void temporary_files_appear_only_when_committed(void **state) {
    (void)state;
    struct errctx err = {0};
    char temp[FILEIO_PATH_MAX], other[FILEIO_PATH_MAX];
    const char *path = in_dir("committed");
    assert_int_equal(fileio_temp(path, temp, &err), ST_OK);
    assert_int_equal(fileio_temp(path, other, &err), ST_OK);
    assert_string_not_equal(temp, other);
    FILE *f = fopen(temp, "wb");
    assert_non_null(f);
    assert_true(fputs("done", f) >= 0);
    assert_int_equal(fclose(f), 0);
    assert_false(fileio_exists(path));
    assert_int_equal(fileio_commit(temp, path, &err), ST_OK);
    assert_true(fileio_exists(path) && !fileio_exists(temp));
    fileio_abandon(other);
    assert_false(fileio_exists(other));
    struct stat info;
    assert_int_equal(stat(path, &info), 0);
    mode_t mask = umask(0);
    (void)umask(mask);
    assert_int_equal(info.st_mode & 0777, 0666 & ~mask);
}

static void pipes_are_written_to_and_never_replaced(void **state) {
    (void)state;
    struct errctx err = {0};
    char fifo[FILEIO_PATH_MAX], temp[FILEIO_PATH_MAX], text[4] = "";
    assert_int_equal(fileio_join(dir, "fifo", fifo, &err), ST_OK);
    assert_int_equal(mkfifo(fifo, 0600), 0);
    int fd = open(fifo, O_RDWR);
    assert_int_equal(fileio_write(fifo, "abc", 3, &err), ST_OK);
    assert_int_equal(read(fd, text, 3), 3);
    assert_string_equal(text, "abc");
    assert_int_equal(fileio_temp(fifo, temp, &err), ST_OK);
    assert_int_equal(fileio_commit(temp, fifo, &err), ST_INVALID);
    assert_false(fileio_exists(temp));
    struct stat info;
    assert_int_equal(stat(fifo, &info), 0);
    assert_true(S_ISFIFO(info.st_mode));
    (void)close(fd);
    (void)unlink(fifo);
    if (stat("/dev/full", &info) == 0 && S_ISCHR(info.st_mode))
        assert_int_equal(fileio_write("/dev/full", "x", 1, &err), ST_FULL);
}

static void paths_join_and_split(void **state) {
    (void)state;
    char path[FILEIO_PATH_MAX];
    struct errctx err = {0};
    static const char *const joins[][3] = {
        {"a", "b", "a/b"}, {"a/", "b", "a/b"}, {"", "b", "b"}, {"a", "/b", "/b"}, {"/", "b", "/b"}};
    for (size_t i = 0; i < sizeof joins / sizeof joins[0]; i++) {
        assert_int_equal(fileio_join(joins[i][0], joins[i][1], path, &err), ST_OK);
        assert_string_equal(path, joins[i][2]);
    }
    static const char *const dirs[][2] = {{"a/b", "a"},  {"b", "."},     {"/b", "/"}, {"a//b", "a"},
                                          {"a/b/", "a"}, {"/a/b", "/a"}, {"", "."},   {"/", "/"}};
    for (size_t i = 0; i < sizeof dirs / sizeof dirs[0]; i++) {
        assert_int_equal(fileio_dirname(dirs[i][0], path, &err), ST_OK);
        assert_string_equal(path, dirs[i][1]);
    }
    assert_string_equal(fileio_basename("a/b.c"), "b.c");
    assert_string_equal(fileio_basename("b.c"), "b.c");
    char *huge = malloc(FILEIO_PATH_MAX + 1);
    assert_non_null(huge);
    memset(huge, 'a', FILEIO_PATH_MAX);
    huge[FILEIO_PATH_MAX] = '\0';
    assert_int_equal(fileio_join("d", huge, path, &err), ST_INVALID);
    assert_int_equal(fileio_write(huge, "", 0, &err), ST_INVALID);
    assert_int_equal(fileio_mkdirs(huge, &err), ST_INVALID);
    free(huge);
}

static void directories_are_made_with_their_parents(void **state) {
    (void)state;
    struct errctx err = {0};
    assert_int_equal(fileio_mkdirs(in_dir("x/y/z"), &err), ST_OK);
    assert_true(fileio_is_dir(in_dir("x/y/z")));
    assert_int_equal(fileio_mkdirs(in_dir("x/y/z"), &err), ST_OK);
    assert_int_equal(fileio_mkdir(in_dir("x"), &err), ST_EXISTS);
    assert_int_equal(fileio_write(in_dir("x/file"), "", 0, &err), ST_OK);
    assert_int_equal(fileio_mkdirs(in_dir("x/file/deep"), &err), ST_EXISTS);
    assert_int_equal(fileio_remove(in_dir("x/file"), &err), ST_OK);
    assert_int_equal(fileio_remove(in_dir("x/file"), &err), ST_OK);
    assert_int_not_equal(fileio_remove(in_dir("x/y"), &err), ST_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(reads_back_what_was_written),
        cmocka_unit_test(refuses_files_above_the_bound),
        cmocka_unit_test(files_whose_size_is_not_known_are_read_whole),
        cmocka_unit_test(failed_write_leaves_the_old_content_and_no_litter),
        cmocka_unit_test(temporary_files_appear_only_when_committed),
        cmocka_unit_test(pipes_are_written_to_and_never_replaced),
        cmocka_unit_test(paths_join_and_split),
        cmocka_unit_test(directories_are_made_with_their_parents),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
