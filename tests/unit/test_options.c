/* Structs of options between callers and libraries of different versions. */
#include "testing.h"

#include "core/callers.h"

typedef struct older {
    size_t size;
    int a;
    double b;
} older;
typedef struct present {
    size_t size;
    int a;
    double b, c;
    const char *d;
} present;
typedef struct newer {
    size_t size;
    int a;
    double b, c;
    const char *d;
    double e;
    int f;
} newer;

static const present defaults = {.size = sizeof defaults, .a = 1, .b = 2.0, .c = 3.0, .d = "four"};

TEST(an_older_caller_gets_defaults)
{
    struct {
        older options;
        unsigned char behind[64];
    } caller;
    memset(&caller, 0xa5, sizeof caller);
    hada_sized_give(&caller.options, sizeof caller.options, &defaults, sizeof defaults);
    assert_int_equal(caller.options.size, sizeof caller.options);
    assert_int_equal(caller.options.a, 1);
    for (size_t i = 0; i < sizeof caller.behind; i++)
        assert_int_equal(caller.behind[i], 0xa5);

    caller.options.a = 10;
    caller.options.b = 20.0;
    present own; /* padding and all */
    memcpy(&own, &defaults, sizeof own);
    ASSERT_OK(hada_sized_take(&own, sizeof own, &caller.options, "options", err));
    assert_int_equal(own.size, sizeof own);
    assert_int_equal(own.a, 10);
    assert_true(own.b == 20.0 && own.c == 3.0);
    assert_string_equal(own.d, "four");
}

TEST(a_newer_caller_is_understood_or_refused)
{
    newer caller;
    hada_error error;
    memset(&caller, 0xa5, sizeof caller);
    hada_sized_give(&caller, sizeof caller, &defaults, sizeof defaults);
    assert_int_equal(caller.size, sizeof caller);
    assert_true(caller.c == 3.0 && caller.e == 0.0 && caller.f == 0);
    caller.c = 30.0;
    present own; /* padding and all */
    memcpy(&own, &defaults, sizeof own);
    ASSERT_OK(hada_sized_take(&own, sizeof own, &caller, "hada_some_options", err));
    assert_int_equal(own.size, sizeof own);
    assert_true(own.c == 30.0);

    caller.f = 1;
    own = defaults;
    assert_int_equal(hada_sized_take(&own, sizeof own, &caller, "hada_some_options", &error), HADA_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "hada_some_options"));
    assert_non_null(strstr(error.message, "update the library"));
    assert_memory_equal(&own, &defaults, sizeof own);
}

TEST(what_was_never_set_up_is_refused)
{
    static const size_t sizes[] = {0, 1, sizeof(size_t), sizeof(present) + 1, 1 << 20, SIZE_MAX - 7};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        present own = defaults, caller = {.size = sizes[i]};
        ASSERT_FAILS(hada_sized_take(&own, sizeof own, &caller, "hada_x_options", err), HADA_ERROR_ARGUMENT,
                     "hada_x_options_init()");
    }
    present own; /* padding and all */
    memcpy(&own, &defaults, sizeof own);
    ASSERT_OK(hada_sized_take(&own, sizeof own, NULL, "hada_x_options", err)); /* NULL: the defaults */
    assert_memory_equal(&own, &defaults, sizeof own);
}

/* Every public struct of options: its init writes exactly as much as the caller's size says, and the size. */
TEST(every_init_keeps_to_the_callers_size)
{
    static const struct {
        hada_struct which;
        size_t size;
    } all[] = {{HADA_STRUCT_FOCUS_SHARED, sizeof(hada_focus_options)},
               {HADA_STRUCT_AUGMENT, sizeof(hada_augment)},
               {HADA_STRUCT_CLASSIC_OPTIONS, sizeof(hada_classic_options)},
               {HADA_STRUCT_CONTEXT_OPTIONS, sizeof(hada_context_options)},
               {HADA_STRUCT_FIT_OPTIONS, sizeof(hada_fit_options)},
               {HADA_STRUCT_PLAN_OPTIONS, sizeof(hada_plan_options)},
               {HADA_STRUCT_PREVIEW, sizeof(hada_preview)},
               {HADA_STRUCT_PSF_OPTIONS, sizeof(hada_psf_options)},
               {HADA_STRUCT_REGISTER_TASK, sizeof(hada_register_task)},
               {HADA_STRUCT_SENSOR, sizeof(hada_sensor)},
               {HADA_STRUCT_SIMULATOR_OPTIONS, sizeof(hada_simulator_options)},
               {HADA_STRUCT_TIFF_WRITE_OPTIONS, sizeof(hada_tiff_write_options)},
               {HADA_STRUCT_UNET_OPTIONS, sizeof(hada_unet_options)},
               {HADA_STRUCT_WAVE_OPTIONS, sizeof(hada_wave_options)}};
    enum { BEHIND = 32 };
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        for (int change = -8; change <= 8; change += 8) {
            const size_t size = all[i].size + (size_t)change;
            SCOPED_MEMORY unsigned char *bytes = malloc(size + BEHIND);
            size_t stated;
            memset(bytes, 0xa5, size + BEHIND);
            hada_struct_init(all[i].which, bytes, size);
            memcpy(&stated, bytes, sizeof stated);
            assert_int_equal(stated, size);
            for (size_t k = 0; k < BEHIND; k++)
                assert_int_equal(bytes[size + k], 0xa5);
            for (size_t k = all[i].size; k < size; k++)
                assert_int_equal(bytes[k], 0);
        }
}

/* Through a public call: the caller of an older version ends before the last options. */
TEST(a_call_takes_an_older_struct)
{
    union {
        hada_unet_options options;
        unsigned char bytes[sizeof(hada_unet_options)];
    } caller;
    const size_t older_size = offsetof(hada_unet_options, up_by);
    memset(&caller, 0xa5, sizeof caller);
    hada_struct_init(HADA_STRUCT_UNET_OPTIONS, &caller.options, older_size);
    for (size_t i = older_size; i < sizeof caller; i++)
        assert_int_equal(caller.bytes[i], 0xa5);
    hada_net *net;
    caller.options.channels = caller.options.out_channels = 1;
    ASSERT_OK(hada_net_create_unet(&net, &caller.options, 1, err));
    const hada_net_info *info = hada_net_get_info(net);
    assert_int_equal(info->channels, 1);
    hada_net_destroy(&net);

    struct {
        hada_unet_options known;
        size_t unknown;
    } larger;
    hada_struct_init(HADA_STRUCT_UNET_OPTIONS, &larger.known, sizeof larger);
    ASSERT_OK(hada_net_create_unet(&net, &larger.known, 1, err));
    hada_net_destroy(&net);
    larger.unknown = 1;
    ASSERT_FAILS(hada_net_create_unet(&net, &larger.known, 1, err), HADA_ERROR_UNSUPPORTED, "");
    assert_null(net);
}

TEST(the_version_is_one)
{
    char text[64];
    snprintf(text, sizeof text, "%d.%d.%d", HADALENS_VERSION_MAJOR, HADALENS_VERSION_MINOR, HADALENS_VERSION_PATCH);
    assert_string_equal(text, HADALENS_VERSION);
    assert_string_equal(hada_version(), HADALENS_VERSION);
    assert_true(HADALENS_VERSION_NUMBER >= HADALENS_VERSION_OF(0, 1, 0));
}
