/* Parts of a device as devices of their own: words, refusals, and what a context on a part is. */
#include <hadalens/opencl.h>

#include "testing.h"

TEST(reads_words)
{
    static const struct {
        const char *words, *rest;
        int part, parts;
    } rows[] = {{"0:1/2", "0", 1, 2},       {"cpu:3/8", "cpu", 3, 8}, {"a:b:2/2", "a:b", 2, 2},
                {"0", "0", 0, 0},           {"", "", 0, 0},           {"0:1", "0:1", 0, 0},
                {"0:1/2x", "0:1/2x", 0, 0}, {"0/2", "0/2", 0, 0},     {"name: x", "name: x", 0, 0}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char words[32];
        int part = 0, parts = 0;
        strcpy(words, rows[i].words);
        ASSERT_OK(hada_device_part(words, &part, &parts, err));
        assert_string_equal(words, rows[i].rest);
        assert_int_equal(part, rows[i].part);
        assert_int_equal(parts, rows[i].parts);
    }
    static const char *const wrong[] = {"0:0/2", "0:3/2", "0:1/0", "0:-1/2", "0:1/-2"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        char words[32];
        int part = 0, parts = 0;
        strcpy(words, wrong[i]);
        ASSERT_FAILS(hada_device_part(words, &part, &parts, err), HADA_ERROR_DEVICE_CHOICE, "no part of a device");
    }
    char words[] = "0:1/2";
    int part = 2, parts = 3;
    assert_int_equal(hada_device_part(words, &part, &parts, NULL), HADA_ERROR_ARGUMENT);
}

static hada_status open_part(hada_context **context, const char *device, int part, int parts, hada_error *err)
{
    DEFAULTS(hada_context_options, options);
    options.device = device;
    options.part = part;
    options.parts = parts;
    return hada_context_create(context, &options, err);
}

TEST(refuses_what_cannot_be_divided)
{
    hada_context *context;
    static const int wrong[][2] = {{0, 2}, {3, 2}, {-1, 2}, {1, 0}, {1, -1}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        ASSERT_FAILS(open_part(&context, NULL, wrong[i][0], wrong[i][1], err), HADA_ERROR_ARGUMENT, "");
        assert_null(context);
    }
    ASSERT_FAILS(open_part(&context, NULL, 1, 100000, err), HADA_ERROR_DEVICE_CHOICE,
                 "cannot be divided into 100000 parts");
    ASSERT_FAILS(open_part(&context, "0:1/2", 1, 2, err), HADA_ERROR_ARGUMENT, "");
    /* a device that offers no parts is not asked for any: drivers have crashed there */
    const hada_device_info none = {.name = "a device", .compute_units = 8, .max_sub_devices = 0};
    cl_device_id device;
    ASSERT_FAILS(hada_device_divide(NULL, &none, 1, 2, &device, err), HADA_ERROR_DEVICE_CHOICE, "at most 0 parts");
}

TEST(divides)
{
    hada_context *whole, *part;
    ASSERT_OK(hada_context_create(&whole, NULL, err));
    const hada_device_info *device = hada_context_device(whole);
    assert_int_equal(device->parts, 0);
    unsigned most = device->max_sub_devices < device->compute_units ? device->max_sub_devices : device->compute_units;
    for (int parts = 1; parts <= (int)most && parts <= 3; parts++) {
        unsigned units = 0;
        for (int k = 1; k <= parts; k++) {
            char words[32];
            snprintf(words, sizeof words, "%d:%d/%d", device->index, k, parts);
            ASSERT_OK(open_part(&part, k % 2 ? words : NULL, k % 2 ? 0 : k, k % 2 ? 0 : parts, err));
            const hada_device_info *info = hada_context_device(part);
            assert_int_equal(info->part, k);
            assert_int_equal(info->parts, parts);
            assert_int_equal(info->index, device->index);
            assert_string_equal(info->name, device->name);
            assert_true(info->compute_units >= device->compute_units / (unsigned)parts);
            units += info->compute_units;
            hada_context_destroy(&part);
        }
        assert_int_equal(units, device->compute_units);
    }
    hada_context_destroy(&whole);
}

/* A driver may look at a part after the last command on it has ended: parts stay, and are the same for all. */
TEST(parts_outlive_their_contexts)
{
    hada_context *context;
    cl_device_id before = NULL;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    const hada_device_info whole = *hada_context_device(context);
    hada_context_destroy(&context);
    if (whole.max_sub_devices < 2 || whole.compute_units < 2)
        skip();
    for (int i = 0; i < 20; i++) {
        cl_uint units = 0;
        ASSERT_OK(open_part(&context, NULL, 1, 2, err));
        const cl_device_id device = hada_context_cl_device(context);
        hada_context_destroy(&context);
        assert_true(!before || device == before);
        before = device;
        assert_int_equal(clGetDeviceInfo(device, CL_DEVICE_MAX_COMPUTE_UNITS, sizeof units, &units, NULL), CL_SUCCESS);
        assert_true(units >= 1 && units < whole.compute_units);
    }
}
