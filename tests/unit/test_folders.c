/* Paths and folders: what a path is, names, where output may go, and folders that appear whole. */
#include "core/base.h"
#include "io/folder.h"
#include "io_testing.h"

/* A name that no file system takes. */
static const char *endless(void)
{
    static char path[600];
    snprintf(path, sizeof path, "%s/", io_folder);
    memset(path + strlen(path), 'n', 300);
    return path;
}

TEST(what_a_path_is)
{
    hada_stands kind;
    io_write_bytes(io_path("file"), "x", 1);
    const struct {
        const char *path;
        hada_stands kind;
    } cases[] = {{io_path("file"), HADA_STANDS_FILE},
                 {io_folder, HADA_STANDS_FOLDER},
                 {io_path("absent"), HADA_STANDS_NOTHING},
                 {io_path("file/below"), HADA_STANDS_NOTHING}};
    for (size_t i = 0; i < 4; i++) {
        ASSERT_OK(hada_path_kind(cases[i].path, &kind, err));
        assert_int_equal(kind, cases[i].kind);
        assert_int_equal(hada_path_is_file(cases[i].path), cases[i].kind == HADA_STANDS_FILE);
        assert_int_equal(hada_path_is_folder(cases[i].path), cases[i].kind == HADA_STANDS_FOLDER);
    }
    /* what cannot be looked at is not taken for nothing */
    ASSERT_FAILS(hada_path_kind(endless(), &kind, err), HADA_ERROR_FILE_OPEN, "cannot be looked at");
    assert_false(hada_path_is_vacant(io_path("file")));
    assert_false(hada_path_is_vacant(io_folder));
    assert_true(hada_path_is_vacant(io_path("absent")));
    assert_int_equal(mkdir(io_path("bare"), 0777), 0);
    assert_true(hada_path_is_vacant(io_path("bare")));
    rmdir(io_path("bare"));
}

TEST(names_and_messages)
{
    static const struct {
        const char *path, *stem;
    } cases[] = {{"a/b.c/d.tif", "d"}, {"d.tar.gz", "d.tar"}, {"a.b/.hidden", ".hidden"}, {"plain", "plain"}};
    hada_error err = {0};
    for (size_t i = 0; i < 4; i++) {
        SCOPED_MEMORY char *stem;
        assert_int_equal(hada_path_stem(&stem, cases[i].path, &err), HADA_OK);
        assert_string_equal(stem, cases[i].stem);
    }
    snprintf(err.message, sizeof err.message, "it is cut off");
    for (int i = 0; i < 2; i++) /* said once, however often it is asked for */
        hada_error_prefix_path(&err, "dir/f.tif");
    assert_string_equal(err.message, "dir/f.tif: it is cut off");
    hada_error_prefix_path(&err, "dir/f.tif: it");
    assert_string_equal(err.message, "dir/f.tif: it: dir/f.tif: it is cut off");
    hada_error_prefix_path(NULL, "dir");
}

TEST(where_output_may_go)
{
    hada_error error = {0};
    char path[400];
    io_write_bytes(io_path("file"), "x", 1);
    ASSERT_FAILS(hada_folder_ensure(io_path("file"), err), HADA_ERROR_FILE_WRITE, "");
    ASSERT_FAILS(hada_folder_ensure(io_path("file/below"), err), HADA_ERROR_FILE_WRITE, "");
    assert_int_equal(hada_folder_ensure("/proc", &error), HADA_ERROR_FILE_WRITE); /* takes no file of anybody's */
    assert_non_null(strstr(error.message, "nothing can be written in the folder /proc"));
    ASSERT_FAILS(hada_file_check_target(io_folder, err), HADA_ERROR_FILE_WRITE, "is a folder");
    ASSERT_FAILS(hada_file_check_target(io_path("absent/x"), err), HADA_ERROR_FILE_WRITE, "there is no folder");
    ASSERT_FAILS(hada_file_check_target("/proc/hadalens", err), HADA_ERROR_FILE_WRITE, "");
    ASSERT_OK(hada_file_check_target(io_path("file"), err));
    ASSERT_OK(hada_file_check_target(io_path("new"), err));
    assert_false(io_exists(io_path("new")));
    assert_true(getcwd(path, sizeof path) != NULL);
    assert_int_equal(chdir(io_folder), 0);
    ASSERT_OK(hada_file_check_target("new", err)); /* here */
    assert_int_equal(chdir(path), 0);
    snprintf(path, sizeof path, "/%s", "hadalens-test"); /* at the root, where this user may */
    assert_int_equal(hada_file_check_target(path, &error), access("/", W_OK) ? HADA_ERROR_FILE_WRITE : HADA_OK);
}

TEST(tiffs_of_a_folder_in_order)
{
    enum { FILES = 70 };
    hada_error err = {0};
    char folder[300], path[340], **names;
    int count;
    snprintf(folder, sizeof folder, "%s/many", io_folder);
    assert_int_equal(hada_folder_ensure(folder, &err), HADA_OK);
    for (int i = FILES; i-- > 0;) {
        snprintf(path, sizeof path, "%s/f%03d.%s", folder, i, i % 3 ? i % 3 == 1 ? "tif" : "TIFF" : "Tif");
        io_write_bytes(path, "", 0);
    }
    static const char *const others[] = {".hidden.tif", "tif", "notes.txt"};
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, others[i]);
        io_write_bytes(path, "", 0);
    }
    assert_int_equal(hada_folder_list_tiffs(folder, &names, &count, &err), HADA_OK);
    assert_int_equal(count, FILES);
    for (int i = 0; i < FILES; i++)
        assert_int_equal(atoi(names[i] + 1), i);
    hada_names_free(&names, &count);
    assert_null(names);
    hada_folder_remove(folder);
    assert_int_equal(hada_folder_list_tiffs(folder, &names, &count, &err), HADA_ERROR_FILE_OPEN);
    assert_null(names);
    assert_int_equal(hada_folder_ensure(folder, &err), HADA_OK);
    assert_int_equal(hada_folder_list_tiffs(folder, &names, &count, &err), HADA_OK);
    assert_int_equal(count, 0);
    hada_names_free(&names, &count);
    hada_folder_remove(folder);
}

static hada_status fill(void *user, const char *folder, hada_error *err)
{
    char path[400];
    (void)user;
    snprintf(path, sizeof path, "%s/one", folder);
    return hada_file_write(path, "1", 1, err);
}

TEST(folders_by_every_kind_of_path)
{
    char path[400], before[400];
    struct stat what;
    /* folders above are made; slashes at the end do not count */
    snprintf(path, sizeof path, "%s/up/over/set//", io_folder);
    ASSERT_OK(hada_folder_create(path, fill, NULL, err));
    assert_true(io_exists(io_path("up/over/set/one")));
    ASSERT_FAILS(hada_folder_create(path, fill, NULL, err), HADA_ERROR_FILE_WRITE, "not an empty folder");
    hada_folder_remove(io_path("up"));
    /* a link to an empty folder stays a link */
    assert_int_equal(mkdir(io_path("real"), 0700), 0);
    assert_int_equal(symlink("real", io_path("link")), 0);
    ASSERT_OK(hada_folder_create(io_path("link"), fill, NULL, err));
    assert_int_equal(lstat(io_path("link"), &what), 0);
    assert_true(S_ISLNK(what.st_mode));
    assert_true(io_exists(io_path("real/one")));
    unlink(io_path("link"));
    hada_folder_remove(io_path("real"));
    /* a name alone: in this folder */
    assert_true(getcwd(before, sizeof before) != NULL);
    assert_int_equal(chdir(io_folder), 0);
    ASSERT_OK(hada_folder_create("set", fill, NULL, err));
    assert_int_equal(chdir(before), 0);
    assert_true(io_exists(io_path("set/one")));
    hada_folder_remove(io_path("set"));
    io_write_bytes(io_path("file"), "x", 1);
    ASSERT_FAILS(hada_folder_create(io_path("file/set"), fill, NULL, err), HADA_ERROR_FILE_WRITE, "");
    ASSERT_FAILS(hada_folder_create(io_path("file"), fill, NULL, err), HADA_ERROR_FILE_WRITE, "");
    ASSERT_FAILS(hada_folder_create(endless(), fill, NULL, err), HADA_ERROR_FILE_WRITE, "");
}

FIXTURE(io_setup, io_teardown)
