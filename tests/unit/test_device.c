/* Devices, contexts, slots, buffers, and programs: compiled, cached, offline. */
#include "launch/filter_clip.h"
#include "launch/selftest.h"
#include "runtime/buffer.h"
#include "runtime/program.h"
#include "testing.h"

static void folder_make(char *path)
{
    strcpy(path, "/tmp/hadalens-test-XXXXXX");
    assert_non_null(mkdtemp(path));
}

static void folder_remove(const char *path)
{
    char command[200];
    snprintf(command, sizeof command, "rm -rf '%s'", path);
    assert_int_equal(system(command), 0);
}

TEST(lists_devices_with_sizes)
{
    hada_device_list *list;
    ASSERT_OK(hada_device_list_create(&list, err));
    const size_t count = hada_device_list_count(list);
    assert_true(count >= 1);
    for (size_t i = 0; i < count; i++) {
        const hada_device_info *info = hada_device_list_get(list, i);
        assert_int_equal(info->index, i);
        assert_true(info->name[0] != '\0');
        assert_true(info->compute_units > 0);
        assert_true(info->max_allocation_bytes > 0);
    }
    assert_null(hada_device_list_get(list, count));
    hada_device_list_destroy(&list);
    assert_null(list);
}

TEST(chooses_by_index_kind_and_name)
{
    static const hada_device_info infos[] = {
        {.kind = HADA_DEVICE_CPU, .name = "AMD EPYC", .platform = "Portable Computing Language"},
        {.kind = HADA_DEVICE_GPU, .name = "NVIDIA H200", .platform = "NVIDIA CUDA"},
        {.kind = HADA_DEVICE_ACCELERATOR, .name = "Stratix 10", .platform = "Intel FPGA"},
    };
    static const hada_device_info no_gpu[] = {
        {.kind = HADA_DEVICE_CPU, .name = "AMD EPYC"},
        {.kind = HADA_DEVICE_ACCELERATOR, .name = "Stratix 10"},
    };
    static const struct {
        const char *words;
        size_t index;
    } rows[] = {{"0", 0},    {"2", 2},       {"cpu", 0},      {"GPU", 1}, {"accelerator", 2},
                {"h200", 1}, {"stratix", 2}, {"portable", 0}, {"", 1},    {NULL, 1}};
    size_t chosen = 99;
    for (size_t i = 0; i < HADA_COUNT(rows); i++) {
        ASSERT_OK(hada_device_choose(infos, 3, rows[i].words, 0, &chosen, err));
        assert_int_equal(chosen, rows[i].index);
    }
    ASSERT_OK(hada_device_choose(no_gpu, 2, NULL, 0, &chosen, err));
    assert_int_equal(chosen, 0);
    ASSERT_OK(hada_device_choose(no_gpu, 2, NULL, 1, &chosen, err));
    assert_int_equal(chosen, 1); /* binaries at hand: the FPGA can be used */
    static const char *const wrong[] = {"7", "-1", "teapot", "other"};
    for (size_t i = 0; i < HADA_COUNT(wrong); i++) {
        ASSERT_FAILS(hada_device_choose(infos, 3, wrong[i], 0, &chosen, err), HADA_ERROR_DEVICE_CHOICE,
                     "NVIDIA H200"); /* the message lists what there is */
    }
}

TEST(takes_kernels_in_the_shape_that_is_asked_for)
{
    static const struct {
        int option;
        const char *variable;
        hada_status status;
        hada_kernel_shape shape;
    } rows[] = {
        {HADA_SHAPE_GROUPS, NULL, HADA_OK, HADA_SHAPE_GROUPS},
        {HADA_SHAPE_LANES, "groups", HADA_OK, HADA_SHAPE_LANES},
        {HADA_AUTO, "groups", HADA_OK, HADA_SHAPE_GROUPS},
        {HADA_AUTO, "lanes", HADA_OK, HADA_SHAPE_LANES},
        {HADA_AUTO, "group", HADA_ERROR_DEVICE_CHOICE, HADA_SHAPE_LANES},
        {7, NULL, HADA_ERROR_ARGUMENT, HADA_SHAPE_LANES},
    };
    const char *before = getenv("HADALENS_SHAPE");
    char *kept = before ? strdup(before) : NULL;
    for (size_t i = 0; i < HADA_COUNT(rows); i++) {
        SCOPED(hada_context) * context;
        hada_error error = {0};
        DEFAULTS(hada_context_options, options);
        options.shape = rows[i].option;
        rows[i].variable ? setenv("HADALENS_SHAPE", rows[i].variable, 1) : unsetenv("HADALENS_SHAPE");
        assert_int_equal(hada_context_create(&context, &options, &error), rows[i].status);
        if (context)
            assert_int_equal(context->shape, rows[i].shape);
        else
            assert_non_null(strstr(error.message, rows[i].variable ? "lanes or groups" : "HADA_AUTO"));
    }
    kept ? setenv("HADALENS_SHAPE", kept, 1) : unsetenv("HADALENS_SHAPE");
    free(kept);
    assert_string_equal(hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)HADA_SHAPE_LANES), "lanes");
    assert_string_equal(hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)HADA_SHAPE_GROUPS), "groups");
}

TEST(counts_bytes_and_keeps_the_peak)
{
    hada_context *context;
    hada_buffer a, b;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    hada_context_reset_peak(context);
    assert_int_equal(hada_context_bytes(context), 0);
    ASSERT_OK(hada_buffer_create(&a, context, 1000, "a", err));
    ASSERT_OK(hada_buffer_create(&b, context, 5 << 20, "b", err));
    hada_buffer_destroy(&a);
    assert_int_equal(hada_context_bytes(context), 5 << 20);
    assert_int_equal(hada_context_peak_bytes(context), (5 << 20) + 1000);
    ASSERT_FAILS(hada_buffer_create(&a, context, SIZE_MAX / 2, "the filters", err), HADA_ERROR_DEVICE_MEMORY,
                 "the filters");
    HADA_DESTROY_BUFFERS(&b, &b);
    close_context(&context);
    assert_null(context);
}

TEST(moves_bytes_to_and_fro)
{
    SCOPED(hada_context) * context;
    SCOPED(hada_slot) * slot;
    hada_buffer buffer;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    ASSERT_OK(hada_slot_create(&slot, context, err));
    static const size_t sizes[] = {1, 7, 4096, (3 << 20) + 5};
    for (size_t s = 0; s < HADA_COUNT(sizes); s++) {
        SCOPED_MEMORY unsigned char *in = malloc(sizes[s]), *out = malloc(sizes[s]);
        for (size_t i = 0; i < sizes[s]; i++)
            in[i] = (unsigned char)(i * 31 + s);
        ASSERT_OK(hada_buffer_create_from(&buffer, slot, in, sizes[s], "bytes", err));
        if (sizes[s] > 6)
            ASSERT_OK(hada_buffer_clear(&buffer, slot, 2, 3, err));
        ASSERT_OK(hada_buffer_read(&buffer, slot, 0, out, sizes[s], err));
        if (sizes[s] > 6)
            in[2] = in[3] = in[4] = 0;
        assert_memory_equal(in, out, sizes[s]);
        ASSERT_FAILS(hada_buffer_read(&buffer, slot, 1, out, sizes[s], err), HADA_ERROR_SIZE, "");
        hada_buffer_destroy(&buffer);
    }
}

TEST(programs_come_from_the_cache_the_second_time)
{
    char folder[64];
    SCOPED(hada_context) * context;
    folder_make(folder);
    DEFAULTS(hada_context_options, options);
    options.cache = folder;
    ASSERT_OK(hada_context_create(&context, &options, err));
    assert_int_equal(context->programs->compiled, 1);
    hada_context_destroy(&context);
    ASSERT_OK(hada_context_create(&context, &options, err));
    assert_int_equal(context->programs->compiled, 0);
    assert_int_equal(context->programs->loaded, 1);
    hada_context_destroy(&context);
    /* a damaged cache entry is only a slower start */
    char command[300];
    snprintf(command, sizeof command,
             "for f in %s/*; do printf x | dd of=$f bs=1 seek=100 conv=notrunc status=none; done", folder);
    assert_int_equal(system(command), 0);
    ASSERT_OK(hada_context_create(&context, &options, err));
    assert_int_equal(context->programs->compiled, 1);
    hada_context_destroy(&context);
    folder_remove(folder);
    /* so is a cache that cannot be written */
    options.cache = "/proc/none";
    ASSERT_OK(hada_context_create(&context, &options, err));
}

/* Writes the binary of one program where an offline device looks for it. (hada_programs_save() does so for the whole
 * manifest, which takes minutes on a CPU: the test of the command line runs it.) */
static void save_program(hada_context *context, const char *file, const char *folder)
{
    cl_program program;
    SCOPED_MEMORY unsigned char *binary;
    size_t bytes;
    char name[256];
    SCOPED_MEMORY char *text;
    ASSERT_OK(hada_kernel_text(&text, file, err));
    ASSERT_OK(hada_program_get(context, file, "", &program, err));
    ASSERT_OK(hada_program_binary(program, &binary, &bytes, err));
    ASSERT_OK(hada_program_key(context, file, "", text, name, sizeof name, err));
    ASSERT_OK(hada_binary_write(folder, name, binary, bytes, err));
}

static int stops_at_second(void *user)
{
    return ++*(int *)user > 1;
}

/* Once a program is saved somebody wants to stop: that one is there, no further one is built. */
static void saving_stops(hada_context *context, const char *folder)
{
    char inside[128], command[300];
    int asked = 0;
    DEFAULTS(hada_monitor, monitor);
    monitor.user = &asked;
    monitor.cancelled = stops_at_second;
    snprintf(inside, sizeof inside, "%s/some", folder);
    const unsigned before = context->programs->compiled;
    ASSERT_FAILS(hada_programs_save(context, inside, &monitor, err), HADA_ERROR_CANCELLED, "");
    assert_int_equal(asked, 2);
    assert_true(context->programs->compiled <= before + 1);
    snprintf(command, sizeof command, "test $(ls -A %s | wc -l) = 1 && rm -r %s", inside, inside);
    assert_int_equal(system(command), 0);
}

TEST(offline_binaries_need_no_compiler)
{
    char folder[64];
    hada_context *context;
    hada_error error;
    folder_make(folder);
    DEFAULTS(hada_context_options, options);
    options.cache = "off";
    options.binaries = folder;
    assert_int_equal(hada_context_create(&context, &options, &error), HADA_ERROR_BUILD);
    assert_null(context);
    assert_non_null(strstr(error.message, "--save-binaries")); /* says what to do */
    options.binaries = NULL;
    ASSERT_OK(hada_context_create(&context, &options, err));
    save_program(context, "selftest", folder);
    ASSERT_FAILS(hada_programs_save(context, "/proc/none/x", NULL, err), HADA_ERROR_FILE_WRITE, "");
    saving_stops(context, folder);
    hada_context_destroy(&context);
    options.binaries = folder;
    ASSERT_OK(hada_context_create(&context, &options, err));
    hada_slot *slot;
    ASSERT_OK(hada_slot_create(&slot, context, err));
    hada_kernel missing = hada_kernel_selftest_product;
    missing.name = "no_such_kernel";
    const hada_range range = hada_range_of(1, 1, 1, 1);
    const hada_args_selftest_product args = {.a = NULL};
    ASSERT_FAILS(hada_launch(slot, &missing, HADA_PROGRAM_SELFTEST_DEFAULT, &range, &args, err), HADA_ERROR_DEVICE, "");
    ASSERT_FAILS(hada_program_prepare(slot, &hada_file_selftest, -1, err), HADA_ERROR_STATE, "");
    ASSERT_FAILS(hada_prepare_filter_clip(slot, HADA_PROGRAM_FILTER_CLIP_DEFAULT, err), HADA_ERROR_BUILD, "");
    assert_int_equal(context->programs->compiled, 0);
    assert_int_equal(context->programs->loaded, 1);
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    folder_remove(folder);
}

TEST(a_kernel_that_does_not_build_says_so)
{
    SCOPED(hada_context) * context;
    cl_program program;
    hada_error error;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    assert_int_equal(hada_program_compile(context, "broken", "", "__kernel void f(", &program, &error),
                     HADA_ERROR_BUILD);
    assert_non_null(strstr(error.message, "broken.cl"));
    assert_true(error.detail[0] != '\0');
}
