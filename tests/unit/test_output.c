/* What is written appears whole or not at all: temporary names, modes, what is never replaced, signals. */
#include <errno.h>
#include <signal.h>
#include <sys/wait.h>

#include "core/input.h"
#include "core/outfile.h"
#include "io/folder.h"
#include "io_testing.h"

static mode_t mode_of(const char *path)
{
    struct stat what;
    assert_int_equal(stat(path, &what), 0);
    return what.st_mode & 07777;
}

static void assert_holds(const char *path, const char *text)
{
    size_t bytes;
    SCOPED_MEMORY unsigned char *data = io_read_bytes(path, &bytes);
    assert_int_equal(bytes, strlen(text));
    assert_memory_equal(data, text, bytes);
}

TEST(a_new_file_follows_the_umask_and_a_replaced_one_stays_as_it_was)
{
    hada_error err = {0};
    const char *path = io_path("a");
    const mode_t before = umask(027);
    assert_int_equal(hada_file_write(path, "one", 3, &err), HADA_OK);
    assert_int_equal(mode_of(path), 0640);
    umask(before);
    assert_int_equal(chmod(path, 0600), 0);
    const int root = !chown(path, 12, 34); /* others may not give files away */
    assert_int_equal(hada_file_write(path, "second", 6, &err), HADA_OK);
    assert_int_equal(mode_of(path), 0600);
    struct stat what;
    assert_int_equal(stat(path, &what), 0);
    if (root)
        assert_true(what.st_uid == 12 && what.st_gid == 34);
    assert_holds(path, "second");
    /* but for bits that would give what is new the rights of another */
    assert_int_equal(chmod(path, 06755), 0);
    assert_int_equal(hada_file_write(path, "third", 5, &err), HADA_OK);
    assert_int_equal(mode_of(path), 0755);
}

TEST(links_are_followed_and_never_replaced)
{
    const char *file = io_path("file"), *link = io_path("link"), *nowhere = io_path("nowhere");
    ASSERT_OK(hada_file_write(file, "old", 3, err));
    assert_int_equal(symlink("file", link), 0);
    ASSERT_OK(hada_file_write(link, "new", 3, err));
    assert_holds(file, "new");
    struct stat what;
    assert_int_equal(lstat(link, &what), 0);
    assert_true(S_ISLNK(what.st_mode));
    assert_int_equal(symlink("gone", nowhere), 0);
    ASSERT_FAILS(hada_file_write(nowhere, "new", 3, err), HADA_ERROR_FILE_WRITE, "leads to no file");
    DEFAULTS(hada_camera, camera);
    ASSERT_OK(hada_camera_save(&camera, link, err));
    assert_int_equal(lstat(link, &what), 0);
    assert_true(S_ISLNK(what.st_mode));
    assert_int_equal(stat(file, &what), 0);
    assert_true(what.st_size > 3);
}

TEST(devices_and_fifos_are_never_replaced_and_never_waited_for)
{
    hada_error error = {0};
    const char *fifo = io_path("fifo");
    SCOPED_MEMORY char *text;
    size_t bytes;
    int code = -1;
    assert_int_equal(mkfifo(fifo, 0666), 0);
    ASSERT_FAILS(hada_file_write(fifo, "x", 1, err), HADA_ERROR_FILE_WRITE, "");
    ASSERT_FAILS(hada_file_check_target(fifo, err), HADA_ERROR_FILE_WRITE, "not an ordinary file");
    ASSERT_FAILS(hada_file_write("/dev/null", "x", 1, err), HADA_ERROR_FILE_WRITE, "");
    DEFAULTS(hada_camera, camera);
    ASSERT_FAILS(hada_camera_save(&camera, "/dev/null", err), HADA_ERROR_FILE_WRITE, "");
    const char *const unusual[] = {fifo, "/dev/zero", io_folder};
    for (size_t i = 0; i < 3; i++) {
        assert_int_equal(hada_input_read(&text, &bytes, unusual[i], 100, &code, &error), HADA_ERROR_FILE_OPEN);
        assert_int_equal(code, 0);
        assert_non_null(strstr(error.message, "not an ordinary file"));
    }
    ASSERT_FAILS(hada_input_read(&text, &bytes, io_path("absent"), 100, &code, err), HADA_ERROR_FILE_OPEN, "");
    assert_int_equal(code, ENOENT);
    io_write_bytes(io_path("long"), "123456", 6);
    ASSERT_FAILS(hada_input_read(&text, &bytes, io_path("long"), 5, &code, err), HADA_ERROR_FILE_FORMAT, "");
    ASSERT_OK(hada_input_read(&text, &bytes, io_path("long"), 6, &code, err));
    assert_string_equal(text, "123456");
}

TEST(inputs_are_not_overwritten_while_they_are_in_use)
{
    hada_inputs *inputs;
    const char *input = io_path("input"), *other = io_path("other"), *link = io_path("way");
    ASSERT_OK(hada_file_write(input, "in", 2, err));
    ASSERT_OK(hada_file_write(other, "in", 2, err));
    assert_int_equal(symlink("input", link), 0);
    const char *const paths[] = {input, "/dev/null", "not there", NULL};
    ASSERT_OK(hada_inputs_protect(&inputs, paths, 4, err));
    const char *const ways[] = {input, link};
    for (int i = 0; i < 2; i++) {
        ASSERT_FAILS(hada_file_write(ways[i], "x", 1, err), HADA_ERROR_FILE_WRITE, "read by this command");
    }
    assert_holds(input, "in");
    ASSERT_OK(hada_file_write(other, "x", 1, err));
    hada_inputs_release(&inputs);
    assert_null(inputs);
    ASSERT_OK(hada_file_write(input, "x", 1, err));
}

static char filled[300]; /* where the folder stood that was filled last */

static hada_status fill(void *user, const char *folder, hada_error *err)
{
    char path[400];
    snprintf(filled, sizeof filled, "%s", folder);
    snprintf(path, sizeof path, "%s/one", folder);
    const hada_status status = hada_file_write(path, "1", 1, err);
    return status ? status : *(const hada_status *)user;
}

TEST(folders_are_new_under_names_that_nobody_can_foresee)
{
    hada_error err = {0};
    hada_status result = HADA_OK;
    char folder[300], first[300], left[320], path[400];
    strcpy(folder, io_path("folder"));
    /* a left-over of the old kind, which this process would have written into */
    snprintf(left, sizeof left, "%s.part-%ld", folder, (long)getpid());
    assert_int_equal(mkdir(left, 0777), 0);
    strcat(left, "/foreign");
    io_write_bytes(left, "x", 1);
    assert_int_equal(hada_folder_create(folder, fill, &result, &err), HADA_OK);
    strcpy(first, filled);
    snprintf(path, sizeof path, "%s/one", folder);
    assert_holds(path, "1");
    unlink(path);
    snprintf(path, sizeof path, "%s/foreign", folder);
    assert_false(io_exists(path));
    /* an empty folder is replaced, and keeps its mode */
    assert_int_equal(chmod(folder, 0750), 0);
    assert_int_equal(hada_folder_create(folder, fill, &result, &err), HADA_OK);
    assert_string_not_equal(first, filled);
    assert_int_equal(mode_of(folder), 0750);
    assert_int_equal(hada_folder_create(folder, fill, &result, &err), HADA_ERROR_FILE_WRITE);
    result = HADA_ERROR_NUMERIC;
    assert_int_equal(hada_folder_create(io_path("broken"), fill, &result, &err), HADA_ERROR_NUMERIC);
    assert_false(io_exists(filled));
    hada_folder_remove(folder);
    *strrchr(left, '/') = '\0';
    hada_folder_remove(left);
}

static void on_signal(int number)
{
    (void)number;
    hada_outputs_remove();
    _exit(7);
}

static hada_status fill_and_end(void *user, const char *folder, hada_error *err)
{
    char path[400];
    (void)user;
    snprintf(path, sizeof path, "%s/deep/deeper", folder);
    assert_int_equal(hada_folder_ensure(path, err), HADA_OK);
    for (int i = 0; i < 300; i++) {
        snprintf(path, sizeof path, "%s/deep/deeper/a file with a name of some length %d", folder, i);
        assert_int_equal(hada_file_write(path, "1", 1, err), HADA_OK);
    }
    raise(SIGTERM);
    return HADA_OK;
}

TEST(a_handler_of_a_signal_removes_what_is_not_whole)
{
    const int before = io_count();
    const pid_t child = fork();
    if (!child) {
        hada_error err = {0};
        hada_outfile file;
        signal(SIGTERM, on_signal);
        if (!hada_outfile_open(&file, io_path("half"), &err) && !hada_outfile_write(&file, "half", 4, &err))
            hada_folder_create(io_path("half folder"), fill_and_end, NULL, &err);
        _exit(1);
    }
    int result;
    assert_int_equal(waitpid(child, &result, 0), child);
    assert_true(WIFEXITED(result) && WEXITSTATUS(result) == 7);
    assert_int_equal(io_count(), before);
    DIR *folder = opendir(io_folder);
    for (const struct dirent *entry; (entry = readdir(folder));)
        assert_null(strstr(entry->d_name, ".hadalens-"));
    closedir(folder);
}

FIXTURE(io_setup, io_teardown)
