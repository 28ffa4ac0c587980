/* The disk cache of programs is optional: contexts open and compute whatever is found in its place. */
#include <dirent.h>
#include <sys/wait.h>

#include "runtime/program.h"
#include "testing.h"

enum { PROCESSES = 3 };

typedef struct place {
    char folder[64], cache[128];
} place;

static int begin(void **state)
{
    static place here;
    strcpy(here.folder, "/tmp/hadalens-cache-XXXXXX");
    assert_non_null(mkdtemp(here.folder));
    snprintf(here.cache, sizeof here.cache, "%s/cache", here.folder);
    *state = &here;
    return 0;
}

static int end(void **state)
{
    char command[100];
    snprintf(command, sizeof command, "rm -rf '%s'", ((place *)*state)->folder);
    assert_int_equal(system(command), 0);
    return 0;
}

/* The self-test of a new context compiles or loads one program. */
static hada_status open_and_close(const char *cache, unsigned *compiled, unsigned *loaded)
{
    hada_context *context;
    hada_error error = {0};
    DEFAULTS(hada_context_options, options);
    options.cache = cache;
    const hada_status status = hada_context_create(&context, &options, &error);
    if (status) {
        print_message("%s\n", error.message);
        return status;
    }
    *compiled = context->programs->compiled;
    *loaded = context->programs->loaded;
    hada_context_destroy(&context);
    return HADA_OK;
}

/* Calls `visit` for each file; returns how many are whole binaries, -1 when there are other files too. */
static int each_file(const char *folder, void (*visit)(const char *folder, const char *name))
{
    int count = 0, others = 0;
    DIR *all = opendir(folder);
    assert_non_null(all);
    for (struct dirent *entry; (entry = readdir(all));) {
        const char *dot = strrchr(entry->d_name, '.');
        if (*entry->d_name == '.')
            continue;
        count++;
        others += !dot || strcmp(dot, ".bin");
        if (visit)
            visit(folder, entry->d_name);
    }
    closedir(all);
    return others ? -1 : count;
}

/* Several processes, none of which has touched OpenCL yet, start at once. Runs first. */
TEST(processes_share_an_empty_folder)
{
    const place *here = *state;
    unsigned compiled = 9, loaded = 9;
    pid_t children[PROCESSES];
    for (int i = 0; i < PROCESSES; i++) {
        children[i] = fork();
        if (!children[i])
            _exit(open_and_close(here->cache, &compiled, &loaded) || compiled + loaded != 1);
        assert_true(children[i] > 0);
    }
    for (int i = 0; i < PROCESSES; i++) {
        int result;
        assert_int_equal(waitpid(children[i], &result, 0), children[i]);
        assert_int_equal(result, 0);
    }
    assert_int_equal(each_file(here->cache, NULL), 1);
    assert_int_equal(open_and_close(here->cache, &compiled, &loaded), HADA_OK);
    assert_int_equal(compiled, 0);
    assert_int_equal(loaded, 1);
}

static void put_noise(const char *folder, const char *name)
{
    char path[400];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    for (int i = 0; i < 5000; i++)
        fputc(i * 37 + 11, file);
    fclose(file);
}

static void put_nothing(const char *folder, const char *name)
{
    char path[400];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(truncate(path, 0), 0);
}

static void put_half(const char *folder, const char *name)
{
    char path[400];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(truncate(path, 300), 0);
}

static void put_folder(const char *folder, const char *name)
{
    char path[400];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(unlink(path), 0);
    ASSERT_OK(hada_folder_make(path, HADA_OURS_ALONE, err));
}

/* As our files are, but what the driver gets is nonsense; longer than a true binary. */
static void put_sound_nonsense(const char *folder, const char *name)
{
    static const unsigned char noise[3 << 20] = {1, 2, 3};
    ASSERT_OK(hada_binary_write(folder, name, noise, sizeof noise, err));
}

TEST(garbage_is_only_a_slower_start)
{
    const place *here = *state;
    void (*const spoil[])(const char *, const char *) = {put_noise, put_nothing, put_half, put_sound_nonsense,
                                                         put_folder};
    for (size_t i = 0; i < sizeof spoil / sizeof *spoil; i++) {
        unsigned compiled = 9, loaded = 9;
        each_file(here->cache, spoil[i]);
        assert_int_equal(open_and_close(here->cache, &compiled, &loaded), HADA_OK);
        assert_int_equal(compiled, 1);
        assert_int_equal(loaded, 0);
        if (spoil[i] == put_folder)
            continue;
        assert_int_equal(open_and_close(here->cache, &compiled, &loaded), HADA_OK);
        assert_int_equal(loaded, 1); /* mended */
    }
    assert_int_equal(each_file(here->cache, NULL), 1);
}

TEST(a_place_that_cannot_be_written_does_no_harm)
{
    const place *here = *state;
    char file[200], below[240];
    snprintf(file, sizeof file, "%s/file", here->folder);
    snprintf(below, sizeof below, "%s/cache", file);
    put_noise(here->folder, "file");
    char too_long[5000];
    memset(too_long, 'x', sizeof too_long);
    too_long[sizeof too_long - 1] = '\0';
    const char *const places[] = {file, below, "/proc/hadalens", too_long, "off", ""};
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        unsigned compiled = 9, loaded = 9;
        assert_int_equal(open_and_close(places[i], &compiled, &loaded), HADA_OK);
        assert_int_equal(compiled, 1);
    }
}

/* A service without a home: no place for a cache, and no need of one. */
TEST(works_without_a_home)
{
    static const char *const names[] = {"HOME", "XDG_CACHE_HOME", "HADALENS_CACHE"};
    char *kept[3];
    unsigned compiled = 9, loaded = 9;
    for (int i = 0; i < 3; i++) {
        kept[i] = getenv(names[i]) ? strdup(getenv(names[i])) : NULL;
        unsetenv(names[i]);
    }
    assert_int_equal(open_and_close(NULL, &compiled, &loaded), HADA_OK);
    assert_int_equal(compiled, 1);
    for (int i = 0; i < 3; i++) {
        if (kept[i])
            setenv(names[i], kept[i], 1);
        free(kept[i]);
    }
}

/* Binaries run: a folder that others can write to is neither read nor written. */
TEST(a_place_that_others_write_to_is_left_aside)
{
    const place *here = *state;
    unsigned compiled = 0, loaded = 0;
    char cache[160];
    snprintf(cache, sizeof cache, "%s/open", here->folder);
    ASSERT_OK(open_and_close(cache, &compiled, &loaded));
    ASSERT_OK(open_and_close(cache, &compiled, &loaded));
    assert_true(loaded >= 1 && each_file(cache, NULL) >= 1);
    static const mode_t modes[] = {0770, 0707, 0777};
    for (size_t i = 0; i < sizeof modes / sizeof *modes; i++) {
        assert_int_equal(chmod(cache, modes[i]), 0);
        ASSERT_OK(open_and_close(cache, &compiled, &loaded));
        assert_true(compiled >= 1 && !loaded);
    }
    assert_int_equal(chmod(cache, 0755), 0);
    ASSERT_OK(open_and_close(cache, &compiled, &loaded));
    assert_true(loaded >= 1);
}

FIXTURE(begin, end)
